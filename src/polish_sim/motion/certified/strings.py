"""Which segments are strung into one line, and what may be done along it (layer 6)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.bends import LINE_SHARE
from polish_sim.motion.certified.buffers import MOST_STRUNG, Lines, Segments
from polish_sim.motion.certified.connector import Ends, LineLimits, connector_time

Array = NDArray[np.float64]

_NEAR_FULL = 0.9
"""A bend passed at this share of full speed does not hold a line up."""
_OVER_STOPS = 1.5
"""Else it must be passed at so many times the mean speed from stop to stop on either side."""


@njit(cache=True, error_model="numpy")
def segment_line(segments: Segments, k: int) -> LineLimits:
    """Limits along one segment."""
    return LineLimits(segments.limits[k, 0], segments.limits[k, 1], segments.limits[k, 2])


@njit(cache=True, error_model="numpy")
def braking_way(limits: LineLimits) -> float:
    """Distance from full speed to rest [m]."""
    v, a, j = limits.speed, limits.acceleration, limits.jerk
    return v * math.sqrt(v / j) if v * j <= a * a else 0.5 * v * (v / a + a / j)


@njit(cache=True, error_model="numpy")
def may_string(segments: Segments, lines: Lines, line: int, k: int) -> bool:
    """Whether segment ``k`` goes on the open line: a short one on either side, and a bend that holds nothing up."""
    first = lines.first[line]
    if k - first >= MOST_STRUNG or segments.bends[k, 1] <= 0.0:
        return False
    old, new, bend = segment_line(segments, k - 1), segment_line(segments, k), segments.bends[k, 1]
    full = min(old.speed, new.speed)
    if min(segments.spans[k - 1], segments.spans[k]) > 2.0 * braking_way(old):
        return False
    speed, lowest = lines.limits[line, 0], min(bend, new.speed)
    # A line has one speed: only alike parts are strung; its first bend sets it.
    if not _alike(new.speed, old.speed) or (k - first > 1 and not _alike(lowest, speed)):
        return False
    if bend >= _NEAR_FULL * full:
        return True
    return bend > _OVER_STOPS * max(_mean_speed(segments, k - 1), _mean_speed(segments, k))


@njit(cache=True, error_model="numpy")
def _alike(first: float, second: float) -> bool:
    return min(first, second) >= _NEAR_FULL * max(first, second)


@njit(cache=True, error_model="numpy")
def _mean_speed(segments: Segments, k: int) -> float:
    """From stop to stop [m/s]."""
    span = segments.spans[k]
    return span / connector_time(Ends(0.0, 0.0, 0.0, 0.0), span, segment_line(segments, k))


@njit(cache=True, error_model="numpy")
def open_line(segments: Segments, lines: Lines, line: int, k: int) -> None:
    """Begin a line with segment ``k``."""
    lines.first[line] = k
    lines.spans[line] = segments.spans[k]
    for c in range(6):
        lines.limits[line, c] = segments.limits[k, c]


@njit(cache=True, error_model="numpy")
def string_segment(segments: Segments, lines: Lines, line: int, k: int) -> None:
    """Go on with a line."""
    lines.spans[line] += segments.spans[k]
    lines.limits[line, 0] = min(lines.limits[line, 0], segments.bends[k, 1])
    for c in range(3):
        lines.limits[line, c] = min(lines.limits[line, c], segments.limits[k, c])


@njit(cache=True, error_model="numpy")
def close_line(segments: Segments, lines: Lines, line: int, last: int) -> None:
    """End a line with segment ``last``."""
    first = lines.first[line]
    lines.first[line + 1] = last + 1
    lines.rooms[line, 0], lines.rooms[line, 1] = segments.spans[first], segments.spans[last]
    if last > first:
        # The other half of an end segment belongs to its bend.
        lines.rooms[line, 0] *= 0.5
        lines.rooms[line, 1] *= 0.5
        lines.limits[line, 1] *= LINE_SHARE
        lines.limits[line, 2] *= LINE_SHARE
        for c in range(3):
            lines.limits[line, 3 + c] = lines.limits[line, c]
