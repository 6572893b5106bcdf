"""How far a smoothed motion strays from its way points, whatever planned it (SmoothMotion, Chain ->
Deviation).

Two measures are kept apart: *contour* is the largest distance of the trajectory from the polyline, *vertex*
the largest distance of a way point from the trajectory. The trajectory is compared with the stretch of the
polyline it is on at that time, so paths that cross themselves are measured right. The search samples every
smooth span and narrows down the neighbourhoods of the largest samples: exact to rounding where a span has no
more than a few local maxima.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, in_groups, norms
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, minus
from polish_sim.motion.rules.chain import Chain, axis_distances, tip_distances
from polish_sim.motion.rules.schedule import SmoothMotion

SAMPLES = 13  #: Of each smooth span
EDGE = 1e-7  #: Share of a span that is kept from its ends, where the jerk jumps
MANY, FEWEST = 200_000, 2  #: Spans of a long motion, samples of each of them
BLOCK = 100_000
SHORTEST_S = 1e-9  #: A shorter span is rounding where pieces meet [s]
NARROWED, ZOOM, ZOOMS = 32, 9, 14
"""Largest samples whose neighbourhoods are narrowed down; places in one, and how often it shrinks, by 4 each
time."""


class LargestAt(NamedTuple):
    """A largest deviation and where it is."""

    value: float  #: [m] or [rad]
    time: float  #: [s]


class Deviation(NamedTuple):
    """The three measures."""

    contour: LargestAt  #: Largest distance of the tip's trajectory from the polyline [m]
    vertex: LargestAt  #: Largest distance of a way point from the tip's trajectory [m]
    axis: LargestAt  #: Largest angle of the tool axis from the arcs between way points' axes [rad]


class VertexDistances(NamedTuple):
    """Distances of every raw way point."""

    distances: Array  #: From the tip's trajectory [m], shape (m,)
    times: Array  #: When the tip is nearest [s], shape (m,)


class DeviationCurve(NamedTuple):
    """Deviations at n times."""

    tip: Array  #: Distance of the tip from the polyline [m], shape (n,)
    axis: Array  #: Angle of the tool axis to its arcs [rad], shape (n,)


def measure_deviation(motion: SmoothMotion, raw: Chain) -> Deviation:
    """Measure a motion against its way points."""
    found = [np.zeros((0, 3)), np.zeros((0, 3))]
    for times in stretch_times(motion.edges, SAMPLES):
        curve = deviation_curve(motion, raw, times)
        for i, values in enumerate(curve):
            rows = np.argsort(values)[-NARROWED:]
            low, high = times[np.maximum(rows - 1, 0)], times[np.minimum(rows + 1, len(times) - 1)]
            both = np.concatenate([found[i], np.stack([values[rows], low, high], axis=1)])
            found[i] = both[np.argsort(both[:, 0])[-NARROWED:]]
    worst = []
    for i in range(2):

        def measured(times: Array, i: int = i) -> Array:
            return deviation_curve(motion, raw, times)[i]

        values, times = _narrowed(measured, found[i][:, 1], found[i][:, 2])
        worst.append(_largest(values, times))
    return Deviation(worst[0], _largest(*vertex_distances(motion, raw)), worst[1])


def _largest(values: Array, times: Array) -> LargestAt:
    row = int(values.argmax())
    return LargestAt(float(values[row]), float(times[row]))


def vertex_distances(motion: SmoothMotion, raw: Chain) -> VertexDistances:
    """Distance of every way point from the tip's trajectory, and when it is least."""
    m = len(raw.tips)
    best, low, high = np.full(m, np.inf), np.zeros(m), np.full(m, motion.end)
    for times in stretch_times(motion.edges, SAMPLES):
        _nearest(
            raw.tips,
            np.ascontiguousarray(motion.sample(times).tips[:, 0]),
            *motion.under_way(times),
            times,
            best,
            low,
            high,
        )
    distances = np.zeros(m)
    nearest = low
    for first in range(0, m, BLOCK // ZOOM):
        rows = slice(first, first + BLOCK // ZOOM)
        places = np.repeat(raw.tips[rows], ZOOM, axis=0)

        def nearness(t: Array, places: Array = places) -> Array:
            return -norms(motion.sample(t).tips[:, 0] - places)

        values, nearest[rows] = _narrowed(nearness, low[rows], high[rows])
        distances[rows] = -values
    distances[[0, -1]], nearest[[0, -1]] = 0.0, (0.0, motion.end)
    return VertexDistances(distances, nearest)


def deviation_curve(motion: SmoothMotion, raw: Chain, times: Array) -> DeviationCurve:
    """Measure a motion against the stretch of the way points it is on at each of some times [s], shape
    (n,)."""
    seen, (first, stop) = motion.sample(times), motion.under_way(times)
    row, place = in_groups(stop - first)
    k = first[row] + place
    curve = DeviationCurve(*np.where(stop > first, np.full((2, len(times)), np.inf), 0.0))
    np.minimum.at(curve.tip, row, tip_distances(raw, k, seen.tips[row, 0]))
    np.minimum.at(curve.axis, row, axis_distances(raw, k, seen.axes[row, 0]))
    return curve


def stretch_times(edges: Array, least: int, longest: float = np.inf) -> Iterator[Array]:
    """Times in every stretch between ``edges`` (n,) [s], in which all rates are smooth, blocks of rising
    times; at least ``least`` a stretch, both its ends among them, no further apart than ``longest`` [s]."""
    widths = np.diff(edges)
    begins = edges[:-1][widths > SHORTEST_S]
    widths = widths[widths > SHORTEST_S]
    least = least if len(widths) <= MANY else FEWEST
    counts = np.maximum(least, np.ceil(widths / longest).astype(np.int64) + 1)
    # Never on the edge itself, where rounding would let pieces overlap.
    edges = np.maximum(EDGE * widths, 8.0 * np.spacing(begins + widths))
    block = np.cumsum(counts) // BLOCK
    for number in np.unique(block):
        some = np.flatnonzero(block == number)
        k, place = in_groups(counts[some])
        k = some[k]
        yield begins[k] + edges[k] + (widths[k] - 2.0 * edges[k]) * place / (counts[k] - 1)


def _narrowed(value: Callable[[Array], Array], low: Array, high: Array) -> tuple[Array, Array]:
    """Largest values between times ``low`` and ``high`` (k,) [s], and where; ``value`` takes ``ZOOM`` times
    of each."""
    rows = np.arange(len(low))
    for _ in range(ZOOMS):
        times = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, ZOOM)
        values = value(times.ravel()).reshape(times.shape)
        best = values.argmax(axis=1)
        low, high = times[rows, np.maximum(best - 1, 0)], times[rows, np.minimum(best + 1, ZOOM - 1)]
    return values[rows, best], times[rows, best]


@njit(_nrt=False)
def _nearest(
    points: Array,
    tips: Array,
    first: Indices,
    stop: Indices,
    times: Array,
    best: Array,
    low: Array,
    high: Array,
) -> None:
    """Where the tip (n, 3) comes nearer to a way point of the segments under way than before: the times
    beside."""
    for i in range(tips.shape[0]):
        for r in range(first[i], min(stop[i] + 1, points.shape[0])):
            gap = minus(tips[i], points[r])
            square = dot(gap, gap)
            if square < best[r]:
                best[r], low[r], high[r] = square, times[max(i - 1, 0)], times[min(i + 1, tips.shape[0] - 1)]
