"""From decided corners to rows of a schedule (layer 6).

The progress of a segment is made of three parts: the second half of the kernel behind it, the connector, and the
first half of the kernel before it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.certified.buffers import DURATION, SIZE, Corners, Segments
from polish_sim.motion.certified.connector import CONNECTOR_PIECES, connect, fill_connector
from polish_sim.motion.certified.corner import PIECES
from polish_sim.motion.certified.window import ends_between, line_limits

Array = NDArray[np.float64]

MOST_ROWS = 2 * PIECES + CONNECTOR_PIECES
"""Most rows of one segment."""


class Rows(NamedTuple):
    """Rows of a schedule that wait to be taken away."""

    segments: NDArray[np.int64]
    """Number of the segment, counted from the path's start, shape (m,)."""
    starts: Array
    """[s], shape (m,)."""
    durations: Array
    """[s], shape (m,)."""
    coefficients: Array
    """Progress as a cubic in time, shape (m, 4)."""
    scratch: Array
    """Durations and jerks of a connector, shape (2, CONNECTOR_PIECES)."""


def new_rows(count: int) -> Rows:
    """Room for rows."""
    return Rows(
        np.zeros(count, dtype=np.int64), np.zeros(count), np.zeros(count), np.zeros((count, 4)),
        np.zeros((2, CONNECTOR_PIECES)),
    )  # fmt: skip


class Place(NamedTuple):
    """Where the rows of a segment go."""

    segment: int
    """Its number in the buffers."""
    number: int
    """Its number counted from the path's start."""
    row: int
    """First free row."""


@njit(cache=True, error_model="numpy")
def emit_segment(segments: Segments, corners: Corners, rows: Rows, place: Place, start: float) -> tuple[int, float]:
    """Write the rows of a segment whose corners are both decided.

    Args:
        segments: Buffers.
        corners: Buffers.
        rows: Filled.
        place: Which segment, and where its rows go.
        start: When the corner behind it begins [s].

    Returns:
        The next free row, and when the corner before it begins [s].
    """
    k, row, time = place.segment, place.row, start
    first = corners.states[k, corners.chosen[k]]
    second = corners.states[k + 1, corners.chosen[k + 1]]
    if first[DURATION] > 0.0:
        row, time = _emit_gone(segments, corners, rows, Place(k, place.number, row), time)
    row, time = _emit_connector(segments, rows, Place(k, place.number, row), time, first, second)
    if second[DURATION] > 0.0:
        row = _emit_remaining(segments, corners, rows, Place(k, place.number, row), time)
    return row, time


@njit(cache=True, error_model="numpy")
def _emit_gone(segments: Segments, corners: Corners, rows: Rows, place: Place, time: float) -> tuple[int, float]:
    """The kernel behind the segment: what is gone of it."""
    k, row, span = place.segment, place.row, segments.spans[place.segment]
    scale = corners.scales[k, corners.chosen[k]]
    for p in range(PIECES):
        duration = corners.durations[k, p] * scale
        if duration > 0.0:
            rows.segments[row], rows.starts[row], rows.durations[row] = place.number, time, duration
            factor = scale**3 / span
            for c in range(4):
                rows.coefficients[row, c] = corners.gone[k, p, c] * factor
                factor /= scale
            row, time = row + 1, time + duration
    return row, time


@njit(cache=True, error_model="numpy")
def _emit_remaining(segments: Segments, corners: Corners, rows: Rows, place: Place, time: float) -> int:
    """The kernel before the segment's end: one less what remains of it."""
    k, row, span = place.segment + 1, place.row, segments.spans[place.segment]
    scale = corners.scales[k, corners.chosen[k]]
    for p in range(PIECES):
        duration = corners.durations[k, p] * scale
        if duration > 0.0:
            rows.segments[row], rows.starts[row], rows.durations[row] = place.number, time, duration
            factor = scale**3 / span
            for c in range(4):
                rows.coefficients[row, c] = -corners.remaining[k, p, c] * factor
                factor /= scale
            rows.coefficients[row, 0] += 1.0
            row, time = row + 1, time + duration
    return row


@njit(cache=True, error_model="numpy")
def _emit_connector(
    segments: Segments, rows: Rows, place: Place, time: float, first: Array, second: Array
) -> tuple[int, float]:
    """The straight run between both kernels."""
    row, span, limits = place.row, segments.spans[place.segment], line_limits(segments, place.segment)
    ends, distance = ends_between(first, second), max(span - first[SIZE] - second[SIZE], 0.0)
    durations, jerks = rows.scratch[0], rows.scratch[1]
    fill_connector(ends, connect(ends, distance, limits), limits, durations, jerks)
    x, v, a = first[SIZE], ends.v0, ends.a0
    for p in range(CONNECTOR_PIECES):
        t, j = durations[p], jerks[p]
        if t > 0.0:
            rows.segments[row], rows.starts[row], rows.durations[row] = place.number, time, t
            cubic = rows.coefficients[row]
            cubic[0], cubic[1], cubic[2], cubic[3] = x / span, v / span, 0.5 * a / span, j / 6.0 / span
            x, v, a = x + t * (v + t * (0.5 * a + t * j / 6.0)), v + t * (a + 0.5 * t * j), a + t * j
            row, time = row + 1, time + t
    return row, time
