"""Corner kernels: how a corner is rounded, nearly as fast as tip and axis may (layer 6).

A kernel takes the last ``size`` of the old segment and the first of the new one. a(t) is what is left of the old, b(t)
what is gone on the new one: ``a(0) = h, a'(0) = -v, a''(0) = alpha``, all zero at the end, ``b(t) = a(T - t)``; jerk is
constant in each of ``PIECES`` pieces. Both go slightly below zero: swinging outwards first is what makes it fast.
A shape is read from a table (corner_shapes) and scaled until limits and tolerances hold (corner_scaling).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_bounds import Pair, Peaks
from polish_sim.motion.certified.corner_pieces import integrate_knots, set_knot, spread_shape
from polish_sim.motion.certified.corner_scaling import Fit, fit_ends, fit_limits, scaled, share_used
from polish_sim.motion.certified.corner_shapes import HALF, PIECES, CornerShapes, corner_shapes, read_shape
from polish_sim.motion.certified.corner_task import (
    FAR,
    ROUNDING,
    CornerFigures,
    CornerLimits,
    CornerWeights,
    Side,
    axis_side,
    tip_side,
)
from polish_sim.motion.certified.corner_time import lowered_limits, passing_time, reached_speed, time_lost

__all__ = [
    "FAR",
    "PIECES",
    "CornerFigures",
    "CornerLimits",
    "CornerShapes",
    "CornerWeights",
    "corner_kernel",
    "corner_shapes",
    "time_lost",
]

Array = NDArray[np.float64]

_HARDER = (1.5, 3.0, 6.0)
"""What `lowered_limits` is asked for on short segments: with a wide tolerance the last one is best, with a narrow one
the first."""


@njit(cache=True, error_model="numpy", _nrt=False)
def corner_kernel(
    weights: CornerWeights, limits: CornerLimits, shapes: CornerShapes, durations: Array, remaining: Array, gone: Array
) -> CornerFigures:
    """Round a corner.

    Args:
        weights: The corner.
        limits: What may be done.
        shapes: The table.
        durations: Changed, of each piece [s], shape (PIECES,).
        remaining: Changed, c0 .. c3 of a in each piece, shape (PIECES, 4).
        gone: Changed, c0 .. c3 of b, shape (PIECES, 4).

    Returns:
        Its figures; all but the speed are 0 if nothing turns, all of them if the tolerance is 0.
    """
    tip, axis = tip_side(weights, limits, FAR), axis_side(weights, limits, FAR)
    top = min(limits.segment_speed, _top_speed(tip), _top_speed(axis))
    if _goes_straight(tip) and _goes_straight(axis):
        return _nothing(top, durations, remaining, gone)
    if limits.tip_tolerance <= 0.0 or limits.axis_tolerance <= 0.0:
        return _nothing(0.0, durations, remaining, gone)
    passing, figures = _pass_through(tip, axis, top, durations, remaining, gone)
    if passing:
        return fit_ends(weights, limits, figures, durations, remaining, gone)
    return _best_for_room(weights, tip, axis, limits, shapes, durations, remaining, gone)


@njit(cache=True, error_model="numpy", _nrt=False)
def _best_for_room(
    weights: CornerWeights,
    tip: Side,
    axis: Side,
    limits: CornerLimits,
    shapes: CornerShapes,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> CornerFigures:
    """Fill the kernel for full speed or, on segments too short for it, one for what they reach, if it is sooner."""
    figures = _best_shape(tip, axis, limits, shapes, durations, remaining, gone)
    figures = fit_ends(weights, limits, figures, durations, remaining, gone)
    reached = reached_speed(limits, weights.spans)
    if not reached < limits.segment_speed:
        return figures
    best, soonest = limits, passing_time(figures, limits, weights.spans)
    for harder in _HARDER:
        asked = lowered_limits(limits, weights, reached, harder)
        figures = _best_shape(tip, axis, asked, shapes, durations, remaining, gone)
        figures = fit_ends(weights, limits, figures, durations, remaining, gone)
        time = passing_time(figures, limits, weights.spans)
        if time < soonest:
            best, soonest = asked, time
    figures = _best_shape(tip, axis, best, shapes, durations, remaining, gone)
    return fit_ends(weights, limits, figures, durations, remaining, gone)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _goes_straight(side: Side) -> bool:
    """Whether nothing changes at the corner."""
    pair = side.pair
    return pair.first == pair.second and (pair.first == 0.0 or pair.cosine == 1.0)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _top_speed(side: Side) -> float:
    """Speed along generalised length at which a side reaches its limit."""
    rate = max(side.pair.first, side.pair.second)
    return side.limits.speed * ROUNDING / rate if rate > 0.0 else math.inf


@njit(cache=True, error_model="numpy", _nrt=False)
def _nothing(speed: float, durations: Array, remaining: Array, gone: Array) -> CornerFigures:
    """Fill a kernel without extent."""
    for p in range(PIECES):
        durations[p] = 0.0
        for c in range(4):
            remaining[p, c] = gone[p, c] = 0.0
    return CornerFigures(0.0, speed, 0.0, 0.0)


@njit(cache=True, error_model="numpy", _nrt=False)
def _pass_through(
    tip: Side, axis: Side, speed: float, durations: Array, remaining: Array, gone: Array
) -> tuple[bool, CornerFigures]:
    """Pass the corner at full speed, the velocity going over to the new one by a triangle of acceleration.

    Returns:
        Whether the tolerances allow it, and the kernel's figures.
    """
    half = max(_triangle_time(tip, speed), _triangle_time(axis, speed))
    peak = 0.5 * speed / half if half > 0.0 else 0.0
    for p in range(PIECES):
        durations[p] = half / HALF
    for k in range(PIECES + 1):
        set_knot(remaining, k, peak * 2.0 * min(k, PIECES - k) / HALF)
    figures = CornerFigures(*integrate_knots(durations, remaining, gone))
    off = max(
        share_used(tip, figures, durations, remaining, gone), share_used(axis, figures, durations, remaining, gone)
    )
    return off <= 1.0, CornerFigures(figures.size, min(figures.speed, speed), 0.0, figures.duration)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _triangle_time(side: Side, speed: float) -> float:
    """Half the time of a triangle of acceleration that turns the side's velocity round, within its limits [s]."""
    pair = side.pair
    change = speed * math.sqrt((pair.first - pair.second) ** 2 + 2.0 * pair.first * pair.second * (1.0 - pair.cosine))
    return max(math.sqrt(change / (side.limits.jerk * ROUNDING)), change / (side.limits.acceleration * ROUNDING))


