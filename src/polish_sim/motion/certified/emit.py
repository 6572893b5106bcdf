"""From decided corners to rows of a schedule (layer 6).

A line's motion has three parts: what is gone of it in the kernel behind, the law of its connector, and what remains
of it in the kernel before. The law is shared out to the line's segments, bends turn one into the next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import DURATION, MOST_STRUNG, SIZE, SPEED, Corners, Lines, Segments
from polish_sim.motion.certified.connector import CONNECTOR_PIECES, LineLimits, connect, fill_connector
from polish_sim.motion.certified.corner_parts import Kernel, copy_scaled, new_kernel
from polish_sim.motion.certified.corner_shapes import PIECES
from polish_sim.motion.certified.corners import kernel_of
from polish_sim.motion.certified.law import (
    Law,
    Motion,
    Turning,
    fill_law,
    gone_at,
    law_at,
    new_law,
    next_break,
    turn_at,
)
from polish_sim.motion.certified.plain import fill_plain
from polish_sim.motion.certified.window import ends_between

Array = NDArray[np.float64]

SEGMENT_ROWS = 2 * CONNECTOR_PIECES + 4
"""Most rows of one segment without kernels: into it by two, along it, out of it."""
KERNEL_ROWS = 2 * PIECES
"""Most rows of both kernels of a line."""
_NO_TURN = Turning(0.0, 0.0, (0.0, 0.0))


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


class Pen(NamedTuple):
    """What emission writes with."""

    rows: Rows
    law: Law
    pieces: Array
    """Durations and jerks of a connector, shape (2, CONNECTOR_PIECES)."""
    bends: Array
    """begin, duration and both jerks of the bend before each segment of a line, shape (MOST_STRUNG + 1, 4)."""
    kernel: Kernel
    """Work space."""


def new_pen(rows: int) -> Pen:
    """Room for rows, and work space."""
    return Pen(
        Rows(np.zeros(rows, dtype=np.int64), np.zeros(rows), np.zeros(rows), np.zeros((rows, 4))),
        new_law(),
        np.zeros((2, CONNECTOR_PIECES)),
        np.zeros((MOST_STRUNG + 1, 4)),
        new_kernel(PIECES),
    )


class Place(NamedTuple):
    """Where the rows of a line go."""

    line: int
    """Its number in the buffers."""
    number: int
    """Number of the buffers' first segment, counted from the path's start."""
    row: int
    """First free row."""


@njit(cache=True, error_model="numpy")
def lay_law(lines: Lines, corners: Corners, k: int, limits: LineLimits, pen: Pen) -> float:
    """Fill the law of line ``k`` between its two decided corners.

    Returns:
        Its duration [s], NaN if the line is too short for the corners' speeds under these limits.
    """
    first, second = corners.states[k, corners.chosen[k]], corners.states[k + 1, corners.chosen[k + 1]]
    ends, distance = ends_between(first, second), max(lines.spans[k] - first[SIZE] - second[SIZE], 0.0)
    fill_connector(ends, connect(ends, distance, limits), limits, pen.pieces[0], pen.pieces[1])
    fill_law(pen.law, Motion(first[SIZE], ends.v0, ends.a0, 0.0), pen.pieces[0], pen.pieces[1])
    return float(pen.law.starts[CONNECTOR_PIECES])


@njit(cache=True, error_model="numpy")
def lay_bends(segments: Segments, lines: Lines, k: int, pen: Pen, share: float) -> bool:
    """Place the bends of line ``k`` in its law, each with a share of its planned length.

    Returns:
        Whether all fit in.
    """
    first, last, way = lines.first[k], lines.first[k + 1] - 1, 0.0
    for i in range(first + 1, last + 1):
        way += segments.spans[i - 1]
        before, after = 0.5 * segments.spans[i - 1], 0.5 * segments.spans[i]
        turning = turn_at(pen.law, way, share * segments.bends[i, 0], before, after)
        row = pen.bends[i - first]
        row[0], row[1], row[2], row[3] = turning.begin, turning.duration, turning.jerks[0], turning.jerks[1]
        if turning.duration <= 0.0:
            return False
    return True


@njit(cache=True, error_model="numpy")
def bend_of(pen: Pen, i: int) -> Turning:
    """The bend before a line's segment number ``i``."""
    row = pen.bends[i]
    return Turning(row[0], row[1], (row[2], row[3]))


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def emit_line(
    segments: Segments, lines: Lines, corners: Corners, pen: Pen, place: Place, start: float
) -> tuple[int, float]:
    """Write the rows of a line whose law and bends are laid.

    Args:
        segments: Buffers.
        lines: Buffers.
        corners: Buffers.
        pen: With the law and the bends; its rows are filled.
        place: Which line, and where its rows go.
        start: When the corner behind it begins [s].

    Returns:
        The next free row, and when the corner before it begins [s].
    """
    k, row, time, way = place.line, place.row, start, 0.0
    first, last = lines.first[k], lines.first[k + 1] - 1
    if corners.states[k, corners.chosen[k], DURATION] > 0.0:
        row, time = _emit_gone(segments, corners, pen, Place(k, place.number + first, row), first, time)
    for i in range(first, last + 1):
        incoming = bend_of(pen, i - first) if i > first else _NO_TURN
        outgoing = bend_of(pen, i - first + 1) if i < last else _NO_TURN
        share = Share(place.number + i, way, segments.spans[i], time)
        row = _emit_share(pen, share, incoming, outgoing, row)
        way += segments.spans[i]
    time += pen.law.starts[CONNECTOR_PIECES]
    if corners.states[k + 1, corners.chosen[k + 1], DURATION] > 0.0:
        row = _emit_remaining(segments, corners, pen, Place(k + 1, place.number + last, row), last, time)
    return row, time


