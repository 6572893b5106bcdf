"""The straight run between two corners: fastest jerk-limited motion along one segment (layer 6).

A corner lets go with speed v0 and acceleration a0 >= 0, the next one takes over at speed v1 and acceleration
-a1 <= 0. In between speed rises to one peak, stays there and falls. Either side is a piece of a rise from rest in
acceleration (v0 - a0^2/2J, 0) to (peak, 0), so time and distance have short closed forms.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

CONNECTOR_PIECES = 7
"""Most pieces of constant jerk a connector has: up, hold, off; cruise; off, hold, down."""
_STEPS = 60
"""More bisections than a float has bits to tell apart; Newton's method needs about five."""
_PRECISION = 1e-10
"""The peak speed is found to this share of itself."""


class Ends(NamedTuple):
    """How a connector begins and ends."""

    v0: float
    """Speed at its start [m/s], at least 0."""
    a0: float
    """Acceleration at its start [m/s^2], at least 0."""
    v1: float
    """Speed at its end [m/s], at least 0."""
    a1: float
    """Deceleration at its end [m/s^2], at least 0."""


class LineLimits(NamedTuple):
    """What is allowed along one segment."""

    speed: float
    """[m/s]."""
    acceleration: float
    """[m/s^2]."""
    jerk: float
    """[m/s^3]."""


class Cruise(NamedTuple):
    """The middle of a connector."""

    peak: float
    """Its highest speed [m/s]; NaN if the distance is too short."""
    duration: float
    """How long that speed is kept [s]."""


@njit(cache=True, error_model="numpy", forceinline=True)
def rise_time(gain: float, limits: LineLimits) -> float:
    """Least time to gain speed from acceleration 0 to acceleration 0 [s]."""
    a, j = limits.acceleration, limits.jerk
    if gain * j <= a * a:
        return 2.0 * math.sqrt(max(gain, 0.0) / j)
    return gain / a + a / j


