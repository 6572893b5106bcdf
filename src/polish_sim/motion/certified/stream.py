"""Way points in, schedule rows out, with a look-ahead of eight lines and constant memory.

Every way point goes the same way however many come at once, so the output does not depend on how the input is cut.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.motion.certified import fitting, line, window
from polish_sim.motion.certified.bends import close_line, may_string, open_line, plan_bend, string_segment
from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.fitting import Course, Robot, new_robot
from polish_sim.motion.certified.kernel import Figures
from polish_sim.motion.certified.line import Pen, new_pen
from polish_sim.motion.certified.merge import Run, chord_deviation, empty_run, joins, store_point
from polish_sim.motion.certified.window import CAPACITY, LOOKAHEAD, MOST_STRUNG, Corners, Lines, Segments
from polish_sim.motion.rules.chain import fill_segment
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.segment_rates import REACHED

BLOCK = 128  #: Way points taken in at once: the rows they give fit the outbox, their segments the buffers
NO_LAW = 9  #: Status: no law was found that keeps a line's bends in their limits
_ROOM = BLOCK + (LOOKAHEAD + 2) * MOST_STRUNG
_SLOWINGS, _SLOWER = 25, 0.85
_SHORTENINGS, _SHORTER = 3, 0.8  #: Where speed changes a bend bulges: it is laid shorter before its line is slowed
_COUNTERS = (
    "held",
    "raw",
    "last",
    "raw_end",
    "segments",
    "first",
    "lines",
    "given",
    "out_segments",
    "out_rows",
    "status",
)
STATE = np.dtype([*((name, np.int64) for name in _COUNTERS), ("is_open", np.bool_), ("clock", np.float64)])
"""Way points in the run; taken in; the run's last one, and its number of all; segments in the buffers; number of the
buffers' first one; closed lines in the buffers; next line to give; segments and rows in the outbox; REACHED or what
went wrong; whether a line is open; when the corner behind the next line to give begins [s]."""


class Stream(NamedTuple):
    """All a stream remembers."""

    states: Any  #: One record of `STATE`, shape (1,)
    run: Run
    segments: Segments
    lines: Lines
    corners: Corners
    pen: Pen
    robot: Robot


def new_stream(arm: Arm) -> Stream:
    """A stream before its first way point."""
    return Stream(np.zeros(1, STATE), empty_run(), *window.new_buffers(arm.q_start), new_pen(_ROOM), new_robot())


def make_room(stream: Stream) -> None:
    """Drop what has been given out if the buffers could overflow with the next block."""
    state = stream.states[0]
    if state["segments"] + BLOCK + 2 < CAPACITY:
        return
    moved = window.move_to_front(stream.segments, stream.lines, stream.corners, state["given"], state["lines"])
    state["first"] += moved
    state["segments"] -= moved
    state["lines"] -= state["given"]
    state["given"] = 0


@njit(cache=True, error_model="numpy", _nrt=False)
def take_points(stream: Stream, course: Course, tips: Array, rotations: Array, feeds: Array, ends: bool) -> None:
    """Take in way points, at most BLOCK; the outbox is emptied first.

    Every large step stands here once, so that it is compiled once. Arguments as of `Smoother.feed`; if the path
    ``ends`` after these points, two more steps close the last run and the last line.
    """
    state, count = stream.states[0], tips.shape[0]
    state.out_segments = state.out_rows = 0
    for i in range(count + 2 if ends else count):
        if i < count:
            ready = _offer_point(stream, course, tips[i], rotations[i], feeds[i])
        else:
            state.last, state.raw_end = state.held - 1, state.raw - 1
            ready = i == count and state.last > 0
        added = ready and _add_segment(stream, course)
        if state.status != REACHED:
            break
        if ready and i < count:
            # The next run begins with the last two way points of this one.
            run = stream.run
            for to in range(2):
                source = state.last + to
                store_point(run, to, run.tips[source], run.rotations[source], run.feeds[source])
            state.held = 2
        closing = (added and not _string(stream, course)) or (i > count and state.is_open)
        if closing:
            _close_line(stream, course, state.segments - (2 if added else 1))
        if added and closing:
            open_line(stream.segments, stream.lines, state.lines, state.segments - 1)
            state.is_open = True
        until = _decide(stream, i > count) if closing or i > count else state.given
        while state.given < until and state.status == REACHED:
            _give_line(stream, course)
        if state.status != REACHED:
            break


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _offer_point(stream: Stream, course: Course, tip: Array, rotation: Array, feed: float) -> bool:
    """Lead the run on to a way point; true if it must be closed before it."""
    state, held = stream.states[0], stream.states[0].held
    store_point(stream.run, held, tip, rotation, feed)
    state.raw += 1
    state.held = held + 1
    state.last, state.raw_end = held - 1, state.raw - 2
    return bool(held > 1 and not joins(stream.run, held, course.shares))


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _add_segment(stream: Stream, course: Course) -> bool:
    """The chord of the run becomes a segment; false if it leads nowhere or the robot cannot follow."""
    state, segments, last = stream.states[0], stream.segments, stream.states[0].last
    k = state.segments
    if k == 0:
        _set_way_point(segments, 0, stream.run, 0)
    _set_way_point(segments, k + 1, stream.run, last)
    fill_segment(segments.chain, k)
    if segments.chain.lengths[k] == 0.0 and segments.chain.angles[k] == 0.0:
        return False
    state.status = fitting.fill_limits(segments, k, stream.run.feeds[last], course.limits, course.arm, stream.robot)
    if state.status != REACHED:
        return False
    segments.used[k, 0], segments.used[k, 1] = chord_deviation(stream.run, last)
    segments.raw_ends[k] = state.raw_end
    state.segments = k + 1
    return True


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _set_way_point(segments: Segments, i: int, run: Run, source: int) -> None:
    chain, size = segments.chain, 0.0
    for j in range(3):
        chain.tips[i, j] = run.tips[source, j]
        size += run.rotations[source, j, 2] ** 2
        for c in range(3):
            chain.rotations[i, j, c] = run.rotations[source, j, c]
    for j in range(3):
        chain.axes[i, j] = run.rotations[source, j, 2] / np.sqrt(size)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _string(stream: Stream, course: Course) -> bool:
    """Put the newest segment on the open line; false if that must be closed before it."""
    segments, lines, state = stream.segments, stream.lines, stream.states[0]
    n, k = state.lines, state.segments - 1
    if not state.is_open:
        open_line(segments, lines, n, k)
        state.is_open = True
        return True
    plan_bend(fitting.bend_at(segments, k, course), segments.bends[k])
    if not may_string(segments, lines, n, k):
        return False
    fitting.slow_bend(segments, k, course, stream.robot)
    if not may_string(segments, lines, n, k):
        return False
    string_segment(segments, lines, n, k)
    return True


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _close_line(stream: Stream, course: Course, last: int) -> None:
    """The open line ends with segment ``last``; its start becomes a corner."""
    state, lines, corners, k = stream.states[0], stream.lines, stream.corners, stream.states[0].lines
    close_line(stream.segments, lines, k, last)
    state.lines, state.is_open = k + 1, False
    if k > 0:
        fitting.fill_corner(stream.segments, lines, corners, k, course, stream.robot)
        window.reach_corner(lines, corners, k)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _decide(stream: Stream, ends: bool) -> int:
    """Decide on the oldest open corner once the look-ahead is full, on all if the path ends; returns a line.

    Lines up to that one can be given out.
    """
    state, lines, corners = stream.states[0], stream.lines, stream.corners
    given, last = state.given, state.lines - 1
    if last < 0 or not (ends or last - given == LOOKAHEAD):
        return int(given)
    best = window.best_before_stop(lines, corners, last)
    if ends:
        window.decide_all(corners, given + 1, last, best)
        corners.chosen[last + 1] = 0
        window.set_state(corners, last + 1, 0, Figures(0.0, 0.0, 0.0, 0.0), 0.0, 1.0)
        return int(last + 1)
    window.decide(corners, given + 1, last, best)
    return int(given + 1)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _give_line(stream: Stream, course: Course) -> None:
    """Put the oldest line into the outbox; both its corners are decided."""
    state, box, lines, k = stream.states[0], stream.pen.outbox, stream.lines, stream.states[0].given
    _lay_line(stream, course, k)
    if state.status != REACHED:
        return
    state.out_rows, state.clock = line.emit_line(
        stream.segments, lines, stream.corners, stream.pen, k, state.first, state.out_rows, state.clock
    )
    for i in range(lines.first[k], lines.first[k + 1]):
        chain, m = stream.segments.chain, state.out_segments
        for j in range(3):
            box.tips[m, j] = chain.tips[i + 1, j]
            for c in range(3):
                box.rotations[m, j, c] = chain.rotations[i + 1, j, c]
        box.way_points[m] = stream.segments.raw_ends[i]
        state.out_segments = m + 1
    state.given = k + 1


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _lay_line(stream: Stream, course: Course, k: int) -> None:
    """Lay law and bends of line ``k``; bends shorter, then the line slower if one breaks a limit or finds no room."""
    state, corners, pen = stream.states[0], stream.corners, stream.pen
    first, second = (
        window.state_of(corners, k, corners.chosen[k]),
        window.state_of(corners, k + 1, corners.chosen[k + 1]),
    )
    limits = window.limits_between(stream.lines, k, first.speed, second.speed)
    for attempt in range(_SLOWINGS * _SHORTENINGS):
        slow = _SLOWER ** (attempt // _SHORTENINGS)
        slower = Peaks(limits.speed * slow, limits.acceleration * slow**2, limits.jerk * slow**3)
        if np.isnan(line.lay_law(stream.lines, corners, k, slower, pen)):
            break
        if _lay_bends(stream, course, k, _SHORTER ** (attempt % _SHORTENINGS)):
            return
    state.status = NO_LAW


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _lay_bends(stream: Stream, course: Course, k: int, share: float) -> bool:
    """Place the bends of line ``k`` with a share of their planned lengths; whether all hold at every instant."""
    segments, pen, robot, way = stream.segments, stream.pen, stream.robot, 0.0
    first = stream.lines.first[k]
    for i in range(first + 1, stream.lines.first[k + 1]):
        way += segments.spans[i - 1]
        turning = line.lay_bend(segments, i, i - first, way, share, pen)
        if turning.duration <= 0.0:
            return False
        if not fitting.bend_holds(
            segments, i, line.fill_bend_kernel(pen.law, turning, way, robot.kernel), course, robot
        ):
            return False
    return True
