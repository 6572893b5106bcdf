"""The search behind `deviation`: every cubic span sampled, local extremes refined by golden section (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.polyline import axis_distance, tip_distance
from polish_sim.motion.smoothing.sampling import ScheduleIndex, axis_between, tip_between
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SAMPLES = 12
"""Of each cubic span, and of each overlap of two segments."""
LONG_SAMPLES = 64
"""Of two whole segments."""
GOLDEN = 0.6180339887498949
STEPS = 50
"""Of the golden section: a bracket shrinks by 4e-11."""


@njit(cache=True, error_model="numpy", _nrt=False)
def scan_spans(
    chain: Chain,
    schedule: Schedule,
    index: ScheduleIndex,
    raw: Chain,
    places: Indices,
    knots: Array,
    worst: Array,
    room: Array,
) -> None:
    """Find where the tip strays furthest from the raw polyline, and the axis from its arcs.

    Args:
        chain: Segments the schedule passes.
        schedule: When.
        index: Of the schedule.
        raw: The way points as given.
        places: Number of each of the chain's way points among the raw ones, shape (n + 1,).
        knots: Ends of all pieces, rising [s].
        worst: Written: rows tip, axis; columns value, time, shape (2, 2).
        room: To work in, shape (3, 16).
    """
    values = room[2]
    for span in range(knots.shape[0] - 1):
        begin, step = knots[span], (knots[span + 1] - knots[span]) / SAMPLES
        middle = begin + 0.5 * SAMPLES * step
        early = np.searchsorted(index.all_ended, middle, side="right")
        late = np.searchsorted(index.none_begun, middle, side="right")
        if late <= early or places[late] - places[early] == 1:  # at rest, or alone on a segment of the raw chain
            continue
        for row in range(2):
            for i in range(SAMPLES + 1):
                values[i] = _stray(chain, schedule, index, raw, places, early, late, row, begin + i * step, room)
            for i in range(SAMPLES + 1):
                before, after = max(i - 1, 0), min(i + 1, SAMPLES)
                rise = max(values[i] - values[before], values[i] - values[after])
                if values[i] < values[before] or values[i] < values[after] or values[i] + rise <= worst[row, 0]:
                    continue
                low, high = begin + before * step, begin + after * step
                _refine(chain, schedule, index, raw, places, early, late, row, low, high, room, worst[row])


@njit(cache=True, error_model="numpy")
def _stray(
    chain: Chain,
    schedule: Schedule,
    index: ScheduleIndex,
    raw: Chain,
    places: Indices,
    early: int,
    late: int,
    row: int,
    time: float,
    room: Array,
) -> float:
    """Distance of the tip (row 0) or the axis (row 1) at a time at which segments early to late - 1 are under way."""
    if row == 0:
        tip_between(chain, schedule, index, early, late, time, room[0, :3], room[1])
        return float(tip_distance(raw, places[early], places[late], room[0, :3]))
    axis_between(chain, schedule, index, early, late, time, room[0, :3], room[1])
    return float(axis_distance(raw, places[early], places[late], room[0, :3]))


@njit(cache=True, error_model="numpy")
def _refine(
    chain: Chain,
    schedule: Schedule,
    index: ScheduleIndex,
    raw: Chain,
    places: Indices,
    early: int,
    late: int,
    row: int,
    low: float,
    high: float,
    room: Array,
    worst: Array,
) -> None:
    """Largest value between two times by golden section; ``worst`` (value, time) is written where it is surpassed."""
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left = _stray(chain, schedule, index, raw, places, early, late, row, left, room)
    at_right = _stray(chain, schedule, index, raw, places, early, late, row, right, room)
    for _ in range(STEPS):
        if max(at_left, at_right) > worst[0]:
            worst[0], worst[1] = max(at_left, at_right), left if at_left > at_right else right
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = _stray(chain, schedule, index, raw, places, early, late, row, left, room)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = _stray(chain, schedule, index, raw, places, early, late, row, right, room)


@njit(cache=True, error_model="numpy", _nrt=False)
def least_distances(
    chain: Chain,
    schedule: Schedule,
    index: ScheduleIndex,
    raw: Chain,
    places: Indices,
    distances: Array,
    times: Array,
    room: Array,
) -> None:
    """Find the distance of every raw way point from the tip's trajectory.

    Args:
        chain: Segments the schedule passes.
        schedule: When.
        index: Of the schedule.
        raw: The way points as given.
        places: Number of each of the chain's way points among the raw ones, shape (n + 1,).
        distances: Written [m], shape (m,); zeros before.
        times: Written: when it is least [s], shape (m,).
        room: To work in, shape (3, 16).
    """
    k = 0
    for r in range(1, raw.tips.shape[0] - 1):
        while places[k + 1] < r:
            k += 1
        later = k + 1 if places[k + 1] == r else k  # a corner of the chain belongs to two segments
        begin, end = index.none_begun[k], index.all_ended[later]
        if later > k and index.none_begun[later] >= index.all_ended[k]:  # a stop at the way point
            times[r] = index.all_ended[k]
            continue
        distances[r], times[r] = _least(chain, schedule, index, raw.tips[r], begin, end, LONG_SAMPLES, room)
        if later > k:
            begin, end = index.none_begun[later], index.all_ended[k]
            value, time = _least(chain, schedule, index, raw.tips[r], begin, end, SAMPLES, room)
            if value < distances[r]:
                distances[r], times[r] = value, time


@njit(cache=True, error_model="numpy")
def _least(
    chain: Chain,
    schedule: Schedule,
    index: ScheduleIndex,
    point: Array,
    begin: float,
    end: float,
    count: int,
    room: Array,
) -> tuple[float, float]:
    """Least distance of the tip from a point between two times, and when."""
    early = np.searchsorted(index.all_ended, begin, side="right")
    late = np.searchsorted(index.none_begun, end, side="right")
    step, best, at = (end - begin) / count, np.inf, begin
    for i in range(count + 1):
        value = _away(chain, schedule, index, point, early, late, begin + i * step, room)
        if value < best:
            best, at = value, begin + i * step
    low, high = max(at - step, begin), min(at + step, end)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left = _away(chain, schedule, index, point, early, late, left, room)
    at_right = _away(chain, schedule, index, point, early, late, right, room)
    for _ in range(STEPS):
        if min(at_left, at_right) < best:
            best, at = min(at_left, at_right), left if at_left < at_right else right
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = _away(chain, schedule, index, point, early, late, left, room)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = _away(chain, schedule, index, point, early, late, right, room)
    return best, at


@njit(cache=True, error_model="numpy")
def _away(
    chain: Chain,
    schedule: Schedule,
    index: ScheduleIndex,
    point: Array,
    early: int,
    late: int,
    time: float,
    room: Array,
) -> float:
    tip_between(chain, schedule, index, early, late, time, room[0, :3], room[1])
    x, y, z = room[0, 0] - point[0], room[0, 1] - point[1], room[0, 2] - point[2]
    return math.sqrt(x * x + y * y + z * z)
