"""A smooth curve of tool frames near a chain of way points (tips, frames -> Curve).

Quintic B-splines, four times continuously differentiable, with control points taken from the chain at the Greville
places (Schoenberg's approximation), and once more from what that leaves over: straight stretches are kept exactly,
round ones nearly so. Knots are halved wherever the curve leaves the tolerance: corners get as short as they must.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from polish_sim.arrays import Array, Bools
from polish_sim.errors import SmoothingError, place_in_mm
from polish_sim.motion.rules.chain import Chain

# Functions of one variable with their derivatives, carried along exactly.
#
# A jet is an array whose first index counts derivatives: ``f[k]`` is the k-th one at n places, shape (orders, n, ...).


def scale(f: Array, g: Array) -> Array:
    """f times a scalar g: f (orders, n, 3), g (orders, n)."""
    return _leibniz(f, g[..., None], np.multiply)


def dot(f: Array, g: Array) -> Array:
    """Scalar product of vectors, shape (orders, n)."""
    return _leibniz(f, g, lambda a, b: np.einsum("ni,ni->n", a, b))


def cross(f: Array, g: Array) -> Array:
    """Vector product, shape (orders, n, 3)."""
    return _leibniz(f, g, np.cross)


def inverse_root(s: Array) -> Array:
    """1 / sqrt(s) of a positive scalar, shape (orders, n); from 2 s g' = -g s'."""
    g = np.empty_like(s)
    g[0] = 1.0 / np.sqrt(s[0])
    for m in range(len(s) - 1):
        known = sum(math.comb(m, k) * (-0.5 * g[m - k] * s[k + 1]) for k in range(m + 1))
        known -= sum(math.comb(m, k) * s[k] * g[m + 1 - k] for k in range(1, m + 1))
        g[m + 1] = known / s[0]
    return g


def normalized(f: Array) -> Array:
    """f over its length."""
    return scale(f, inverse_root(dot(f, f)))


def _leibniz(f: Array, g: Array, product: Callable[[Array, Array], Array]) -> Array:
    orders = range(min(len(f), len(g)))
    return np.stack([sum(math.comb(m, k) * product(f[k], g[m - k]) for k in range(m + 1)) for m in orders])  # type: ignore[misc]


DEGREE = 5
LONGEST_SPAN = 0.0025
"""Between knots [m]: a bend is spread over six spans, more gains nothing at the feeds of polishing, and where bends are
that long the curve is within micrometres of the chain."""
STEEPEST_GRADING = 2.0  #: Neighbouring knot spans differ by this factor at most
MOST_HALVINGS = 24
LOOKS = 8  #: Places per knot span at which the curve is compared with the chain
TURN_LENGTH = 0.001  #: A turn of the tool by one radian on the spot counts as this length [m]


class Polyline(NamedTuple):
    """What a curve is drawn along: rows of numbers over a parameter."""

    u: Array  #: Parameter: way of the tip [m], rising, shape (n,)
    values: Array  #: Tip (3), x axis (3), z axis (3) of the tool, place on the path, shape (n, 10)

    def at(self, u: Array) -> Array:
        """Its values in between, shape (m, 10)."""
        return np.stack([np.interp(u, self.u, column) for column in self.values.T], axis=1)


class Curve(NamedTuple):
    """Tool frames along a parameter u from 0 to ``length``."""

    spline: BSpline
    length: float  #: [m]

    @property
    def knots(self) -> Array:
        """Distinct knots [m], shape (k,)."""
        return np.unique(self.spline.t)


class CurveRates(NamedTuple):
    """A curve at n values of its parameter with derivatives to it."""

    tips: Array  #: [m], shape (4, n, 3)
    axes: Array  #: Unit tool axis, shape (4, n, 3)
    rotations: Array  #: Tool frames, shape (n, 3, 3)
    spins: Array  #: Angular velocity per u and its first two derivatives [rad/m^k], shape (3, n, 3)
    places: Array  #: Arc length of the path [m], shape (4, n)


def polyline_of(chain: Chain, places: Array) -> Polyline:
    """A chain over its tip's way; turns on the spot have a little way too."""
    steps = np.maximum(chain.lengths, TURN_LENGTH * np.maximum(chain.angles, np.abs(chain.rolls)))
    u = np.concatenate([[0.0], np.cumsum(steps)])
    R = chain.rotations
    return Polyline(u, np.concatenate([chain.tips, R[:, :, 0], R[:, :, 2], places[:, None]], axis=1))


