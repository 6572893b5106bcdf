"""One line between two decided corners: its law of time, the bends in it, and the rows of a schedule it becomes.

A line's motion has three parts: what is gone of it in the kernel behind, the law of its connector, and what remains
of it in the kernel before. The law is shared out to the line's segments, bends turn one into the next.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from polish_sim.arrays import Array, Indices
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record
from polish_sim.motion.certified.bends import fill_plain
from polish_sim.motion.certified.connector import CONNECTOR_PIECES, Ends, Peaks, fill_connector
from polish_sim.motion.certified.kernel import PIECES, Kernel, copy_scaled, set_cubic
from polish_sim.motion.certified.window import MOST_STRUNG, ROOM, Corners, Lines, Segments, decided

_STEPS = 60
_SHRINKS = 40
_SHRINK = 0.9
_SEGMENT_ROWS = 2 * CONNECTOR_PIECES + 4  #: Most rows of a segment without kernels: into it by two, along it, out of it
_ROWS = ROOM * (_SEGMENT_ROWS + 2 * PIECES)  #: Most rows of the outbox


class Law(Record):
    """Way s along a line over time, as cubic pieces that follow one another."""

    starts: Annotated[Array, (CONNECTOR_PIECES + 1,)]  #: Begin of each and end of the last, from the law's start [s]
    cubics: Annotated[Array, (CONNECTOR_PIECES, 4)]  #: c0..c3 in the time from the piece's start


class Motion(NamedTuple):
    """Place along the line and its derivatives at one time."""

    way: float
    speed: float
    acceleration: float
    jerk: float


class Turning(NamedTuple):
    """The rate g of the new chord while a bend is passed: two parabolas of equal duration."""

    begin: float  #: In the law's time [s]
    duration: float  #: [s]; 0 if the bend does not fit in
    jerks: tuple[float, float]  #: g'' in both halves [m/s^3]


_NO_TURN = Turning(0.0, 0.0, (0.0, 0.0))


@njit(cache=True, error_model="numpy", _nrt=False)
def fill_law(law: Law, start: Motion, durations: Array, jerks: Array) -> None:
    """Integrate a connector's pieces from where it begins."""
    time, x, v, a = 0.0, start.way, start.speed, start.acceleration
    for p in range(CONNECTOR_PIECES):
        t, j = durations[p], jerks[p]
        law.starts[p] = time
        set_cubic(law.cubics[p], x, v, a, j)
        x, v, a = x + t * (v + t * (0.5 * a + t * j / 6.0)), v + t * (a + 0.5 * t * j), a + t * j
        time += t
    law.starts[CONNECTOR_PIECES] = time


@njit(cache=True, error_model="numpy", _nrt=False)
def law_at(law: Law, time: float) -> Motion:
    """The motion at a time."""
    p = _piece_at(law, time)
    c, t = law.cubics[p], time - law.starts[p]
    acceleration, jerk = 2.0 * c[2] + 6.0 * t * c[3], 6.0 * c[3]
    way, speed = c[0] + t * (c[1] + t * (c[2] + t * c[3])), c[1] + t * (2.0 * c[2] + 3.0 * t * c[3])
    return Motion(way, speed, acceleration, jerk)


@njit(cache=True, error_model="numpy", _nrt=False)
def _piece_at(law: Law, time: float) -> int:
    """The piece a time falls into."""
    p = CONNECTOR_PIECES - 1
    while p > 0 and law.starts[p] > time:
        p -= 1
    return p


@njit(cache=True, error_model="numpy", _nrt=False)
def time_at(law: Law, way: float) -> float:
    """When a place is passed [s]."""
    low, high = 0.0, law.starts[CONNECTOR_PIECES]
    time = 0.5 * (low + high)
    for _ in range(_STEPS):
        now = law_at(law, time)
        if now.way > way:
            high = time
        else:
            low = time
        step = (now.way - way) / now.speed if now.speed > 0.0 else math.inf
        time -= step
        if not low <= time <= high:
            time = 0.5 * (low + high)
        if abs(step) < 1e-12 * high:
            break
    return time


