"""What a corner's kernel costs in time (layer 6)."""

from __future__ import annotations

import math

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.connector import Ends, LineLimits, connect, connector_time
from polish_sim.motion.certified.corner_task import CornerFigures, CornerLimits, CornerWeights

_SCALES = 5
"""Sizes a kernel is tried in."""


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
def _runs(limits: CornerLimits) -> LineLimits:
    """Limits of the runs that lead to the corner and away."""
    return LineLimits(limits.segment_speed, limits.segment_acceleration, limits.segment_jerk)


@njit(cache=True, error_model="numpy", _nrt=False)
def passing_time(figures: CornerFigures, limits: CornerLimits, spans: tuple[float, float]) -> float:
    """Least time over both segments with the kernel in one of its sizes between them [s].

    What happens at their other ends is not known yet: the mean of coming from rest and of other such kernels there.
    """
    runs, rest, alike = _runs(limits), math.inf, math.inf
    for i in range(_SCALES + 1):
        s = 1.0 - i / _SCALES
        size, v, alpha = figures.size * s**3, figures.speed * s**2, figures.acceleration * s
        if size < min(spans[0], spans[1]):
            time = connector_time(Ends(0.0, 0.0, v, alpha), spans[0] - size, runs) + figures.duration * s
            rest = min(rest, time + connector_time(Ends(v, alpha, 0.0, 0.0), spans[1] - size, runs))
        if 2.0 * size < min(spans[0], spans[1]):
            time = connector_time(Ends(v, alpha, v, alpha), spans[0] - 2.0 * size, runs) + 2.0 * figures.duration * s
            alike = min(alike, time + connector_time(Ends(v, alpha, v, alpha), spans[1] - 2.0 * size, runs))
    return 0.5 * (rest + alike)


@njit(cache=True, error_model="numpy", _nrt=False)
def reached_speed(limits: CornerLimits, spans: tuple[float, float]) -> float:
    """Speed that the shorter segment reaches from rest to rest [m/s]."""
    return connect(Ends(0.0, 0.0, 0.0, 0.0), min(spans[0], spans[1]), _runs(limits)).peak


@njit(cache=True, error_model="numpy", _nrt=False)
def lowered_limits(limits: CornerLimits, weights: CornerWeights, speed: float, harder: float) -> CornerLimits:
    """Limits to make a shape for, such that braking from ``speed`` takes a hold besides its ramps.

    Without a limit of acceleration near, a shape from the table holds all of the braking, and may be much too long.

    Args:
        limits: Of the corner.
        weights: Likewise.
        speed: Along generalised length [m/s].
        harder: Speed jerk / acceleration^2; braking is a ramp up and a ramp down where it is 1.

    Returns:
        The limits with that speed and accelerations as much lower.
    """
    tip = speed * max(math.sqrt(weights.tip_11), math.sqrt(weights.tip_22))
    axis = speed * max(weights.axis_1, weights.axis_2)
    return CornerLimits(
        limits.speed,
        min(limits.acceleration, math.sqrt(tip * limits.jerk / harder)),
        limits.jerk,
        limits.tip_tolerance,
        limits.axis_speed,
        min(limits.axis_acceleration, math.sqrt(axis * limits.axis_jerk / harder)),
        limits.axis_jerk,
        limits.axis_tolerance,
        speed,
        limits.segment_acceleration,
        limits.segment_jerk,
    )
