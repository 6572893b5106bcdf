"""How far a smoothed motion strays from its way points, whatever planned it (Chain, Schedule, raw Chain -> Deviation).

Two measures that are often confused are told apart: *contour* is the largest distance of the trajectory from the
polyline, *vertex* the largest distance of a way point from the trajectory. The trajectory is compared with the
stretch of the polyline it is on at that time, so paths that cross themselves are measured right. The search samples
every cubic span and refines its local maxima: exact to rounding where a span has no more than a few of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.errors import SmoothingError
from polish_sim.kernel_cache import njit
from polish_sim.motion.rules.chain import Chain, axis_distance, tip_distance
from polish_sim.motion.rules.schedule import (
    Schedule,
    ScheduleIndex,
    axis_between,
    index_schedule,
    sample_schedule,
    tip_between,
)

# The search behind `deviation`: every cubic span sampled, local extremes refined by golden section (compiled).


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


class Place(NamedTuple):
    """A largest deviation and where it is."""

    value: float
    """[m] or [rad]."""
    time: float
    """[s]."""
    point: int
    """Way point it belongs to: for the contour the last one begun, counted from 0 in the raw chain."""


class Deviation(NamedTuple):
    """The three measures."""

    contour: Place
    """Largest distance of the tip's trajectory from the polyline [m]."""
    vertex: Place
    """Largest distance of a way point from the tip's trajectory [m]."""
    axis: Place
    """Largest angle of the tool axis from the arcs between way points' axes [rad]."""


class VertexDistances(NamedTuple):
    """Of every raw way point."""

    distances: Array
    """From the tip's trajectory [m], shape (m,)."""
    times: Array
    """When the tip is nearest [s], shape (m,)."""


def measure_deviation(chain: Chain, schedule: Schedule, raw: Chain) -> Deviation:
    """Measure a smoothed motion against its way points.

    Args:
        chain: The segments the schedule passes; each way point one of the raw chain's, in order.
        schedule: When they are passed.
        raw: The way points as given.

    Returns:
        The largest deviations; zero where nothing strays.

    Raises:
        SmoothingError: The chain is not made of the raw chain's way points.
    """
    places, index = raw_places(chain, raw), index_schedule(chain, schedule)
    knots = np.unique(np.concatenate([schedule.starts, schedule.starts + schedule.durations]))
    worst = np.zeros((2, 2))
    scan_spans(chain, schedule, index, raw, places, knots, worst, np.empty((3, 16)))
    distances, times = vertex_distances(chain, schedule, raw)
    vertex = int(np.argmax(distances))
    contour, axis = (
        Place(float(value), float(time), int(places[min(_begun(index, time), len(places) - 1)]))
        for value, time in worst
    )
    return Deviation(contour, Place(float(distances[vertex]), float(times[vertex]), vertex), axis)


def vertex_distances(chain: Chain, schedule: Schedule, raw: Chain) -> VertexDistances:
    """Distance of every raw way point from the tip's trajectory, and when it is least; see `measure_deviation`."""
    found = VertexDistances(*np.zeros((2, len(raw.tips))))
    index, places = index_schedule(chain, schedule), raw_places(chain, raw)
    least_distances(chain, schedule, index, raw, places, *found, np.empty((3, 16)))
    return found


def raw_places(chain: Chain, raw: Chain) -> Indices:
    """Number of each of the chain's way points among the raw ones, shape (n + 1,).

    Raises:
        SmoothingError: One is not among them, in order, or an end is not an end.
    """
    places = np.zeros(len(chain.tips), dtype=np.int64)
    missing = _match(chain, raw, places)
    if missing >= 0 or places[-1] != len(raw.tips) - 1 or places[0] != 0:
        raise SmoothingError(f"way point {max(missing, 0)} of the smoothed chain is not among those given, in order.")
    return places


def _begun(index: ScheduleIndex, time: float) -> int:
    return max(int(np.searchsorted(index.none_begun, time, side="right")) - 1, 0)


@njit(cache=True, error_model="numpy")
def _match(chain: Chain, raw: Chain, places: Indices) -> int:
    """Fill ``places``; the first way point without one, or -1."""
    r = 0
    for k in range(chain.tips.shape[0]):
        while r < raw.tips.shape[0] and _apart(chain, k, raw, r) > 0.0:
            r += 1
        if r == raw.tips.shape[0]:
            return k
        places[k] = r
        r += 1
    return -1


@njit(cache=True, error_model="numpy")
def _apart(chain: Chain, k: int, raw: Chain, r: int) -> float:
    apart = 0.0
    for i in range(3):
        apart += abs(chain.tips[k, i] - raw.tips[r, i]) + abs(chain.axes[k, i] - raw.axes[r, i])
    return apart


# How far a motion strays from its way points at given times (Chain, Schedule, raw Chain -> curves).


class DeviationCurve(NamedTuple):
    """Deviations at n times."""

    tip: Array
    """Distance of the tip from the polyline [m], shape (n,)."""
    axis: Array
    """Angle of the tool axis to its arcs [rad], shape (n,)."""


def deviation_curve(chain: Chain, schedule: Schedule, raw: Chain, times: Array) -> DeviationCurve:
    """Measure a motion against the stretch of the way points it is on at each time.

    Args:
        chain: The segments the schedule passes; each way point one of the raw chain's, in order.
        schedule: When they are passed.
        raw: The way points as given.
        times: [s], shape (n,).

    Returns:
        The deviations.
    """
    seen = sample_schedule(chain, schedule, times)
    curve = DeviationCurve(np.zeros(len(times)), np.zeros(len(times)))
    tips, axes = np.ascontiguousarray(seen.tips[:, 0]), np.ascontiguousarray(seen.axes[:, 0])
    _fill(index_schedule(chain, schedule), raw, raw_places(chain, raw), times, tips, axes, curve)
    return curve


@njit(cache=True, error_model="numpy")
def _fill(
    index: ScheduleIndex,
    raw: Chain,
    places: Indices,
    times: Array,
    tips: Array,
    axes: Array,
    curve: DeviationCurve,
) -> None:
    for i in range(times.shape[0]):
        early = np.searchsorted(index.all_ended, times[i], side="right")
        late = np.searchsorted(index.none_begun, times[i], side="right")
        if late > early:
            curve.tip[i] = tip_distance(raw, places[early], places[late], tips[i])
            curve.axis[i] = axis_distance(raw, places[early], places[late], axes[i])
