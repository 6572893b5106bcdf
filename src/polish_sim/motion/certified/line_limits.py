"""Speed, acceleration and jerk along one segment that keep tip and axis within their limits (layer 6)."""

from __future__ import annotations

import math

from numba import njit

from polish_sim.motion.certified.buffers import Segments
from polish_sim.motion.smoothing.limits import LimitValues

FASTEST, SHARPEST = 1e3, 1e9
"""Stand-ins for infinite limits [m/s, m/s^3]."""


@njit(cache=True, error_model="numpy")
def axis_radius(limits: LimitValues) -> float:
    """Tip length that takes as long as a turn of the axis by one radian, at full speed [m]."""
    if math.isinf(limits.axis_speed) or math.isinf(limits.tip_speed):
        return 1.0
    return limits.tip_speed / limits.axis_speed


@njit(cache=True, error_model="numpy")
def fill_tool_limits(segments: Segments, k: int, limits: LimitValues) -> None:
    """Write generalised length and limits along it of a segment, as tip and tool axis allow."""
    chain = segments.chain
    turn = max(chain.angles[k], abs(chain.rolls[k]))
    span = max(chain.lengths[k], turn * axis_radius(limits))
    tip, axis = chain.lengths[k] / span, chain.angles[k] / span
    segments.spans[k] = span
    speed = min(_over(limits.tip_speed, tip), _over(limits.axis_speed, axis), FASTEST)
    acceleration = min(_over(limits.tip_acceleration, tip), _over(limits.axis_acceleration, axis))
    jerk = min(_over(limits.tip_jerk, tip), _over(limits.axis_jerk, axis), SHARPEST)
    segments.limits[k, 0] = speed
    # More than this is never reached on the way to full speed.
    segments.limits[k, 1] = min(acceleration, math.sqrt(speed * jerk))
    segments.limits[k, 2] = jerk


@njit(cache=True, error_model="numpy", forceinline=True)
def _over(limit: float, share: float) -> float:
    return limit / share if share > 0.0 else math.inf
