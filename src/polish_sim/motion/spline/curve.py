"""A smooth curve of tool frames near a chain of way points (tips, frames -> Curve).

Quintic B-splines, four times continuously differentiable, with control points taken from the chain at the
Greville places (Schoenberg's approximation), and once more from what that leaves over: straight stretches are
kept exactly, round ones nearly so. Knots are halved wherever the curve leaves the tolerance: corners get as
short as they must.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    angles_between,
    crosses,
    dots,
    evenly_to,
    midpoints,
    norms,
    running_sums,
    spans_at,
)
from polish_sim.errors import SmoothingError, place_in_mm
from polish_sim.motion.derivatives import derivative_of, jet_of
from polish_sim.motion.rules.chain import Chain, part_way


def normalized(f: Array) -> Array:
    """Vectors over their lengths. With s its square, g = s^-1/2 follows from 2 s g' = -g s'."""
    s = jet_of(dots, f, f)
    g = [1.0 / np.sqrt(s[0])]
    for m in range(3):
        known = 0.5 * derivative_of(np.multiply, g, s[1:], m)
        g.append(-(known + derivative_of(np.multiply, s, [*g[1:], 0.0], m)) / s[0])
    return jet_of(np.multiply, f, np.stack(g)[..., None])


DEGREE = 5


LONGEST_SPAN = 0.0025
"""Between knots [m]: a bend is spread over six spans, more gains nothing at the feeds of polishing, and where
bends are that long the curve is within micrometres of the chain."""
STEEPEST_GRADING = 2.0  #: Neighbouring knot spans differ by this factor at most
MOST_HALVINGS = 24
LOOKS = 8  #: Places per knot span at which the curve is compared with the chain
TURN_LENGTH = 0.001  #: A turn of the tool by one radian on the spot counts as this length [m]


class Polyline(NamedTuple):
    """What a curve is drawn along: a chain over the way of its tip."""

    chain: Chain
    #: Parameter at the way points, rising; turns on the spot have a little way too [m], shape (n + 1,)
    u: Array
    places: Array  #: Place on the path there [m], shape (n + 1,)

    def at(self, u: Array) -> Array:
        """Tip (3), x axis (3) and z axis (3) of the tool, place on the path, shape (m, 10)."""
        k = spans_at(self.u, u)
        share = ((u - self.u[k]) / np.diff(self.u)[k])[:, None]
        tips, frames = part_way(self.chain, k, share)
        return np.column_stack([tips, frames[:, :, 0], frames[:, :, 2], np.interp(u, self.u, self.places)])

    def slopes(self) -> tuple[Array, Array]:
        """Derivatives of `at` before and after every inner way point, shape (n - 1, 10) each."""
        chain, step = self.chain, np.diff(self.u)[:, None]
        tips = chain.lengths[:, None] * chain.directions / step
        turns = chain.angles[:, None] * chain.turn_axes / step
        rolls = chain.rolls[:, None] / step
        places = np.diff(self.places)[:, None] / step
        R = chain.rotations[1:-1]
        sides = []
        for side in (slice(None, -1), slice(1, None)):
            spin = turns[side] + rolls[side] * R[:, :, 2]
            axes = [crosses(spin, R[:, :, 0]), crosses(spin, R[:, :, 2])]
            sides.append(np.concatenate([tips[side], *axes, places[side]], axis=1))
        return sides[0], sides[1]


class SplineCurve(NamedTuple):
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
    turns: Array  #: Of the axis, without spin, shape (3, n, 3)
    places: Array  #: Arc length of the path [m], shape (4, n)


def polyline_of(chain: Chain, places: Array) -> Polyline:
    """A chain, with places on the path at its way points (n + 1,) [m], over its tip's way."""
    steps = np.maximum(chain.lengths, TURN_LENGTH * np.maximum(chain.angles, np.abs(chain.rolls)))
    return Polyline(chain, running_sums(steps), places)


# A corner: the fastest way round one is a racing line. The tip swings out, in and out again within the
# tolerance before it cuts the corner. Where jerk decides, its form over u is the same for every turn, but for
# the unit of length.


class Swing(NamedTuple):
    """The form of half a corner in units; its largest distance from the chain is 1
    (`benchmarks.corner_shapes`)."""

    gain: float  #: How fast corners are passed with it, by one another
    reach: float  #: Knots are stretched by this
    points: Array  #: Control points off the chain's, by the change of slopes, from the middle outwards

    @property
    def knots(self) -> Array:
        """From the middle to the end."""
        return 2.5 * self.reach * _STEPS[: len(self.points) + 3]


