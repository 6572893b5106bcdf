"""Corner kernels: how a corner is rounded, nearly as fast as tip and axis may (layer 6).

A kernel takes the last ``size`` of the old segment and the first of the new one. a(t) is what is left of the old, b(t)
what is gone on the new one: ``a(0) = h, a'(0) = -v, a''(0) = alpha``, all zero at the end, ``b(t) = a(T - t)``; jerk is
constant in each of ``PIECES`` pieces. Both go slightly below zero: swinging outwards first is what makes it fast.
A shape is read from a table (corner_shapes) and scaled in size and time until limits and tolerances hold, proven
(corner_bounds).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.certified.corner_bounds import (
    Pair,
    Peaks,
    bound_deviation,
    distance_from_vertex,
    measure_peaks,
    pair_of,
)
from polish_sim.motion.certified.corner_pieces import integrate_knots, scale_pieces, set_knot, spread_shape
from polish_sim.motion.certified.corner_shapes import HALF, PIECES, CornerShapes, corner_shapes, read_shape

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

VERTEX_SHARE = 2.0
"""How many tolerances a corner's vertex may be missed by; binds beyond turns of 120 deg, where staying close to the
polyline alone would let the tip of a spike be cut off."""
FAR = (1e30, 1e30)
"""Generalised lengths of segments whose other ends do not matter [m]."""
ROUNDING = 1.0 - 1e-12
"""Kept from limits and tolerances for rounding."""


class CornerWeights(NamedTuple):
    """What tip and axis do per generalised length on both sides: Gram numbers of two pairs of vectors."""

    tip_11: float
    """(L1 / l1)^2."""
    tip_22: float
    """(L2 / l2)^2."""
    tip_12: float
    """Scalar product of the tip's two rates."""
    axis_1: float
    """theta1 / l1 [rad/m]."""
    axis_2: float
    """theta2 / l2 [rad/m]."""
    axis_cosine: float
    """n1 . n2 at the corner."""
    spans: tuple[float, float]
    """Generalised lengths of both segments [m]: a short one has another end near."""


class CornerLimits(NamedTuple):
    """What the kernel may do; infinite where there is no limit."""

    speed: float
    """Of the tip [m/s]."""
    acceleration: float
    """[m/s^2]."""
    jerk: float
    """[m/s^3]."""
    tip_tolerance: float
    """[m]."""
    axis_speed: float
    """[rad/s]."""
    axis_acceleration: float
    """[rad/s^2]."""
    axis_jerk: float
    """[rad/s^3]."""
    axis_tolerance: float
    """[rad]."""
    segment_speed: float
    """The smaller one of both segments', along generalised length [m/s]."""
    segment_acceleration: float
    """For the runs that lead here and away [m/s^2]."""
    segment_jerk: float
    """[m/s^3]."""


class CornerFigures(NamedTuple):
    """A kernel from outside."""

    size: float
    """Of either segment [m of generalised length]."""
    speed: float
    """At both ends [m/s]."""
    acceleration: float
    """Slowing down at the beginning, speeding up at the end [m/s^2], at least 0."""
    duration: float
    """[s]."""


class _Side(NamedTuple):
    """Tip or axis at a corner, with its limits."""

    pair: Pair
    limits: Peaks
    tolerance: float
    bends: bool


class _Fit(NamedTuple):
    """A scaled kernel, and whether it was the axis that asked for it."""

    figures: CornerFigures
    axis_binds: bool


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
    tip, axis = _tip_side(weights, limits, FAR), _axis_side(weights, limits, FAR)
    top = min(limits.segment_speed, _top_speed(tip), _top_speed(axis))
    if _goes_straight(tip) and _goes_straight(axis):
        return _nothing(top, durations, remaining, gone)
    if limits.tip_tolerance <= 0.0 or limits.axis_tolerance <= 0.0:
        return _nothing(0.0, durations, remaining, gone)
    passing, figures = _pass_through(tip, axis, top, durations, remaining, gone)
    if not passing:
        figures = _best_shape(tip, axis, limits, shapes, durations, remaining, gone)
    return _fit_ends(weights, limits, figures, durations, remaining, gone)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _tip_side(weights: CornerWeights, limits: CornerLimits, spans: tuple[float, float]) -> _Side:
    """The tip, on segments of these generalised lengths."""
    first, second = math.sqrt(weights.tip_11), math.sqrt(weights.tip_22)
    cosine = weights.tip_12 / max(first * second, 1e-300)
    return _Side(
        pair_of(first, second, cosine, spans),
        Peaks(limits.speed, limits.acceleration, limits.jerk),
        limits.tip_tolerance * ROUNDING,
        False,
    )


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _axis_side(weights: CornerWeights, limits: CornerLimits, spans: tuple[float, float]) -> _Side:
    """The tool's axis."""
    return _Side(
        pair_of(weights.axis_1, weights.axis_2, weights.axis_cosine, spans),
        Peaks(limits.axis_speed, limits.axis_acceleration, limits.axis_jerk),
        limits.axis_tolerance * ROUNDING,
        True,
    )