@njit(cache=True, error_model="numpy", _nrt=False)
def _best_shape(
    tip: Side,
    axis: Side,
    limits: CornerLimits,
    shapes: CornerShapes,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> CornerFigures:
    """Fill the better one of the kernels made for the tip's corner and for the axis's."""
    first, second = _with_less(tip, limits.acceleration), _with_less(axis, limits.axis_acceleration)
    if not _counts(tip):
        made_for = second if _counts(axis) else _right_angle(limits)
        return _fit_shape(made_for, tip, axis, limits, shapes, durations, remaining, gone).figures
    fit = _fit_shape(first, tip, axis, limits, shapes, durations, remaining, gone)
    if not (fit.axis_binds and _counts(axis)):
        return fit.figures
    other = _fit_shape(second, tip, axis, limits, shapes, durations, remaining, gone)
    if time_lost(other.figures, limits) < time_lost(fit.figures, limits):
        return other.figures
    return _fit_shape(first, tip, axis, limits, shapes, durations, remaining, gone).figures


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _with_less(side: Side, acceleration: float) -> Side:
    """A side to make a shape for that brakes no harder than this."""
    most = side.limits
    return Side(
        side.pair, Peaks(most.speed, min(most.acceleration, acceleration), most.jerk), side.tolerance, side.bends
    )


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _right_angle(limits: CornerLimits) -> Side:
    """A corner that stands in where tip and axis take turns: each only stops or sets off, nothing leaves its line."""
    most = Peaks(limits.segment_speed, limits.segment_acceleration, limits.segment_jerk)
    return Side(Pair(1.0, 1.0, 0.0, 1.0, *FAR), most, most.acceleration**3 / most.jerk**2, False)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _counts(side: Side) -> bool:
    """Whether a side has a corner to make a shape for."""
    return side.pair.first > 0.0 and side.pair.second > 0.0 and side.pair.cosine < 1.0


@njit(cache=True, error_model="numpy", _nrt=False)
def _fit_shape(
    made_for: Side,
    tip: Side,
    axis: Side,
    limits: CornerLimits,
    shapes: CornerShapes,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> Fit:
    """Fill the kernel made for one side's corner, scaled until both hold what they must."""
    pair, most = made_for.pair, made_for.limits
    rate = max(pair.first, pair.second)
    # More than this is not reached on the way from full speed on one segment to full speed back.
    acceleration = min(most.acceleration, math.sqrt(2.0 * limits.segment_speed * rate * most.jerk))
    tolerance = made_for.tolerance * most.jerk**2 / acceleration**3
    shape = gone.reshape(gone.size)
    speed = limits.segment_speed * rate * most.jerk / acceleration**2
    read_shape(shapes, math.acos(pair.cosine), tolerance, speed, shape)
    spread_shape(
        shape,
        max(pair.sine, 1e-9) if pair.cosine > 0.0 else 1.0,
        acceleration / most.jerk,
        acceleration / rate,
        durations,
        remaining,
    )
    figures = CornerFigures(*integrate_knots(durations, remaining, gone))
    figures, axis_binds = fit_limits(tip, axis, limits, figures, durations, remaining, gone)
    off = share_used(axis, figures, durations, remaining, gone)
    if off > 1.0:
        # Grown, the axis bends a little more. Smaller with the same jerk: all other limits hold the more.
        figures = scaled(figures, 1.0 / off, off ** (-1.0 / 3.0), durations, remaining, gone)
    return Fit(figures, axis_binds)