def fit_curve(line: Polyline, tolerance: float, axis_tolerance: float) -> Curve:
    """The curve with knots as far apart as the tolerances allow.

    Args:
        line: What it follows.
        tolerance: Largest distance of the tip from the chain's, at the same parameter [m], positive.
        axis_tolerance: The same for the tool's axis and for its turn about it [rad], positive.

    Returns:
        The curve; it begins and ends at the line's ends.

    Raises:
        SmoothingError: There is none; names a place.
    """
    length = float(line.u[-1])
    knots = np.linspace(0.0, length, max(2, int(np.ceil(length / LONGEST_SPAN)) + 1))
    for _ in range(MOST_HALVINGS):
        spline = _drawn(line, knots)
        off = _off(line, spline, knots, tolerance, axis_tolerance)
        if not off.any():
            return Curve(spline, length)
        place = place_in_mm(line.at(knots[:-1][off][:1])[0, :3])
        knots = _graded(_halved(knots, off))
    raise SmoothingError(
        f"no smooth curve stays within {tolerance * 1e3:g} mm and {math.degrees(axis_tolerance):g} deg of the path at "
        f"{place}. Widen smoothing.tolerance_m or smoothing.axis_tolerance_rad, or set smoothing.rule to certified."
    )


def curve_rates(curve: Curve, u: Array, orders: int = 4) -> CurveRates:
    """Frames of a curve and their exact derivatives at parameters u (n,) [m]; values and derivatives are ``orders``."""
    jets = np.stack([curve.spline(u, k) for k in range(orders)])
    z = normalized(jets[..., 6:9])
    x = jets[..., 3:6]
    x = normalized(x - scale(z, dot(x, z)))
    y = cross(z, x)
    # e x e' summed over the axes is twice the angular velocity.
    spins = 0.5 * sum(cross(e[:-1], e[1:]) for e in (x, y, z))
    return CurveRates(jets[..., :3], z, np.stack([x[0], y[0], z[0]], axis=2), np.asarray(spins), jets[..., 9])


def _drawn(line: Polyline, knots: Array) -> BSpline:
    t = np.concatenate([np.full(DEGREE, knots[0]), knots, np.full(DEGREE, knots[-1])])
    greville = np.convolve(t[1:-1], np.full(DEGREE, 1.0 / DEGREE), "valid")
    greville[0], greville[-1] = knots[0], knots[-1]
    once = line.at(greville)
    # What a spline through these control points takes off a bend is put on them beforehand.
    return BSpline(t, 2.0 * once - BSpline(t, once, DEGREE)(greville), DEGREE)


def _off(line: Polyline, spline: BSpline, knots: Array, tolerance: float, axis_tolerance: float) -> Bools:
    """Which knot spans hold a place beyond a tolerance, shape (spans,)."""
    shares = np.linspace(0.0, 1.0, LOOKS, endpoint=False)
    looks = (knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel()
    u = np.union1d(looks, line.u)
    drawn, wanted = spline(u), line.at(u)
    tip = np.linalg.norm(drawn[:, :3] - wanted[:, :3], axis=1)
    turned = np.maximum(*(_angles(drawn[:, k : k + 3], wanted[:, k : k + 3]) for k in (3, 6)))
    beyond = u[~((tip <= tolerance) & (turned <= axis_tolerance))]
    off = np.zeros(len(knots) - 1, dtype=bool)
    off[np.clip(np.searchsorted(knots, beyond, side="right") - 1, 0, len(off) - 1)] = True
    return off


def _angles(one: Array, two: Array) -> Array:
    """Between vectors, not a number where one has no length [rad], shape (n,)."""
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (one, two))
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(a - b, axis=1), 1.0)))


def _halved(knots: Array, which: Bools) -> Array:
    middles = 0.5 * (knots[:-1] + knots[1:])
    return np.sort(np.concatenate([knots, middles[which]]))


def _graded(knots: Array) -> Array:
    """Halve spans until none is much longer than a neighbour."""
    while True:
        spans = np.diff(knots)
        beside = np.minimum(np.r_[np.inf, spans[:-1]], np.r_[spans[1:], np.inf])
        steep = spans > STEEPEST_GRADING * beside * (1.0 + 1e-9)
        if not steep.any():
            return knots
        knots = _halved(knots, steep)
