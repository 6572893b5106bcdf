"""How far a smoothed motion strays from its way points, whatever planned it (Chain, Schedule, raw Chain -> Deviation).

Two measures that are often confused are told apart: *contour* is the largest distance of the trajectory from the
polyline, *vertex* the largest distance of a way point from the trajectory. The trajectory is compared with the
stretch of the polyline it is on at that time, so paths that cross themselves are measured right. The search samples
every cubic span and refines its local maxima: exact to rounding where a span has no more than a few of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.errors import SmoothingError
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.deviation_search import least_distances, scan_spans
from polish_sim.motion.smoothing.sampling import ScheduleIndex, index_schedule
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


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
