"""Way points in, schedule rows out, with a look-ahead of eight merged segments and constant memory (layer 6).

Every way point goes the same way however many come at once, so the output does not depend on how the input is cut.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import CAPACITY, LOOKAHEAD, SPEED, Corners, Segments
from polish_sim.motion.certified.connector import LineLimits
from polish_sim.motion.certified.corner_fit import fill_corner
from polish_sim.motion.certified.course import Course, bends_hold, fill_bend, slow_bend
from polish_sim.motion.certified.emit import Place, emit_line, lay_bends, lay_law
from polish_sim.motion.certified.merge import Run, chord_deviation, joins, store_point
from polish_sim.motion.certified.robot import fill_limits
from polish_sim.motion.certified.shift import move_corner, move_line, move_row, move_segment, move_way_point
from polish_sim.motion.certified.stream_state import (
    FIRST,
    GIVEN,
    HELD,
    LAST,
    LINES,
    NO_LAW,
    OPEN,
    OUT_ROWS,
    OUT_SEGMENTS,
    RAW,
    RAW_END,
    RELAID,
    SEGMENTS,
    STATUS,
    Stream,
)
from polish_sim.motion.certified.strings import close_line, may_string, open_line, string_segment
from polish_sim.motion.certified.window import (
    best_before_stop,
    decide,
    decide_all,
    forget_past,
    limits_between,
    reach_corner,
)
from polish_sim.motion.rules.chain import fill_segment
from polish_sim.motion.segment_rates import REACHED

Array = NDArray[np.float64]

_SLOWINGS, _SLOWER = 25, 0.85
_SHORTENINGS, _SHORTER = 3, 0.8
"""Where speed changes along a bend it bulges more than planned for: it is laid shorter before the line is slowed."""


@njit(cache=True, error_model="numpy", _nrt=False)
def take_points(stream: Stream, course: Course, tips: Array, rotations: Array, feeds: Array, ends: bool) -> None:
    """Take in way points, at most BLOCK; the outbox is emptied first.

    Every large step stands here once, so that it is compiled once.

    Args:
        stream: Changed.
        course: What stays the same.
        tips: [m], shape (n, 3).
        rotations: Tool frames, shape (n, 3, 3).
        feeds: Cap on the tip's speed on the way to each of them [m/s], shape (n,).
        ends: Whether the path ends after them: two more steps then close the last run and the last line.
    """
    counters, count = stream.counters, tips.shape[0]
    counters[OUT_SEGMENTS] = counters[OUT_ROWS] = 0
    for i in range(count + 2 if ends else count):
        if i < count:
            ready = _offer_point(stream, course, tips[i], rotations[i], feeds[i])
        else:
            ready = i == count and _end_run(stream)
        added = ready and _add_segment(stream, course)
        if counters[STATUS] != REACHED:
            break
        if ready and i < count:
            _restart_run(stream.run, counters)
        closing = (added and not _string(stream, course)) or (i > count and counters[OPEN] > 0)
        if closing:
            _close_line(stream, course, counters[SEGMENTS] - (2 if added else 1))
        if added and closing:
            open_line(stream.segments, stream.lines, counters[LINES], counters[SEGMENTS] - 1)
            counters[OPEN] = 1
        until = _decide(stream, i > count) if closing or i > count else counters[GIVEN]
        while counters[GIVEN] < until and counters[STATUS] == REACHED:
            _give_line(stream, course)
        if counters[STATUS] != REACHED:
            break


@njit(cache=True, error_model="numpy", inline="always")
def _offer_point(stream: Stream, course: Course, tip: Array, rotation: Array, feed: float) -> bool:
    """Lead the run on to a way point; true if it must be closed before it."""
    counters, held = stream.counters, stream.counters[HELD]
    store_point(stream.run, held, tip, rotation, feed)
    counters[RAW] += 1
    counters[HELD] = held + 1
    counters[LAST], counters[RAW_END] = held - 1, counters[RAW] - 2
    return bool(held > 1 and not joins(stream.run, held, course.shares))


@njit(cache=True, error_model="numpy", inline="always")
def _end_run(stream: Stream) -> bool:
    """The path ends with the run; true if there is anything in it."""
    counters = stream.counters
    counters[LAST], counters[RAW_END] = counters[HELD] - 1, counters[RAW] - 1
    return bool(counters[LAST] > 0)


@njit(cache=True, error_model="numpy", inline="always")
def _restart_run(run: Run, counters: NDArray[np.int64]) -> None:
    """Begin a run with the last two way points of the old one."""
    for to in range(2):
        i = counters[LAST] + to
        store_point(run, to, run.tips[i], run.rotations[i], run.feeds[i])
    counters[HELD] = 2


@njit(cache=True, error_model="numpy", inline="always")
def _add_segment(stream: Stream, course: Course) -> bool:
    """The chord of the run becomes a segment; false if it leads nowhere or the robot cannot follow."""
    counters, segments, last = stream.counters, stream.segments, stream.counters[LAST]
    if counters[SEGMENTS] == CAPACITY:
        _move_to_front(stream)
    k = counters[SEGMENTS]
    if k == 0:
        _set_way_point(segments, 0, stream.run, 0)
    _set_way_point(segments, k + 1, stream.run, last)
    fill_segment(segments.chain, k)
    if segments.chain.lengths[k] == 0.0 and segments.chain.angles[k] == 0.0:
        return False
    counters[STATUS] = fill_limits(segments, k, stream.run.feeds[last], course.limits, course.arm, stream.robot)
    if counters[STATUS] != REACHED:
        return False
    deviation = chord_deviation(stream.run, last)
    segments.used[k, 0], segments.used[k, 1] = deviation.tip, deviation.axis
    segments.raw_ends[k] = counters[RAW_END]
    counters[SEGMENTS] = k + 1
    return True


@njit(cache=True, error_model="numpy", inline="always")
def _string(stream: Stream, course: Course) -> bool:
    """Put the newest segment on the open line; false if that must be closed before it."""
    segments, lines, counters = stream.segments, stream.lines, stream.counters
    line, k = counters[LINES], counters[SEGMENTS] - 1
    if counters[OPEN] == 0:
        open_line(segments, lines, line, k)
        counters[OPEN] = 1
        return True
    fill_bend(segments, k, course)
    if not may_string(segments, lines, line, k):
        return False
    slow_bend(segments, k, course, stream.robot)
    if not may_string(segments, lines, line, k):
        return False
    string_segment(segments, lines, line, k)
    return True


@njit(cache=True, error_model="numpy", inline="always")
def _close_line(stream: Stream, course: Course, last: int) -> None:
    """The open line ends with segment ``last``; its start becomes a corner."""
    counters, lines, corners, k = stream.counters, stream.lines, stream.corners, stream.counters[LINES]
    close_line(stream.segments, lines, k, last)
    counters[LINES], counters[OPEN] = k + 1, 0
    if k > 0:
        fill_corner(stream.segments, lines, corners, k, course, stream.robot)
        reach_corner(lines, corners, k)


@njit(cache=True, error_model="numpy", inline="always")
def _decide(stream: Stream, ends: bool) -> int:
    """Decide on the oldest open corner once the look-ahead is full, on all if the path ends.

    Returns:
        Which line to give out lines up to.
    """
    counters, lines, corners = stream.counters, stream.lines, stream.corners
    given, last = counters[GIVEN], counters[LINES] - 1
    if last < 0 or not (ends or last - given == LOOKAHEAD):
        return int(given)
    state = best_before_stop(lines, corners, last)
    if ends:
        decide_all(corners, given + 1, last, state)
        _set_stop(corners, last + 1)
        return int(last + 1)
    decide(corners, given + 1, last, state)
    forget_past(corners, given + 1, last)
    return int(given + 1)


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _set_way_point(segments: Segments, i: int, run: Run, source: int) -> None:
    chain = segments.chain
    for j in range(3):
        chain.tips[i, j] = run.tips[source, j]
        for c in range(3):
            chain.rotations[i, j, c] = run.rotations[source, j, c]
    size = 0.0
    for j in range(3):
        size += run.rotations[source, j, 2] ** 2
    for j in range(3):
        chain.axes[i, j] = run.rotations[source, j, 2] / np.sqrt(size)


@njit(cache=True, error_model="numpy")
def _set_stop(corners: Corners, k: int) -> None:
    """The path ends at rest: state 0."""
    corners.chosen[k] = 0
    for c in range(4):
        corners.states[k, 0, c] = 0.0
    corners.scales[k, 0] = 0.0


@njit(cache=True, error_model="numpy", inline="always")
def _give_line(stream: Stream, course: Course) -> None:
    """Put the oldest line into the outbox; both its corners are decided."""
    counters, box, lines, k = stream.counters, stream.outbox, stream.lines, stream.counters[GIVEN]
    _lay_line(stream, course, k)
    if counters[STATUS] != REACHED:
        return
    place = Place(k, counters[FIRST], counters[OUT_ROWS])
    row, time = emit_line(stream.segments, lines, stream.corners, box.pen, place, stream.clock[0])
    for i in range(lines.first[k], lines.first[k + 1]):
        _give_way_point(stream, i)
    stream.clock[0] = time
    counters[GIVEN], counters[OUT_ROWS] = k + 1, row


@njit(cache=True, error_model="numpy", inline="always")
def _lay_line(stream: Stream, course: Course, k: int) -> None:
    """Lay law and bends of line ``k``; bends shorter, then the line slower if one breaks a limit or finds no room."""
    corners = stream.corners
    first, second = corners.chosen[k], corners.chosen[k + 1]
    limits = limits_between(stream.lines, k, corners.states[k, first, SPEED], corners.states[k + 1, second, SPEED])
    pen = stream.outbox.pen
    for attempt in range(_SLOWINGS * _SHORTENINGS):
        slow = _SLOWER ** (attempt // _SHORTENINGS)
        slower = LineLimits(limits.speed * slow, limits.acceleration * slow**2, limits.jerk * slow**3)
        if np.isnan(lay_law(stream.lines, corners, k, slower, pen)):
            break
        if lay_bends(stream.segments, stream.lines, k, pen, _SHORTER ** (attempt % _SHORTENINGS)) and bends_hold(
            stream.segments, stream.lines, k, course, pen, stream.robot
        ):
            return
        stream.counters[RELAID] += 1
    stream.counters[STATUS] = NO_LAW


@njit(cache=True, error_model="numpy", inline="always")
def _give_way_point(stream: Stream, k: int) -> None:
    """Put the end of segment ``k`` into the outbox."""
    box, chain, m = stream.outbox, stream.segments.chain, stream.counters[OUT_SEGMENTS]
    for j in range(3):
        box.tips[m, j] = chain.tips[k + 1, j]
        for c in range(3):
            box.rotations[m, j, c] = chain.rotations[k + 1, j, c]
    box.raw_ends[m] = stream.segments.raw_ends[k]
    stream.counters[OUT_SEGMENTS] = m + 1


@njit(cache=True, error_model="numpy", inline="always")
def _move_to_front(stream: Stream) -> None:
    """Move what is still needed to the front of the buffers."""
    counters, lines = stream.counters, stream.lines
    shift, last = counters[GIVEN], counters[LINES]
    moved, count = lines.first[shift], counters[SEGMENTS]
    for k in range(shift, last + 1):
        move_corner(stream.corners, k, k - shift)
        move_line(lines, k, k - shift, moved)
    for k in range(moved, count + 1):
        move_way_point(stream.segments.chain, k, k - moved)
        move_row(stream.robot.q, k - moved, k)
    for k in range(moved, count):
        move_segment(stream.segments, k, k - moved)
    counters[FIRST] += moved
    counters[SEGMENTS] -= moved
    counters[LINES] -= shift
    counters[GIVEN] = 0