_STEPS = np.cumsum([0.0, 1.0, *1.5 ** np.arange(10.0)])
SWINGS = (
    Swing(1.02, 1.0053, np.array([0.8825, -0.2397, -0.9645, -1.1303, -0.6074, 0.385, 1.1039, 0.7602])),
    Swing(1.0, 1.1681, np.array([0.8327, -0.4023, -1.0535, -1.0574, -0.552])),
    Swing(0.8, 0.6588, np.array([0.8764, 0.2484])),
)
MOST_UNEQUAL = 4.0  #: Ratio of slopes up to which distances at a corner are taken square to its sides
UNIT_SHARE = 0.999  #: Of the unit that keeps the tolerance: swings are known to four digits
LONGEST_UNIT = 0.001  #: A corner of a longer unit is a bend [m]
#: Corners that neighbours leave less of their unit than this are not rounded on their own
LEAST_CORNER = 0.25
LEG_SHARE, END_SHARE = 0.45, 0.9  #: Of a segment that one corner may take, between two corners and at an end


class Corner(NamedTuple):
    """One rounded way point."""

    place: float  #: u [m]
    unit: float  #: [m]
    swing: Swing
    change: Array  #: Of the slopes, shape (10,)
    knots: Array  #: From its beginning to its end [m]


def corner_units(before: Array, after: Array, tolerance: float, axis_tolerance: float) -> Array:
    """The unit the tolerances allow every inner way point's corner by the slopes beside it (n - 1, 10) [m],
    infinite without one, shape (n - 1,)."""
    units = np.full(len(before), np.inf)
    for rows, most in ((slice(0, 3), tolerance), (slice(6, 9), axis_tolerance)):
        a, b = before[:, rows], after[:, rows]
        off, change = norms(crosses(a, b)), norms(b - a)
        low, high = np.sort([norms(a), norms(b)], axis=0)
        # Swings of the faster side would reach beyond the end of a much slower one.
        off = np.where(high < MOST_UNEQUAL * low, off / np.maximum(low, 1e-300), change)
        units = np.minimum(units, UNIT_SHARE * most / np.maximum(np.maximum(off, 0.5 * change), 1e-300))
    return units


def _isolated(line: Polyline, k: int, unit: float, change: Array, least: float) -> Corner | None:
    """Way point k, where slopes ``change`` (10,), rounded on its own, with the swing that is fastest in the
    room there is; None below ``least``."""
    steps, last = np.diff(line.u), len(line.u) - 2
    room = min(
        steps[k - 1] * (END_SHARE if k == 1 else LEG_SHARE),
        steps[k] * (END_SHARE if k == last else LEG_SHARE),
    )
    shares = [min(1.0, room / (unit * swing.knots[-1])) for swing in SWINGS]
    share, swing = max(zip(shares, SWINGS, strict=True), key=lambda fit: fit[1].gain * math.cbrt(fit[0]))
    if share < least:
        return None
    place, half = float(line.u[k]), share * unit * swing.knots
    return Corner(place, share * unit, swing, change, place + np.concatenate([-half[:0:-1], half]))


def fit_curve(line: Polyline, tolerance: float, axis_tolerance: float) -> SplineCurve:
    """The curve with knots as far apart as the tolerances allow; it begins and ends at the line's ends.

    ``tolerance`` is the largest distance of the tip from the chain [m], ``axis_tolerance`` that of the tool's
    axis from its turns [rad]; both positive.

    Raises:
        SmoothingError: There is none; names a place.
    """
    length, (before, after) = float(line.u[-1]), line.slopes()
    units, changes = corner_units(before, after, tolerance, axis_tolerance), after - before
    knots = evenly_to(length, LONGEST_SPAN)

    def rounded(which: Indices, least: float) -> dict[int, Corner]:
        found = {int(k): _isolated(line, int(k) + 1, units[k], changes[k], least) for k in which}
        return {k: corner for k, corner in found.items() if corner is not None}

    known = rounded(np.flatnonzero(units < LONGEST_UNIT), LEAST_CORNER)
    for _ in range(MOST_HALVINGS):
        corners = [known[k] for k in sorted(known)]
        knots = _with_corners(knots, corners)
        spline = draw_spline(line, knots, corners)
        off = _off(line, spline, knots, (tolerance, axis_tolerance))
        off &= ~_inside(midpoints(knots), corners)
        if not off.any():
            return SplineCurve(spline, length)
        place = place_in_mm(line.at(knots[:-1][off][:1])[0, :3])
        known = rounded(_alone(line, knots, off) - 1, 0.0) | known
        knots = _halved(knots, off)
    raise SmoothingError(
        f"no smooth curve stays within {tolerance * 1e3:g} mm and {math.degrees(axis_tolerance):g} deg of "
        f"the path at {place}. Widen the tolerances of the tip or the axis, or set both to 0 to stop at "
        "every point."
    )