@njit(cache=True, error_model="numpy", _nrt=False)
def turn_at(law: Law, vertex: float, length: float, before: float, after: float) -> Turning:
    """Place a bend of a length at constant speed in a law, which takes at most a length of the chords beside it [m].

    g begins with value and slope 0, ends with those of s', and its area is what is gone of the new chord by then:
    this fixes both jerks and when it begins.
    """
    passed = time_at(law, vertex)
    duration = length / law_at(law, passed).speed
    for _ in range(_SHRINKS):
        begin = _begin(law, vertex, passed, duration)
        end = law_at(law, begin + duration)
        inside = begin >= 0.0 and begin + duration <= law.starts[CONNECTOR_PIECES]
        if inside and vertex - law_at(law, begin).way <= before and end.way - vertex <= after:
            square = 4.0 * end.speed / (duration * duration)
            slope = end.acceleration / duration
            return Turning(begin, duration, (square - slope, 3.0 * slope - square))
        duration *= _SHRINK
    return Turning(passed, 0.0, (0.0, 0.0))


@njit(cache=True, error_model="numpy", _nrt=False)
def _begin(law: Law, vertex: float, passed: float, duration: float) -> float:
    """When g must begin so that its area fits."""
    low, high = passed - duration, passed
    begin = 0.5 * (low + high)
    for _ in range(_STEPS):
        end = law_at(law, begin + duration)
        area = duration * (0.5 * end.speed - duration * end.acceleration / 12.0)
        excess = end.way - vertex - area
        if excess > 0.0:
            high = begin
        else:
            low = begin
        slope = end.speed - duration * (0.5 * end.acceleration - duration * end.jerk / 12.0)
        step = excess / slope if slope > 0.0 else math.inf
        begin -= step
        if not low <= begin <= high:
            begin = 0.5 * (low + high)
        if abs(step) < 1e-15 * duration:
            break
    return begin


@njit(cache=True, error_model="numpy", _nrt=False)
def gone_at(turning: Turning, time: float) -> Motion:
    """What is gone of the new chord while it is turned into; beyond the end as at the end."""
    half = 0.5 * turning.duration
    t = time - turning.begin
    first, second = turning.jerks
    if t <= half:
        return Motion(first * t * t * t / 6.0, 0.5 * first * t * t, first * t, first)
    x, v, a, u = first * half**3 / 6.0, 0.5 * first * half * half, first * half, t - half
    return Motion(
        x + u * (v + u * (0.5 * a + u * second / 6.0)), v + u * (a + 0.5 * u * second), a + u * second, second
    )


@njit(cache=True, error_model="numpy", _nrt=False)
def next_break(law: Law, turning: Turning, time: float) -> float:
    """The next time after ``time`` at which the jerk may change, at most the bend's end."""
    end = turning.begin + turning.duration
    middle = turning.begin + 0.5 * turning.duration
    then = middle if time < middle else end
    p = _piece_at(law, time) + 1
    if p < CONNECTOR_PIECES and time < law.starts[p] < then:
        then = law.starts[p]
    return then


@njit(cache=True, error_model="numpy", _nrt=False)
def left_at(law: Law, turning: Turning, time: float, then: float, way: float) -> tuple[Motion, Motion]:
    """What is left of the old chord up to ``way``, falling, and what is gone of the new one; jerks until ``then``."""
    line, gone, jerk = law_at(law, time), gone_at(turning, time), gone_at(turning, 0.5 * (time + then)).jerk
    left = Motion(
        way - line.way + gone.way, gone.speed - line.speed, gone.acceleration - line.acceleration, jerk - line.jerk
    )
    return left, Motion(gone.way, gone.speed, gone.acceleration, jerk)


