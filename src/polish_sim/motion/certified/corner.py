"""Corner kernels: how a corner is rounded, nearly as fast as tip and axis may.

The fastest kernels swing slightly outwards first: a and b go below zero. A shape is read from a table of half kernels
(they are symmetric about their middle): ``HALF`` pieces of equal duration with acceleration linear in each. At every
knot the table holds two numbers of the motion ``-a d1 + b d2`` about the vertex: ``X = a'' - b''`` and
``Y = b'' sin(turn)`` (``b''`` beyond a right angle), the acceleration away from the old line: what is interpolated
between nodes stays as close to it as they do. The nodes are solutions of a convex programme at unit acceleration and
jerk (lengths in A^3/J^2, times in A/J): least time lost on a long path with the motion within the tolerance of the two
lines, made by ``python -m benchmarks.corner_shapes``. A shape is only a good guess; scaling it holds limits and
tolerance (`kernel`).
"""

from __future__ import annotations

import math
from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.connector import Ends, Peaks, connect, connector_time, rise_distance, rise_time
from polish_sim.motion.certified.kernel import (
    FAR,
    HALF,
    PIECES,
    ROUNDING,
    Corner,
    Figures,
    Kernel,
    Side,
    fit_ends,
    fit_limits,
    goes_straight,
    integrate_knots,
    set_knot,
    share_used,
    side_of,
)

_HARDER = (1.5, 3.0, 6.0)
"""Values of speed jerk / acceleration^2 tried for kernels on short segments: the last is best with a wide tolerance,
the first with a narrow one."""
_SCALES = 5  #: Sizes a kernel is tried in to compare it with others


class CornerShapes(NamedTuple):
    """Half kernels on a grid, at unit acceleration and jerk."""

    angles: Array  #: Turns of the path at the nodes [rad], rising, shape (p,)
    tolerances: Array  #: Logarithms of tolerance J^2/A^3, rising, shape (q,)
    speeds: Array  #: Logarithms of speed limit J/A^2, rising, shape (r,)
    values: Array  #: Half duration, X at knots 0 to HALF - 1, Y at knots 1 to HALF, shape (p, q, r, 1 + 2 HALF)