class Share(NamedTuple):
    """One segment's part of a line."""

    number: int
    """Of the segment."""
    way: float
    """Where it begins along the line [m]."""
    span: float
    """Its length [m]."""
    start: float
    """When the law begins [s]."""


@njit(cache=True, error_model="numpy")
def _emit_share(pen: Pen, share: Share, incoming: Turning, outgoing: Turning, row: int) -> int:
    """Write the rows of one segment: turned into, run along, turned out of."""
    law, time = pen.law, 0.0
    if incoming.duration > 0.0:
        half = 0.5 * incoming.duration
        for p in range(2):
            time = incoming.begin + p * half
            gone = gone_at(incoming, time)
            gone = Motion(gone.way, gone.speed, gone.acceleration, incoming.jerks[p])
            row = _write(pen.rows, row, share, time, half, gone)
        time = incoming.begin + incoming.duration
    until = outgoing.begin if outgoing.duration > 0.0 else law.starts[CONNECTOR_PIECES]
    for p in range(CONNECTOR_PIECES):
        begin, end = max(law.starts[p], time), min(law.starts[p + 1], until)
        if end > begin:
            row = _write(pen.rows, row, share, begin, end - begin, _from(law_at(law, begin), share.way))
    if outgoing.duration > 0.0:
        time, end = outgoing.begin, outgoing.begin + outgoing.duration
        while time < end:
            then = next_break(law, outgoing, time)
            if then <= time:
                break
            line, gone = _from(law_at(law, time), share.way), gone_at(outgoing, time)
            jerk = gone_at(outgoing, 0.5 * (time + then)).jerk
            rest = Motion(
                line.way - gone.way, line.speed - gone.speed, line.acceleration - gone.acceleration, line.jerk - jerk
            )
            row = _write(pen.rows, row, share, time, then - time, rest)
            time = then
    return row


@njit(cache=True, error_model="numpy")
def _from(motion: Motion, way: float) -> Motion:
    """The same motion counted from a place on."""
    return Motion(motion.way - way, motion.speed, motion.acceleration, motion.jerk)


@njit(cache=True, error_model="numpy")
def _write(rows: Rows, row: int, share: Share, time: float, duration: float, motion: Motion) -> int:
    rows.segments[row], rows.starts[row], rows.durations[row] = share.number, share.start + time, duration
    cubic, span = rows.coefficients[row], share.span
    cubic[0], cubic[1] = motion.way / span, motion.speed / span
    cubic[2], cubic[3] = 0.5 * motion.acceleration / span, motion.jerk / 6.0 / span
    return row + 1


@njit(cache=True, error_model="numpy")
def _emit_gone(
    segments: Segments, corners: Corners, pen: Pen, place: Place, segment: int, time: float
) -> tuple[int, float]:
    """The kernel behind a line: what is gone of its first segment."""
    k, row, span, rows = place.line, place.row, segments.spans[segment], pen.rows
    lift_kernel(corners, k, pen.kernel)
    for p in range(PIECES):
        duration = pen.kernel.durations[p]
        if duration > 0.0:
            rows.segments[row], rows.starts[row], rows.durations[row] = place.number, time, duration
            for c in range(4):
                rows.coefficients[row, c] = pen.kernel.gone[p, c] / span
            row, time = row + 1, time + duration
    return row, time


@njit(cache=True, error_model="numpy")
def _emit_remaining(segments: Segments, corners: Corners, pen: Pen, place: Place, segment: int, time: float) -> int:
    """The kernel before a line's end: its last segment less what remains of it."""
    k, row, span, rows = place.line, place.row, segments.spans[segment], pen.rows
    lift_kernel(corners, k, pen.kernel)
    for p in range(PIECES):
        duration = pen.kernel.durations[p]
        if duration > 0.0:
            rows.segments[row], rows.starts[row], rows.durations[row] = place.number, time, duration
            for c in range(4):
                rows.coefficients[row, c] = -pen.kernel.remaining[p, c] / span
            rows.coefficients[row, 0] += 1.0
            row, time = row + 1, time + duration
    return row


@njit(cache=True, error_model="numpy")
def lift_kernel(corners: Corners, k: int, kernel: Kernel) -> None:
    """Write the kernel of corner ``k`` as it is passed in the decided state."""
    chosen = corners.chosen[k]
    if corners.scales[k, chosen] < 0.0:
        state = corners.states[k, chosen]
        fill_plain(state[SIZE], state[SPEED], kernel.durations, kernel.remaining, kernel.gone)
    else:
        copy_scaled(kernel_of(corners, k), corners.scales[k, chosen], corners.slowdowns[k, chosen], kernel)