def curve_rates(curve: SplineCurve, u: Array) -> CurveRates:
    """Frames of a curve and their exact derivatives at parameters u (n,) [m]."""
    jets = np.stack([curve.spline(u, order) for order in range(4)])
    x, z = jets[..., 3:6], normalized(jets[..., 6:9])
    x = normalized(x - jet_of(np.multiply, z, jet_of(dots, x, z)[..., None]))
    frame = x, jet_of(crosses, z, x), z
    # e x e' summed over the axes is twice the angular velocity.
    turns = [jet_of(crosses, e, e[1:], 3) for e in frame]
    rotations = np.stack([e[0] for e in frame], axis=-1)
    return CurveRates(jets[..., :3], z, rotations, 0.5 * np.sum(turns, axis=0), turns[2], jets[..., 9])


def draw_spline(line: Polyline, knots: Array, corners: list[Corner]) -> BSpline:
    """Control points from the line at the Greville places, and once more from what that leaves over."""
    t = np.concatenate([np.full(DEGREE, knots[0]), knots, np.full(DEGREE, knots[-1])])
    greville = np.convolve(t[1:-1], np.full(DEGREE, 1.0 / DEGREE), "valid")
    greville[0], greville[-1] = knots[0], knots[-1]
    once = line.at(greville)
    # What a spline through these control points takes off a bend is put on them beforehand; corners have
    # their own.
    missing = (once - BSpline(t, once, DEGREE)(greville)) * ~_inside(greville, corners)[:, None]
    for corner in corners:
        points = corner.swing.points
        middle, m = int(np.searchsorted(knots, corner.place - 1e-12)) + 2, len(points)
        both = np.concatenate([points[:0:-1], points])
        missing[middle - m + 1 : middle + m] += corner.unit * both[:, None] * corner.change
    return BSpline(t, once + missing, DEGREE)


def _inside(u: Array, corners: list[Corner]) -> Bools:
    """Which places are in a corner, shape (m,)."""
    if not corners:
        return np.zeros(len(u), dtype=bool)
    ends = np.array([each.knots[[0, -1]] for each in corners])
    k = np.searchsorted(ends[:, 0], u, side="right") - 1
    return (k >= 0) & (u < ends[k, 1])


def _with_corners(knots: Array, corners: list[Corner]) -> Array:
    """Knots with those of corners instead of their own there, graded elsewhere."""
    ends = knots[[0, -1]]
    for each in corners:
        own = each.knots
        clear = own[[0, -1]] + 0.5 * (own[1] - own[0]) * np.array([-1.0, 1.0])
        knots = np.concatenate([ends, knots[(knots < clear[0]) | (knots > clear[1])], own])
    knots = np.unique(knots)
    while True:
        spans = np.diff(knots)
        beside = np.minimum(np.r_[np.inf, spans[:-1]], np.r_[spans[1:], np.inf])
        steep = (spans > STEEPEST_GRADING * beside * (1.0 + 1e-9)) & ~_inside(midpoints(knots), corners)
        if not steep.any():
            return knots
        knots = _halved(knots, steep)


def _alone(line: Polyline, knots: Array, off: Bools) -> Indices:
    """Inner way points near spans that are off with no other near them."""
    k = np.flatnonzero(off)
    first = np.searchsorted(line.u, knots[np.maximum(k - 3, 0)], side="left")
    stop = np.searchsorted(line.u, knots[np.minimum(k + 4, len(knots) - 1)], side="right")
    alone = np.unique(first[stop - first == 1])
    return alone[(alone > 0) & (alone < len(line.u) - 1)]


def _off(line: Polyline, spline: BSpline, knots: Array, tolerances: tuple[float, float]) -> Bools:
    """Which knot spans hold a place beyond a tolerance, shape (spans,)."""
    shares = np.linspace(0.0, 1.0, LOOKS, endpoint=False)
    looks = (knots[:-1, None] + shares * np.diff(knots)[:, None]).ravel()
    u = np.union1d(looks, line.u)
    drawn, wanted = spline(u), line.at(u)
    turned = [angles_between(drawn[:, axis], wanted[:, axis]) for axis in (slice(3, 6), slice(6, 9))]
    near = norms((drawn - wanted)[:, :3]) <= tolerances[0]
    off = np.zeros(len(knots) - 1, dtype=bool)
    off[spans_at(knots, u[~(near & (np.max(turned, axis=0) <= tolerances[1]))])] = True
    return off


def _halved(knots: Array, which: Bools) -> Array:
    return np.sort(np.concatenate([knots, midpoints(knots)[which]]))
