"""The straight run between two corners: fastest jerk-limited motion along one line.

A corner is left with speed v0 and acceleration a0 >= 0, the next one is entered with speed v1 and acceleration
-a1 <= 0. In between speed rises to one peak, stays there and falls. Either side is a piece of a rise from rest in
acceleration (v0 - a0^2/2J, 0) to (peak, 0), so time and distance have short closed forms.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit

CONNECTOR_PIECES = 7  #: Most pieces of constant jerk a connector has: up, hold, off; cruise; off, hold, down
_STEPS = 60  #: More bisections than a float has bits; Newton's method needs about five
_PRECISION = 1e-10  #: The peak speed is found to this share of itself


class Peaks(NamedTuple):
    """Largest speed, acceleration and jerk, of a motion or allowed: along a line, of tip, axis or joints."""

    speed: float  #: [m/s] or [rad/s]
    acceleration: float
    jerk: float


class Ends(NamedTuple):
    """How a connector begins and ends; no value is negative."""

    v0: float  #: Speed at its start [m/s]
    a0: float  #: Acceleration at its start [m/s^2]
    v1: float  #: Speed at its end [m/s]
    a1: float  #: Deceleration at its end [m/s^2]


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def rise_time(gain: float, limits: Peaks) -> float:
    """Least time to gain speed from acceleration 0 to acceleration 0 [s]."""
    a, j = limits.acceleration, limits.jerk
    if gain * j <= a * a:
        return 2.0 * math.sqrt(max(gain, 0.0) / j)
    return gain / a + a / j


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def rise_distance(v: float, a: float, peak: float, limits: Peaks) -> float:
    """Distance from speed ``v`` and acceleration ``a`` up to the peak [m]."""
    before = a / limits.jerk
    low = v - 0.5 * a * before
    whole = 0.5 * (low + peak) * rise_time(peak - low, limits)
    return whole - before * (low + limits.jerk * before * before / 6.0)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _distance_slope(v: float, a: float, peak: float, limits: Peaks) -> float:
    """Derivative of `rise_distance` to the peak [s]."""
    low = v - 0.5 * a * a / limits.jerk
    gain = peak - low
    if gain * limits.jerk <= limits.acceleration**2:
        root = math.sqrt(max(gain, 1e-300) / limits.jerk)
        return root + 0.5 * (low + peak) / (limits.jerk * root)
    time = gain / limits.acceleration + limits.acceleration / limits.jerk
    return 0.5 * time + 0.5 * (low + peak) / limits.acceleration


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def least_peak(ends: Ends, limits: Peaks) -> float:
    """Speed reached in any case while the acceleration of either end fades out [m/s]."""
    first = ends.v0 + 0.5 * ends.a0**2 / limits.jerk
    return max(first, ends.v1 + 0.5 * ends.a1**2 / limits.jerk)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _distance_at(ends: Ends, peak: float, limits: Peaks) -> float:
    """Distance of rise and fall together, without cruising [m]; grows with the peak."""
    return rise_distance(ends.v0, ends.a0, peak, limits) + rise_distance(ends.v1, ends.a1, peak, limits)


@njit(cache=True, error_model="numpy", _nrt=False)
def least_distance(ends: Ends, limits: Peaks) -> float:
    """Least distance from one end's speed to the other's [m]."""
    return _distance_at(ends, least_peak(ends, limits), limits)


@njit(cache=True, error_model="numpy", _nrt=False)
def connect(ends: Ends, distance: float, limits: Peaks) -> tuple[float, float]:
    """Peak speed of the fastest connector over a distance [m], NaN if it is too short, and how long that is kept [s].

    Both ends are within the limits, also once their acceleration has faded out.
    """
    low, high = least_peak(ends, limits), limits.speed
    nearest = _distance_at(ends, low, limits)
    if nearest >= distance:
        # A distance that just fits may differ from the least one by rounding.
        fits = nearest <= distance * (1.0 + 1e-12)
        return low if fits else math.nan, 0.0
    if low >= high:
        return low, (distance - nearest) / low
    farthest = _distance_at(ends, high, limits)
    if farthest <= distance:
        return high, (distance - farthest) / high
    lowest, peak = low, high
    for _ in range(_STEPS):
        excess = _distance_at(ends, peak, limits) - distance
        if excess > 0.0:
            high = peak
        else:
            lowest = peak
        slope = _distance_slope(ends.v0, ends.a0, peak, limits) + _distance_slope(ends.v1, ends.a1, peak, limits)
        step = excess / slope
        if abs(step) <= _PRECISION * high or high - lowest <= _PRECISION * high:
            break
        peak -= step
        if not lowest < peak < high:
            peak = 0.5 * (lowest + high)
    # On the safe side; what rounding leaves of the distance is cruised.
    peak = max(peak * (1.0 - 4.0 * _PRECISION), lowest)
    rest = distance - _distance_at(ends, peak, limits)
    return peak, max(rest, 0.0) / peak if peak > 0.0 else 0.0


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def connector_time(ends: Ends, distance: float, limits: Peaks) -> float:
    """Least time over a distance [s]; infinite if the distance is too short."""
    peak, cruise = connect(ends, distance, limits)
    if math.isnan(peak):
        return math.inf
    rise = rise_time(peak - ends.v0 + 0.5 * ends.a0**2 / limits.jerk, limits) - ends.a0 / limits.jerk
    fall = rise_time(peak - ends.v1 + 0.5 * ends.a1**2 / limits.jerk, limits) - ends.a1 / limits.jerk
    return rise + cruise + fall


@njit(cache=True, error_model="numpy", _nrt=False)
def fill_connector(ends: Ends, distance: float, limits: Peaks, durations: Array, jerks: Array) -> None:
    """Write durations [s] and jerks [m/s^3] of the fastest connector: jerk up, hold, off; cruise; off, hold, down."""
    peak, cruise = connect(ends, distance, limits)
    _fill_rise(ends.v0, ends.a0, peak, limits, durations, 0, 1)
    durations[3], jerks[3] = cruise, 0.0
    _fill_rise(ends.v1, ends.a1, peak, limits, durations, 6, -1)
    jerks[0], jerks[1], jerks[2] = limits.jerk, 0.0, -limits.jerk
    jerks[4], jerks[5], jerks[6] = -limits.jerk, 0.0, limits.jerk


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _fill_rise(v: float, a: float, peak: float, limits: Peaks, durations: Array, first: int, step: int) -> None:
    """Write the three durations of a rise from ``v`` and ``a`` to the peak, from place ``first`` on by ``step``."""
    gain = max(peak - v + 0.5 * a * a / limits.jerk, 0.0)
    top = max(min(math.sqrt(gain * limits.jerk), limits.acceleration), a)
    durations[first] = (top - a) / limits.jerk
    durations[first + step] = max(gain / top - top / limits.jerk, 0.0) if top > 0.0 else 0.0
    durations[first + 2 * step] = top / limits.jerk