@njit(cache=True, error_model="numpy", _nrt=False)
def fill_bend_kernel(law: Law, turning: Turning, vertex: float, kernel: Kernel) -> float:
    """Write a bend as it lies in the law as pieces of a kernel.

    Returns what is left of the old chord or gone of the new one in the middle, the larger [m]; infinite if there are
    not enough pieces.
    """
    time, end, p = turning.begin, turning.begin + turning.duration, 0
    while time < end and p < PIECES:
        then = next_break(law, turning, time)
        if then <= time:
            break
        left, gone = left_at(law, turning, time, then, vertex)
        kernel.durations[p] = then - time
        set_cubic(kernel.gone[p], gone.way, gone.speed, gone.acceleration, gone.jerk)
        set_cubic(kernel.remaining[p], left.way, left.speed, left.acceleration, left.jerk)
        time, p = then, p + 1
    kernel.durations[p:] = 0.0
    middle = turning.begin + 0.5 * turning.duration
    left, gone = left_at(law, turning, middle, middle, vertex)
    return max(left.way, gone.way) if time >= end else math.inf


class Outbox(Record):
    """Room for `MotionPieces` that wait to be taken away."""

    tips: Annotated[Array, (ROOM, 3)]
    rotations: Annotated[Array, (ROOM, 3, 3)]
    way_points: Annotated[Indices, (ROOM,)]
    segments: Annotated[Indices, (_ROWS,)]
    starts: Annotated[Array, (_ROWS,)]
    durations: Annotated[Array, (_ROWS,)]
    coefficients: Annotated[Array, (_ROWS, 4)]


class Pen(Record):
    """What emission writes with, and to."""

    outbox: Outbox
    law: Law
    pieces: Annotated[Array, (2, CONNECTOR_PIECES)]  #: Durations and jerks of a connector
    bends: Annotated[Array, (MOST_STRUNG + 1, 4)]  #: Begin, duration, both jerks of the bend before a line's segments
    kernel: Kernel  #: Work space


class Share(NamedTuple):
    """One segment's part of a line."""

    number: int  #: Of the segment, counted from the path's start
    way: float  #: Where it begins along the line [m]
    span: float  #: Its length [m]
    start: float  #: When the law begins [s]


@njit(cache=True, error_model="numpy", _nrt=False)
def lay_law(lines: Lines, corners: Corners, k: int, limits: Peaks, pen: Pen) -> float:
    """Fill the law of line ``k`` between its two decided corners; its duration [s].

    NaN if the line is too short for the corners' speeds under these limits.
    """
    first, second = decided(corners, k), decided(corners, k + 1)
    ends = Ends(first.speed, first.acceleration, second.speed, second.acceleration)
    distance = max(lines.spans[k] - first.size - second.size, 0.0)
    fill_connector(ends, distance, limits, pen.pieces[0], pen.pieces[1])
    fill_law(pen.law, Motion(first.size, ends.v0, ends.a0, 0.0), pen.pieces[0], pen.pieces[1])
    return float(pen.law.starts[CONNECTOR_PIECES])


@njit(cache=True, error_model="numpy", _nrt=False)
def lay_bend(segments: Segments, i: int, n: int, vertex: float, share: float, pen: Pen) -> Turning:
    """Place the bend before segment ``i``, number ``n`` of its line, in the law with a share of its planned length."""
    turning = turn_at(
        pen.law, vertex, share * segments.bends[i, 0], 0.5 * segments.spans[i - 1], 0.5 * segments.spans[i]
    )
    row = pen.bends[n]
    row[0], row[1], row[2], row[3] = turning.begin, turning.duration, turning.jerks[0], turning.jerks[1]
    return turning


@njit(cache=True, error_model="numpy", _nrt=False)
def emit_line(
    segments: Segments, lines: Lines, corners: Corners, pen: Pen, k: int, number: int, row: int, time: float
) -> tuple[int, float]:
    """Write the rows of line ``k`` whose law and bends are laid, from row ``row`` and [s] ``time`` on.

    ``number`` is that of the buffers' first segment, counted from the path's start. Returns the next free row, and
    when the corner before the line begins [s].
    """
    first, last, way = lines.first[k], lines.first[k + 1] - 1, 0.0
    row, time = _emit_kernel(corners, k, 0.0, Share(number + first, 0.0, segments.spans[first], time), pen, row)
    for i in range(first, last + 1):
        incoming = _bend_of(pen, i - first) if i > first else _NO_TURN
        outgoing = _bend_of(pen, i - first + 1) if i < last else _NO_TURN
        row = _emit_share(pen, Share(number + i, way, segments.spans[i], time), incoming, outgoing, row)
        way += segments.spans[i]
    time += pen.law.starts[CONNECTOR_PIECES]
    row, _ = _emit_kernel(corners, k + 1, 1.0, Share(number + last, 0.0, segments.spans[last], time), pen, row)
    return row, time