def corner_shapes() -> CornerShapes:
    """Read the table that comes with the package."""
    with as_file(files("polish_sim.motion.certified").joinpath("corner_shapes.npz")) as file, np.load(file) as data:
        return CornerShapes(
            data["angles"].astype(float),
            np.log(data["tolerances"].astype(float)),
            np.log(data["speeds"].astype(float)),
            np.ascontiguousarray(data["values"].astype(float)),
        )


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _place(nodes: Array, x: float) -> tuple[int, float]:
    """Interval of ``nodes`` that ``x`` is in and how far along it, held at the ends."""
    i = 0
    while i < nodes.size - 2 and x >= nodes[i + 1]:
        i += 1
    return i, min(max((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0), 1.0)


@njit(cache=True, error_model="numpy", _nrt=False)
def read_shape(shapes: CornerShapes, angle: float, tolerance: float, speed: float, out: Array) -> None:
    """Interpolate half duration, X and Y of a half kernel between the nodes, into ``out``.

    The turn is given in [rad], tolerance J^2/A^3 and speed limit J/A^2 are above 0.
    """
    i, u = _place(shapes.angles, angle)
    j, v = _place(shapes.tolerances, np.log(tolerance))
    k, w = _place(shapes.speeds, np.log(speed))
    for m in range(1 + PIECES):
        out[m] = 0.0
    for corner in range(8):
        di, dj, dk = corner & 1, (corner >> 1) & 1, corner >> 2
        share = (u if di else 1.0 - u) * (v if dj else 1.0 - v) * (w if dk else 1.0 - w)
        if share > 0.0:
            for m in range(1 + PIECES):
                out[m] += share * shapes.values[i + di, j + dj, k + dk, m]


@njit(cache=True, error_model="numpy", _nrt=False)
def time_lost(figures: Figures, along: Peaks) -> float:
    """Time lost at a corner against passing it at full speed, on segments long enough to reach it [s]."""
    v, alpha, top = figures.speed, figures.acceleration, along.speed
    rise = rise_time(top - v + 0.5 * alpha * alpha / along.jerk, along) - alpha / along.jerk
    return figures.duration + 2.0 * rise - 2.0 * (figures.size + rise_distance(v, alpha, top, along)) / top


@njit(cache=True, error_model="numpy", _nrt=False)
def corner_kernel(corner: Corner, shapes: CornerShapes, kernel: Kernel) -> Figures:
    """Round a corner: fill the kernel; its figures: all but the speed 0 if nothing turns, all 0 if a tolerance is 0."""
    tip, axis = corner.tip, corner.axis
    top = min(corner.along.speed, _top_speed(tip), _top_speed(axis))
    straight = goes_straight(tip) and goes_straight(axis)
    if straight or tip.tolerance <= 0.0 or axis.tolerance <= 0.0:
        kernel.durations[:] = 0.0
        kernel.remaining[:] = 0.0
        kernel.gone[:] = 0.0
        return Figures(0.0, top if straight else 0.0, 0.0, 0.0)
    figures = _pass_at_full_speed(corner, top, kernel)
    if figures.duration >= 0.0:
        return fit_ends(corner, figures, kernel)
    return _best_for_room(corner, shapes, kernel)


@njit(cache=True, error_model="numpy", _nrt=False)
def _best_for_room(corner: Corner, shapes: CornerShapes, kernel: Kernel) -> Figures:
    """Fill the kernel for full speed or, on segments too short for it, one for the speed they reach if sooner."""
    along, spans, best = corner.along, corner.spans, 0.0
    figures = fit_ends(corner, _best_shape(corner, best, shapes, kernel), kernel)
    reached, _ = connect(Ends(0.0, 0.0, 0.0, 0.0), min(spans[0], spans[1]), along)
    if not reached < along.speed:
        return figures
    slower, soonest = Corner(corner.tip, corner.axis, Peaks(reached, along.acceleration, along.jerk), spans), math.inf
    for attempt in range(1 + len(_HARDER)):
        harder = _HARDER[attempt - 1] if attempt > 0 else 0.0
        if attempt > 0:
            figures = fit_ends(corner, _best_shape(slower, harder, shapes, kernel), kernel)
        time = _passing_time(figures, corner)
        if time < soonest:
            best, soonest = harder, time
    return fit_ends(corner, _best_shape(slower if best > 0.0 else corner, best, shapes, kernel), kernel)


@njit(cache=True, error_model="numpy", _nrt=False)
def _passing_time(figures: Figures, corner: Corner) -> float:
    """Least time over both segments with the kernel in one of its sizes between them [s].

    What happens at their other ends is not known yet: the mean of coming from rest and of other such kernels there.
    """
    along, spans, rest, alike = corner.along, corner.spans, math.inf, math.inf
    for i in range(_SCALES + 1):
        s = 1.0 - i / _SCALES
        size, v, alpha = figures.size * s**3, figures.speed * s**2, figures.acceleration * s
        if size < min(spans[0], spans[1]):
            time = connector_time(Ends(0.0, 0.0, v, alpha), spans[0] - size, along) + figures.duration * s
            rest = min(rest, time + connector_time(Ends(v, alpha, 0.0, 0.0), spans[1] - size, along))
        if 2.0 * size < min(spans[0], spans[1]):
            time = connector_time(Ends(v, alpha, v, alpha), spans[0] - 2.0 * size, along) + 2.0 * figures.duration * s
            alike = min(alike, time + connector_time(Ends(v, alpha, v, alpha), spans[1] - 2.0 * size, along))
    return 0.5 * (rest + alike)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _top_speed(side: Side) -> float:
    """Speed along generalised length at which a side reaches its limit."""
    rate = max(side.first, side.second)
    return side.limits.speed * ROUNDING / rate if rate > 0.0 else math.inf


@njit(cache=True, error_model="numpy", _nrt=False)
def _pass_at_full_speed(corner: Corner, speed: float, kernel: Kernel) -> Figures:
    """Turn the velocity at full speed by a triangle of acceleration; a negative duration if a tolerance forbids it."""
    half = max(_triangle_time(corner.tip, speed), _triangle_time(corner.axis, speed))
    peak = 0.5 * speed / half if half > 0.0 else 0.0
    kernel.durations[:] = half / HALF
    for k in range(PIECES + 1):
        set_knot(kernel, k, peak * 2.0 * min(k, PIECES - k) / HALF)
    figures = integrate_knots(kernel)
    size = figures.size
    off = max(share_used(corner.tip, FAR, size, kernel), share_used(corner.axis, FAR, size, kernel))
    return Figures(size, min(figures.speed, speed), 0.0, figures.duration if off <= 1.0 else -1.0)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _triangle_time(side: Side, speed: float) -> float:
    """Half the time of a triangle of acceleration that turns the side's velocity, within its limits [s]."""
    one, two = side.first, side.second
    change = speed * math.sqrt((one - two) ** 2 + 2.0 * one * two * (1.0 - side.cosine))
    return max(math.sqrt(change / (side.limits.jerk * ROUNDING)), change / (side.limits.acceleration * ROUNDING))


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _best_shape(corner: Corner, harder: float, shapes: CornerShapes, kernel: Kernel) -> Figures:
    """Fill the better one of the kernels made for the tip's corner and for the axis's."""
    along = corner.along
    tip, axis = _with_hold(corner.tip, along.speed, harder), _with_hold(corner.axis, along.speed, harder)
    if not _turns(tip):
        # Where tip and axis take turns each only stops or sets off: nothing leaves its line.
        stand_in = side_of(1.0, 1.0, 0.0, along, along.acceleration**3 / along.jerk**2, False)
        return _fit_shape(axis if _turns(axis) else stand_in, corner, shapes, kernel)[0]
    figures, axis_binds = _fit_shape(tip, corner, shapes, kernel)
    if not (axis_binds and _turns(axis)):
        return figures
    other = _fit_shape(axis, corner, shapes, kernel)[0]
    if time_lost(other, along) < time_lost(figures, along):
        return other
    return _fit_shape(tip, corner, shapes, kernel)[0]


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _with_hold(side: Side, speed: float, harder: float) -> Side:
    """The side with so little acceleration that braking from ``speed`` takes a hold besides its ramps.

    Without a limit of acceleration near, a shape from the table holds all of the braking, and may be much too long.
    """
    if harder == 0.0:
        return side
    most, rate = side.limits, max(side.first, side.second)
    limits = Peaks(most.speed, min(most.acceleration, math.sqrt(speed * rate * most.jerk / harder)), most.jerk)
    return Side(side.first, side.second, side.cosine, side.sine, limits, side.tolerance, side.is_axis)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _turns(side: Side) -> bool:
    """Whether a side has a corner to make a shape for."""
    return side.first > 0.0 and side.second > 0.0 and side.cosine < 1.0


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _fit_shape(made_for: Side, corner: Corner, shapes: CornerShapes, kernel: Kernel) -> tuple[Figures, bool]:
    """Fill the kernel made for one side's corner, scaled until both sides keep limits and tolerances."""
    most, along, rate = made_for.limits, corner.along, max(made_for.first, made_for.second)
    # More than this is not reached on the way from full speed on one segment to full speed back.
    acceleration = min(most.acceleration, math.sqrt(2.0 * along.speed * rate * most.jerk))
    shape = kernel.gone.reshape(kernel.gone.size)
    tolerance, speed = made_for.tolerance * most.jerk**2 / acceleration**3, along.speed * rate * most.jerk
    read_shape(shapes, math.acos(made_for.cosine), tolerance, speed / acceleration**2, shape)
    sine = max(made_for.sine, 1e-9) if made_for.cosine > 0.0 else 1.0
    kernel.durations[:] = acceleration / most.jerk * shape[0] / HALF
    for k in range(HALF + 1):
        difference = shape[1 + k] if k < HALF else 0.0
        new = shape[HALF + k] / sine if k > 0 else 0.0
        set_knot(kernel, k, acceleration / rate * (difference + new))
        set_knot(kernel, PIECES - k, acceleration / rate * new)
    return fit_limits(corner, integrate_knots(kernel), kernel)
