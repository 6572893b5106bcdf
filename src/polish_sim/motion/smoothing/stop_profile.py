"""The fastest way from rest to rest within speed, acceleration and jerk: a filtered box too (length -> three times)."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, error_model="numpy")
def stop_times(length: float, speed: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """Filter times of the time-optimal rest-to-rest motion.

    The shortest profile is a three-box profile a >= b + c: c = acceleration / jerk; or c = b = cbrt(length / 2 jerk)
    and a = 2 c, 4 cbrt(length / 2 jerk) in all, where neither acceleration nor speed is reached.

    Args:
        length: Way to go, positive; its unit is the caller's (u).
        speed: Limit [u/s].
        acceleration: Limit [u/s^2].
        jerk: Limit [u/s^3]; limits may be infinite.

    Returns:
        The times a >= b >= c [s]; the motion takes their sum.
    """
    ramp = c = 0.0
    if math.isfinite(jerk):
        ramp = acceleration / jerk
        c = min(ramp, math.sqrt(speed / jerk), (0.5 * length / jerk) ** (1.0 / 3.0))
    b = c
    if c == ramp:
        b = max(c, min(speed / acceleration, 0.5 * (math.sqrt(c * c + 4.0 * length / acceleration) - c)))
    return max(length / speed, b + c), b, c