@njit(cache=True, error_model="numpy", _nrt=False)
def _bend_of(pen: Pen, i: int) -> Turning:
    """The bend before a line's segment number ``i``."""
    row = pen.bends[i]
    return Turning(row[0], row[1], (row[2], row[3]))


@njit(cache=True, error_model="numpy", _nrt=False)
def _emit_share(pen: Pen, share: Share, incoming: Turning, outgoing: Turning, row: int) -> int:
    """Write the rows of one segment: turned into, run along, turned out of."""
    law, time = pen.law, 0.0
    if incoming.duration > 0.0:
        half = 0.5 * incoming.duration
        for p in range(2):
            time = incoming.begin + p * half
            gone = gone_at(incoming, time)
            gone = Motion(gone.way, gone.speed, gone.acceleration, incoming.jerks[p])
            row = _write(pen.outbox, row, share, time, half, gone)
        time = incoming.begin + incoming.duration
    until = outgoing.begin if outgoing.duration > 0.0 else law.starts[CONNECTOR_PIECES]
    for p in range(CONNECTOR_PIECES):
        begin, end = max(law.starts[p], time), min(law.starts[p + 1], until)
        if end > begin:
            line = law_at(law, begin)
            run = Motion(line.way - share.way, line.speed, line.acceleration, line.jerk)
            row = _write(pen.outbox, row, share, begin, end - begin, run)
    time, end = outgoing.begin, outgoing.begin + outgoing.duration
    while time < end:
        then = next_break(law, outgoing, time)
        if then <= time:
            break
        left, _ = left_at(law, outgoing, time, then, share.way)
        row = _write(
            pen.outbox, row, share, time, then - time, Motion(-left.way, -left.speed, -left.acceleration, -left.jerk)
        )
        time = then
    return row


@njit(cache=True, error_model="numpy", _nrt=False)
def _write(rows: Outbox, row: int, share: Share, time: float, duration: float, motion: Motion) -> int:
    rows.segments[row], rows.starts[row], rows.durations[row] = share.number, share.start + time, duration
    cubic, span = rows.coefficients[row], share.span
    cubic[0], cubic[1] = motion.way / span, motion.speed / span
    cubic[2], cubic[3] = 0.5 * motion.acceleration / span, motion.jerk / 6.0 / span
    return row + 1


@njit(cache=True, error_model="numpy", _nrt=False)
def _emit_kernel(corners: Corners, k: int, end: float, share: Share, pen: Pen, row: int) -> tuple[int, float]:
    """Write the kernel of corner ``k``: what is gone of a line's first segment (``end`` 0) or the end of its last (1).

    Returns the next free row, and when the kernel ends [s].
    """
    kernel, rows, chosen, time = pen.kernel, pen.outbox, corners.chosen[k], share.start
    state, length = decided(corners, k), corners.scales[k, chosen, 0]
    if state.duration > 0.0 and length < 0.0:
        fill_plain(state.size, state.speed, kernel)
    elif state.duration > 0.0:
        copy_scaled(corners.kernels[k], length, corners.scales[k, chosen, 1], kernel)
    else:
        return row, time
    cubics, span = (kernel.gone, share.span) if end == 0.0 else (kernel.remaining, -share.span)
    for p in range(PIECES):
        duration = kernel.durations[p]
        if duration > 0.0:
            rows.segments[row], rows.starts[row], rows.durations[row] = share.number, time, duration
            for c in range(4):
                rows.coefficients[row, c] = cubics[p, c] / span
            rows.coefficients[row, 0] += end
            row, time = row + 1, time + duration
    return row, time