@njit(cache=True, error_model="numpy", _nrt=False)
def _fit_ends(
    weights: CornerWeights,
    limits: CornerLimits,
    figures: CornerFigures,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> CornerFigures:
    """Shrink a kernel until it stays beside its two segments, which may be short, and not just beside their lines."""
    spans = weights.spans
    length = min(spans[0], spans[1]) / figures.size if figures.size > 0.0 else 1.0
    if length < 1.0:
        figures = _scaled(figures, length, length ** (1.0 / 3.0), durations, remaining, gone)
    tip, axis = _tip_side(weights, limits, spans), _axis_side(weights, limits, spans)
    off = max(
        _share_used(tip, figures, durations, remaining, gone), _share_used(axis, figures, durations, remaining, gone)
    )
    if off > 1.0:
        # What is past an end falls faster than the kernel.
        figures = _scaled(figures, 1.0 / off, off ** (-1.0 / 3.0), durations, remaining, gone)
    return figures


@njit(cache=True, error_model="numpy", _nrt=False)
def time_lost(figures: CornerFigures, limits: CornerLimits) -> float:
    """Time lost at a corner against passing it at full speed, on segments long enough to reach it [s]."""
    top, most, jerk = limits.segment_speed, limits.segment_acceleration, limits.segment_jerk
    v, alpha = figures.speed, figures.acceleration
    peak = max(min(most, math.sqrt(max(jerk * (top - v) + 0.5 * alpha * alpha, 0.0))), alpha)
    rise, fall = (peak - alpha) / jerk, peak / jerk
    after_rise = v + 0.5 * (peak * peak - alpha * alpha) / jerk
    hold = max(top - 0.5 * peak * fall - after_rise, 0.0) / peak if peak > 0.0 else 0.0
    after_hold = after_rise + peak * hold
    way = rise * (v + rise * (0.5 * alpha + jerk * rise / 6.0)) + hold * (after_rise + 0.5 * peak * hold)
    way += fall * (after_hold + fall * (0.5 * peak - jerk * fall / 6.0))
    return figures.duration + 2.0 * (rise + hold + fall) - 2.0 * (figures.size + way) / top


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _goes_straight(side: _Side) -> bool:
    """Whether nothing changes at the corner."""
    pair = side.pair
    return pair.first == pair.second and (pair.first == 0.0 or pair.cosine == 1.0)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _top_speed(side: _Side) -> float:
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
    tip: _Side, axis: _Side, speed: float, durations: Array, remaining: Array, gone: Array
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
        _share_used(tip, figures, durations, remaining, gone), _share_used(axis, figures, durations, remaining, gone)
    )
    return off <= 1.0, CornerFigures(figures.size, min(figures.speed, speed), 0.0, figures.duration)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _triangle_time(side: _Side, speed: float) -> float:
    """Half the time of a triangle of acceleration that turns the side's velocity round, within its limits [s]."""
    pair = side.pair
    change = speed * math.sqrt((pair.first - pair.second) ** 2 + 2.0 * pair.first * pair.second * (1.0 - pair.cosine))
    return max(math.sqrt(change / (side.limits.jerk * ROUNDING)), change / (side.limits.acceleration * ROUNDING))


