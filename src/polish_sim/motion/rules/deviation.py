"""How far a smoothed motion strays from its way points, whatever planned it (Chain, Schedule, raw Chain -> Deviation).

Two measures are kept apart: *contour* is the largest distance of the trajectory from the polyline, *vertex* the largest
distance of a way point from the trajectory. The trajectory is compared with the stretch of the polyline it is on at
that time, so paths that cross themselves are measured right. The search samples every cubic span and refines its local
maxima by golden section: exact to rounding where a span has no more than a few of them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.errors import SmoothingError
from polish_sim.kernel_cache import njit
from polish_sim.motion.rules.chain import Chain, axis_distance, rows_among, tip_distance
from polish_sim.motion.rules.schedule import (
    Schedule,
    ScheduleIndex,
    axis_between,
    index_schedule,
    sample_schedule,
    tip_between,
)

SAMPLES = 12  #: Of each cubic span, and of each overlap of two segments
LONG_SAMPLES = 64  #: Of two whole segments
GOLDEN = 0.6180339887498949
STEPS = 50  #: Of the golden section: a bracket shrinks by 4e-11
TIP, AXIS, NEARNESS = 0, 1, 2
"""What is made largest: distance of the tip from the polyline, angle of the axis to its arcs, minus the distance of the
tip from one way point."""


class Place(NamedTuple):
    """A largest deviation and where it is."""

    value: float  #: [m] or [rad]
    time: float  #: [s]
    point: int  #: Way point it belongs to: for the contour the last one begun, counted from 0 in the raw chain


class Deviation(NamedTuple):
    """The three measures."""

    contour: Place  #: Largest distance of the tip's trajectory from the polyline [m]
    vertex: Place  #: Largest distance of a way point from the tip's trajectory [m]
    axis: Place  #: Largest angle of the tool axis from the arcs between way points' axes [rad]


class VertexDistances(NamedTuple):
    """Of every raw way point."""

    distances: Array  #: From the tip's trajectory [m], shape (m,)
    times: Array  #: When the tip is nearest [s], shape (m,)


class DeviationCurve(NamedTuple):
    """Deviations at n times."""

    tip: Array  #: Distance of the tip from the polyline [m], shape (n,)
    axis: Array  #: Angle of the tool axis to its arcs [rad], shape (n,)


class _Motion(NamedTuple):
    """A motion and the way points it is compared with, as kernels take them."""

    chain: Chain
    schedule: Schedule
    lookup: ScheduleIndex
    raw: Chain
    places: Indices  #: Number of each of the chain's way points among the raw ones, shape (n + 1,)


def measure_deviation(chain: Chain, schedule: Schedule, raw: Chain) -> Deviation:
    """Measure the motion along a chain, each way point one of the raw chain's in order, against the raw way points.

    Raises:
        SmoothingError: The chain is not made of the raw chain's way points.
    """
    motion = _motion(chain, schedule, raw)
    knots = np.unique(np.concatenate([schedule.starts, schedule.starts + schedule.durations]))
    worst = np.zeros((2, 2))
    _scan_spans(motion, knots, worst, np.empty((3, 16)))
    distances, times = _vertex_distances(motion)
    vertex = int(np.argmax(distances))
    begun = np.maximum(np.searchsorted(motion.lookup.none_begun, worst[:, 1], side="right") - 1, 0)
    points = motion.places[np.minimum(begun, len(motion.places) - 1)]
    contour, axis = (Place(float(worst[i, 0]), float(worst[i, 1]), int(points[i])) for i in range(2))
    return Deviation(contour, Place(float(distances[vertex]), float(times[vertex]), vertex), axis)


def vertex_distances(chain: Chain, schedule: Schedule, raw: Chain) -> VertexDistances:
    """Distance of every raw way point from the tip's trajectory, and when it is least; see `measure_deviation`."""
    return _vertex_distances(_motion(chain, schedule, raw))


def deviation_curve(chain: Chain, schedule: Schedule, raw: Chain, times: Array) -> DeviationCurve:
    """Measure a motion against the stretch of the way points it is on at each of some times [s], shape (n,)."""
    seen = sample_schedule(chain, schedule, times)
    curve = DeviationCurve(np.zeros(len(times)), np.zeros(len(times)))
    tips, axes = np.ascontiguousarray(seen.tips[:, 0]), np.ascontiguousarray(seen.axes[:, 0])
    _fill_curve(_motion(chain, schedule, raw), times, tips, axes, curve)
    return curve


def raw_places(chain: Chain, raw: Chain) -> Indices:
    """Number of each of the chain's way points among the raw ones, shape (n + 1,).

    Raises:
        SmoothingError: One is not among them, in order, or an end is not an end.
    """
    places = rows_among(np.hstack([chain.tips, chain.axes]), np.hstack([raw.tips, raw.axes]))
    if places[0] != 0 or places[-1] != len(raw.tips) - 1:
        raise SmoothingError("the smoothed chain does not begin and end where the given one does.")
    return places


def _motion(chain: Chain, schedule: Schedule, raw: Chain) -> _Motion:
    return _Motion(chain, schedule, index_schedule(chain, schedule), raw, raw_places(chain, raw))


def _vertex_distances(motion: _Motion) -> VertexDistances:
    found = np.zeros((len(motion.raw.tips), 2))
    _scan_points(motion, found, np.empty((3, 16)))
    return VertexDistances(np.abs(found[:, 0]), found[:, 1].copy())