@njit(cache=True, error_model="numpy", forceinline=True)
def _rise_distance(v: float, a: float, peak: float, limits: LineLimits) -> float:
    """Distance gone from speed ``v`` and acceleration ``a`` up to the peak [m]."""
    before = a / limits.jerk
    low = v - 0.5 * a * before
    whole = 0.5 * (low + peak) * rise_time(peak - low, limits)
    return whole - before * (low + limits.jerk * before * before / 6.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def _distance_slope(v: float, a: float, peak: float, limits: LineLimits) -> float:
    """Derivative of `_rise_distance` to the peak [s]."""
    low = v - 0.5 * a * a / limits.jerk
    gain = peak - low
    if gain * limits.jerk <= limits.acceleration**2:
        root = math.sqrt(max(gain, 1e-300) / limits.jerk)
        return root + 0.5 * (low + peak) / (limits.jerk * root)
    time = gain / limits.acceleration + limits.acceleration / limits.jerk
    return 0.5 * time + 0.5 * (low + peak) / limits.acceleration


@njit(cache=True, error_model="numpy", forceinline=True)
def least_peak(ends: Ends, limits: LineLimits) -> float:
    """Speed that is reached in any case while the acceleration of either end fades out [m/s]."""
    first = ends.v0 + 0.5 * ends.a0**2 / limits.jerk
    return max(first, ends.v1 + 0.5 * ends.a1**2 / limits.jerk)


@njit(cache=True, error_model="numpy", forceinline=True)
def distance_at(ends: Ends, peak: float, limits: LineLimits) -> float:
    """Distance of rise and fall together, without cruising [m]; grows with the peak."""
    return _rise_distance(ends.v0, ends.a0, peak, limits) + _rise_distance(ends.v1, ends.a1, peak, limits)


@njit(cache=True, error_model="numpy")
def least_distance(ends: Ends, limits: LineLimits) -> float:
    """Least distance that leads from one end's speed to the other's [m]."""
    return distance_at(ends, least_peak(ends, limits), limits)


@njit(cache=True, error_model="numpy")
def connect(ends: Ends, distance: float, limits: LineLimits) -> Cruise:
    """Fastest connector over a distance.

    Args:
        ends: How it begins and ends; both within the limits, also once their acceleration has faded out.
        distance: What it covers [m].
        limits: Of the segment.

    Returns:
        Its peak and cruise; the peak is NaN if the distance is too short.
    """
    low, high = least_peak(ends, limits), limits.speed
    nearest = distance_at(ends, low, limits)
    if nearest >= distance:
        # Rounding may not tell a distance that just fits from one that does not.
        fits = nearest <= distance * (1.0 + 1e-12)
        return Cruise(low if fits else math.nan, 0.0)
    if low >= high:
        return Cruise(low, (distance - nearest) / low)
    farthest = distance_at(ends, high, limits)
    if farthest <= distance:
        return Cruise(high, (distance - farthest) / high)
    peak = high
    for _ in range(_STEPS):
        excess = distance_at(ends, peak, limits) - distance
        if excess > 0.0:
            high = peak
        else:
            low = peak
        slope = _distance_slope(ends.v0, ends.a0, peak, limits) + _distance_slope(ends.v1, ends.a1, peak, limits)
        step = excess / slope
        if abs(step) <= _PRECISION * high or high - low <= _PRECISION * high:
            break
        peak -= step
        if not low < peak < high:
            peak = 0.5 * (low + high)
    return _settled(ends, peak, low, distance, limits)


@njit(cache=True, error_model="numpy", forceinline=True)
def _settled(ends: Ends, peak: float, low: float, distance: float, limits: LineLimits) -> Cruise:
    """The peak on its safe side; what rounding leaves of the distance is cruised."""
    peak = max(peak * (1.0 - 4.0 * _PRECISION), low)
    rest = distance - distance_at(ends, peak, limits)
    return Cruise(peak, max(rest, 0.0) / peak if peak > 0.0 else 0.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def connector_time(ends: Ends, distance: float, limits: LineLimits) -> float:
    """Least time over a distance [s]; infinite if the distance is too short."""
    cruise = connect(ends, distance, limits)
    if math.isnan(cruise.peak):
        return math.inf
    rise = rise_time(cruise.peak - ends.v0 + 0.5 * ends.a0**2 / limits.jerk, limits) - ends.a0 / limits.jerk
    fall = rise_time(cruise.peak - ends.v1 + 0.5 * ends.a1**2 / limits.jerk, limits) - ends.a1 / limits.jerk
    return rise + cruise.duration + fall


@njit(cache=True, error_model="numpy")
def fill_connector(ends: Ends, cruise: Cruise, limits: LineLimits, durations: Array, jerks: Array) -> None:
    """Write the pieces of a connector: jerk up, hold, off; cruise; off, hold, down.

    Args:
        ends: As given to `connect`.
        cruise: Its answer.
        limits: Of the segment.
        durations: Filled with the pieces' durations, zeros included [s], shape (CONNECTOR_PIECES,).
        jerks: Filled with their jerks [m/s^3], shape (CONNECTOR_PIECES,).
    """
    _fill_rise(ends.v0, ends.a0, cruise.peak, limits, durations, 0, 1)
    durations[3], jerks[3] = cruise.duration, 0.0
    _fill_rise(ends.v1, ends.a1, cruise.peak, limits, durations, 6, -1)
    jerks[0], jerks[1], jerks[2] = limits.jerk, 0.0, -limits.jerk
    jerks[4], jerks[5], jerks[6] = -limits.jerk, 0.0, limits.jerk


@njit(cache=True, error_model="numpy", forceinline=True)
def _fill_rise(v: float, a: float, peak: float, limits: LineLimits, durations: Array, first: int, step: int) -> None:
    """Write the three durations of a rise from ``v`` and ``a`` to the peak, from place ``first`` on by ``step``."""
    gain = max(peak - v + 0.5 * a * a / limits.jerk, 0.0)
    top = max(min(math.sqrt(gain * limits.jerk), limits.acceleration), a)
    durations[first] = (top - a) / limits.jerk
    durations[first + step] = max(gain / top - top / limits.jerk, 0.0) if top > 0.0 else 0.0
    durations[first + 2 * step] = top / limits.jerk