@njit(cache=True, error_model="numpy", _nrt=False)
def _best_shape(
    tip: _Side,
    axis: _Side,
    limits: CornerLimits,
    shapes: CornerShapes,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> CornerFigures:
    """Fill the better one of the kernels made for the tip's corner and for the axis's."""
    if not _counts(tip):
        made_for = axis if _counts(axis) else _right_angle(limits)
        return _fit_shape(made_for, tip, axis, limits, shapes, durations, remaining, gone).figures
    fit = _fit_shape(tip, tip, axis, limits, shapes, durations, remaining, gone)
    if not (fit.axis_binds and _counts(axis)):
        return fit.figures
    other = _fit_shape(axis, tip, axis, limits, shapes, durations, remaining, gone)
    if time_lost(other.figures, limits) < time_lost(fit.figures, limits):
        return other.figures
    return _fit_shape(tip, tip, axis, limits, shapes, durations, remaining, gone).figures


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _right_angle(limits: CornerLimits) -> _Side:
    """A corner that stands in where tip and axis take turns: each only stops or sets off, nothing leaves its line."""
    most = Peaks(limits.segment_speed, limits.segment_acceleration, limits.segment_jerk)
    return _Side(Pair(1.0, 1.0, 0.0, 1.0, *FAR), most, most.acceleration**3 / most.jerk**2, False)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _counts(side: _Side) -> bool:
    """Whether a side has a corner to make a shape for."""
    return side.pair.first > 0.0 and side.pair.second > 0.0 and side.pair.cosine < 1.0


@njit(cache=True, error_model="numpy", _nrt=False)
def _fit_shape(
    made_for: _Side,
    tip: _Side,
    axis: _Side,
    limits: CornerLimits,
    shapes: CornerShapes,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> _Fit:
    """Fill the kernel made for one side's corner, scaled until both hold what they must."""
    pair, most = made_for.pair, made_for.limits
    rate = max(pair.first, pair.second)
    tolerance = made_for.tolerance * most.jerk**2 / most.acceleration**3
    shape = gone.reshape(gone.size)
    speed = limits.segment_speed * rate * most.jerk / most.acceleration**2
    read_shape(shapes, math.acos(pair.cosine), tolerance, speed, shape)
    spread_shape(
        shape,
        max(pair.sine, 1e-9) if pair.cosine > 0.0 else 1.0,
        most.acceleration / most.jerk,
        most.acceleration / rate,
        durations,
        remaining,
    )
    figures = CornerFigures(*integrate_knots(durations, remaining, gone))
    figures, axis_binds = _fit_limits(tip, axis, limits, figures, durations, remaining, gone)
    off = _share_used(axis, figures, durations, remaining, gone)
    if off > 1.0:
        # Grown, the axis bends a little more. Smaller with the same jerk: all other limits hold the more.
        figures = _scaled(figures, 1.0 / off, off ** (-1.0 / 3.0), durations, remaining, gone)
    return _Fit(figures, axis_binds)


@njit(cache=True, error_model="numpy", _nrt=False)
def _fit_limits(
    tip: _Side,
    axis: _Side,
    limits: CornerLimits,
    figures: CornerFigures,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> _Fit:
    """Scale a kernel to full jerk, as large as speeds and tolerances allow, as slow as accelerations ask for."""
    one = _asked(tip, durations, remaining, gone)
    two = _asked(axis, durations, remaining, gone)
    off_tip = _share_used(tip, figures, durations, remaining, gone)
    off_axis = _share_used(axis, figures, durations, remaining, gone)
    axis_binds = (
        off_axis > off_tip or two.speed > one.speed or two.acceleration > one.acceleration or two.jerk > one.jerk
    )
    along = figures.acceleration / limits.segment_acceleration
    acceleration = max(one.acceleration, two.acceleration, along) / ROUNDING
    jerk = max(one.jerk, two.jerk) / ROUNDING
    root = jerk ** (1.0 / 3.0)
    top = figures.speed / root + 0.5 * figures.acceleration**2 / limits.segment_jerk / root**4
    # Speeds grow with length^(2/3) at full jerk.
    share = max(top / limits.segment_speed, one.speed / root, two.speed / root) / ROUNDING
    length = min(share**-1.5, 1.0 / max(off_tip, off_axis))
    time = max(root * length ** (1.0 / 3.0), math.sqrt(length * acceleration))
    return _Fit(_scaled(figures, length, time, durations, remaining, gone), axis_binds)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _asked(side: _Side, durations: Array, remaining: Array, gone: Array) -> Peaks:
    """Peaks of a kernel on one side as shares of its limits."""
    peaks, most = measure_peaks(side.pair, durations, remaining, gone), side.limits
    return Peaks(peaks.speed / most.speed, peaks.acceleration / most.acceleration, peaks.jerk / most.jerk)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _scaled(
    figures: CornerFigures, length: float, time: float, durations: Array, remaining: Array, gone: Array
) -> CornerFigures:
    """Scale pieces and figures."""
    scale_pieces(durations, remaining, gone, length, time)
    return CornerFigures(
        figures.size * length,
        figures.speed * length / time,
        figures.acceleration * length / (time * time),
        figures.duration * time,
    )


@njit(cache=True, error_model="numpy", _nrt=False)
def _share_used(side: _Side, figures: CornerFigures, durations: Array, remaining: Array, gone: Array) -> float:
    """Share of a side's tolerance that a kernel uses, at most; a smaller one of its kind uses less."""
    angle = 1.2 * figures.size * max(side.pair.first, side.pair.second) if side.bends else 0.0
    deviation = bound_deviation(side.pair, 3.0 * angle**3, durations, remaining, gone)
    missed = distance_from_vertex(side.pair, remaining, gone) / VERTEX_SHARE
    return max(deviation, missed) * (1.0 + angle * angle) / side.tolerance