@njit(cache=True, error_model="numpy", _nrt=False)
def _scan_spans(motion: _Motion, knots: Array, worst: Array, room: Array) -> None:
    """Find where the tip strays furthest from the raw polyline, and the axis from its arcs.

    Written are rows TIP and AXIS of ``worst`` (2, 2): value, time [s]. ``knots`` are the ends of all pieces [s].
    """
    values = room[2]
    for span in range(knots.shape[0] - 1):
        begin, step = knots[span], (knots[span + 1] - knots[span]) / SAMPLES
        middle = begin + 0.5 * SAMPLES * step
        early = np.searchsorted(motion.lookup.all_ended, middle, side="right")
        late = np.searchsorted(motion.lookup.none_begun, middle, side="right")
        # At rest, or alone on a segment of the raw chain.
        if late <= early or motion.places[late] - motion.places[early] == 1:
            continue
        for what in range(2):
            for i in range(SAMPLES + 1):
                values[i] = _value(motion, what, 0, early, late, begin + i * step, room)
            for i in range(SAMPLES + 1):
                before, after = max(i - 1, 0), min(i + 1, SAMPLES)
                rise = max(values[i] - values[before], values[i] - values[after])
                if values[i] < values[before] or values[i] < values[after] or values[i] + rise <= worst[what, 0]:
                    continue
                _refine(motion, what, 0, early, late, begin + before * step, begin + after * step, room, worst[what])


@njit(cache=True, error_model="numpy", _nrt=False)
def _scan_points(motion: _Motion, found: Array, room: Array) -> None:
    """Find minus the distance of every inner raw way point from the tip's trajectory, and the time, shape (m, 2)."""
    index, places, k = motion.lookup, motion.places, 0
    for r in range(1, motion.raw.tips.shape[0] - 1):
        while places[k + 1] < r:
            k += 1
        later = k + 1 if places[k + 1] == r else k  # a corner of the chain belongs to two segments
        if later > k and index.none_begun[later] >= index.all_ended[k]:  # a stop at the way point
            found[r, 1] = index.all_ended[k]
            continue
        found[r, 0] = -np.inf
        _pass_point(motion, r, index.none_begun[k], index.all_ended[later], LONG_SAMPLES, room, found[r])
        if later > k:
            _pass_point(motion, r, index.none_begun[later], index.all_ended[k], SAMPLES, room, found[r])


@njit(cache=True, error_model="numpy")
def _pass_point(motion: _Motion, point: int, begin: float, end: float, count: int, room: Array, best: Array) -> None:
    """Nearest passage of the tip by a way point between two times; ``best`` is written where it is surpassed."""
    early = np.searchsorted(motion.lookup.all_ended, begin, side="right")
    late = np.searchsorted(motion.lookup.none_begun, end, side="right")
    step, own = (end - begin) / count, room[2, :2]
    own[0], own[1] = -np.inf, begin
    for i in range(count + 1):
        value = _value(motion, NEARNESS, point, early, late, begin + i * step, room)
        if value > own[0]:
            own[0], own[1] = value, begin + i * step
    low, high = max(own[1] - step, begin), min(own[1] + step, end)
    _refine(motion, NEARNESS, point, early, late, low, high, room, own)
    if own[0] > best[0]:
        best[0], best[1] = own[0], own[1]


@njit(cache=True, error_model="numpy")
def _refine(
    motion: _Motion, what: int, point: int, early: int, late: int, low: float, high: float, room: Array, best: Array
) -> None:
    """Largest value between two times by golden section; ``best`` (value, time) is written where it is surpassed."""
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left = _value(motion, what, point, early, late, left, room)
    at_right = _value(motion, what, point, early, late, right, room)
    for _ in range(STEPS):
        if max(at_left, at_right) > best[0]:
            best[0], best[1] = max(at_left, at_right), left if at_left > at_right else right
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = _value(motion, what, point, early, late, left, room)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = _value(motion, what, point, early, late, right, room)


@njit(cache=True, error_model="numpy")
def _value(motion: _Motion, what: int, point: int, early: int, late: int, time: float, room: Array) -> float:
    """What is made largest, at a time at which segments ``early`` to ``late - 1`` are under way."""
    place, first, stop = room[0, :3], motion.places[early], motion.places[late]
    if what == AXIS:
        axis_between(motion.chain, motion.schedule, motion.lookup, early, late, time, place, room[1])
        return float(axis_distance(motion.raw, first, stop, place))
    tip_between(motion.chain, motion.schedule, motion.lookup, early, late, time, place, room[1])
    if what == TIP:
        return float(tip_distance(motion.raw, first, stop, place))
    target = motion.raw.tips[point]
    return -math.sqrt((place[0] - target[0]) ** 2 + (place[1] - target[1]) ** 2 + (place[2] - target[2]) ** 2)


@njit(cache=True, error_model="numpy")
def _fill_curve(motion: _Motion, times: Array, tips: Array, axes: Array, curve: DeviationCurve) -> None:
    for i in range(times.shape[0]):
        early = np.searchsorted(motion.lookup.all_ended, times[i], side="right")
        late = np.searchsorted(motion.lookup.none_begun, times[i], side="right")
        if late > early:
            first, stop = motion.places[early], motion.places[late]
            curve.tip[i] = tip_distance(motion.raw, first, stop, tips[i])
            curve.axis[i] = axis_distance(motion.raw, first, stop, axes[i])
