"""Way points in, schedule rows out, with a look-ahead of eight lines and constant memory.

Every way point goes the same way however many come at once, so the output does not depend on how the input is cut.
"""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record
from polish_sim.motion.certified import fitting, line, window
from polish_sim.motion.certified.bends import close_line, may_string, open_line, plan_bend, string_segment
from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.corner import CornerShapes
from polish_sim.motion.certified.fitting import Course, Robot
from polish_sim.motion.certified.kernel import Figures
from polish_sim.motion.certified.line import Pen
from polish_sim.motion.certified.merge import Run, chord_deviation, joins, store_point
from polish_sim.motion.certified.window import BLOCK, CAPACITY, LOOKAHEAD, Corners, Lines, Segments
from polish_sim.motion.rules.chain import fill_segment
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.segment_rates import REACHED

NO_LAW = 9  #: Status: no law was found that keeps a line's bends in their limits
_SLOWINGS, _SLOWER = 25, 0.85
_SHORTENINGS, _SHORTER = 3, 0.8  #: Where speed changes a bend bulges: it is laid shorter before its line is slowed


class Stream(Record):
    """All a stream remembers."""

    held: int  #: Way points in the run
    raw: int  #: Way points taken in
    last: int  #: The run's last one
    raw_end: int  #: Its number of all
    count: int  #: Segments in the buffers
    before: int  #: Number of the buffers' first one
    closed: int  #: Closed lines in the buffers
    given: int  #: Next line to give
    out_segments: int  #: Segments in the outbox
    out_rows: int  #: Rows in the outbox
    status: int  #: REACHED or what went wrong
    is_open: bool  #: Whether a line is open
    clock: float  #: When the corner behind the next line to give begins [s]
    run: Run
    segments: Segments
    lines: Lines
    corners: Corners
    pen: Pen
    robot: Robot


def new_stream(arm: Arm) -> Stream:
    """A stream before its first way point: at corner 0, at rest, with the arm's joints at its start."""
    stream = Stream()
    stream.segments.q[0] = arm.q_start
    corners = stream.corners
    corners.levels[:], corners.costs[:], corners.chosen[:] = 1, np.inf, -1
    corners.costs[0, 0], corners.chosen[0] = 0.0, 0
    return stream


def make_room(stream: Stream) -> None:
    """Drop what has been given out if the buffers could overflow with the next block."""
    if stream.count + BLOCK + 2 < CAPACITY:
        return
    moved = window.move_to_front(stream.segments, stream.lines, stream.corners, stream.given, stream.closed)
    stream.before += moved
    stream.count -= moved
    stream.closed -= stream.given
    stream.given = 0


@njit(cache=True, error_model="numpy", _nrt=False)
def take_points(
    stream: Stream, course: Course, shapes: CornerShapes, tips: Array, rotations: Array, feeds: Array, ends: bool
) -> None:
    """Take in way points, at most BLOCK; the outbox is emptied first.

    Every large step stands here once, so that it is compiled once. Arguments as of `Smoother.feed`; if the path
    ``ends`` after these points, two more steps close the last run and the last line.
    """
    count = tips.shape[0]
    stream.out_segments = stream.out_rows = 0
    for i in range(count + 2 if ends else count):
        if i < count:
            ready = _offer_point(stream, course, tips[i], rotations[i], feeds[i])
        else:
            stream.last, stream.raw_end = stream.held - 1, stream.raw - 1
            ready = i == count and stream.last > 0
        added = ready and _add_segment(stream, course)
        if stream.status != REACHED:
            break
        if ready and i < count:
            # The next run begins with the last two way points of this one.
            run = stream.run
            for to in range(2):
                source = stream.last + to
                store_point(run, to, run.tips[source], run.rotations[source], run.feeds[source])
            stream.held = 2
        closing = (added and not _string(stream, course)) or (i > count and stream.is_open)
        if closing:
            _close_line(stream, course, shapes, stream.count - (2 if added else 1))
        if added and closing:
            open_line(stream.segments, stream.lines, stream.closed, stream.count - 1)
            stream.is_open = True
        until = _decide(stream, i > count) if closing or i > count else stream.given
        while stream.given < until and stream.status == REACHED:
            _give_line(stream, course)
        if stream.status != REACHED:
            break


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _offer_point(stream: Stream, course: Course, tip: Array, rotation: Array, feed: float) -> bool:
    """Lead the run on to a way point; true if it must be closed before it."""
    held = stream.held
    store_point(stream.run, held, tip, rotation, feed)
    stream.raw += 1
    stream.held = held + 1
    stream.last, stream.raw_end = held - 1, stream.raw - 2
    return bool(held > 1 and not joins(stream.run, held, course.shares))


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _add_segment(stream: Stream, course: Course) -> bool:
    """The chord of the run becomes a segment; false if it leads nowhere or the robot cannot follow."""
    segments, last, k = stream.segments, stream.last, stream.count
    if k == 0:
        _set_way_point(segments, 0, stream.run, 0)
    _set_way_point(segments, k + 1, stream.run, last)
    fill_segment(segments, k)
    if segments.lengths[k] == 0.0 and segments.angles[k] == 0.0:
        return False
    stream.status = fitting.fill_limits(segments, k, stream.run.feeds[last], course.limits, course.arm, stream.robot)
    if stream.status != REACHED:
        return False
    segments.used[k, 0], segments.used[k, 1] = chord_deviation(stream.run, last)
    segments.raw_ends[k] = stream.raw_end
    stream.count = k + 1
    return True


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _set_way_point(segments: Segments, i: int, run: Run, source: int) -> None:
    size = 0.0
    for j in range(3):
        segments.tips[i, j] = run.tips[source, j]
        size += run.rotations[source, j, 2] ** 2
        for c in range(3):
            segments.rotations[i, j, c] = run.rotations[source, j, c]
    for j in range(3):
        segments.axes[i, j] = run.rotations[source, j, 2] / np.sqrt(size)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _string(stream: Stream, course: Course) -> bool:
    """Put the newest segment on the open line; false if that must be closed before it."""
    segments, lines, n, k = stream.segments, stream.lines, stream.closed, stream.count - 1
    if not stream.is_open:
        open_line(segments, lines, n, k)
        stream.is_open = True
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
def _close_line(stream: Stream, course: Course, shapes: CornerShapes, last: int) -> None:
    """The open line ends with segment ``last``; its start becomes a corner."""
    lines, corners, k = stream.lines, stream.corners, stream.closed
    close_line(stream.segments, lines, k, last)
    stream.closed, stream.is_open = k + 1, False
    if k > 0:
        fitting.fill_corner(stream.segments, lines, corners, k, course, shapes, stream.robot)
        window.reach_corner(lines, corners, k)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _decide(stream: Stream, ends: bool) -> int:
    """Decide on the oldest open corner once the look-ahead is full, on all if the path ends; returns a line.

    Lines up to that one can be given out.
    """
    lines, corners, given, last = stream.lines, stream.corners, stream.given, stream.closed - 1
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
    box, segments, lines, k = stream.pen.outbox, stream.segments, stream.lines, stream.given
    _lay_line(stream, course, k)
    if stream.status != REACHED:
        return
    stream.out_rows, stream.clock = line.emit_line(
        segments, lines, stream.corners, stream.pen, k, stream.before, stream.out_rows, stream.clock
    )
    for i in range(lines.first[k], lines.first[k + 1]):
        m = stream.out_segments
        for j in range(3):
            box.tips[m, j] = segments.tips[i + 1, j]
            for c in range(3):
                box.rotations[m, j, c] = segments.rotations[i + 1, j, c]
        box.way_points[m] = segments.raw_ends[i]
        stream.out_segments = m + 1
    stream.given = k + 1


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _lay_line(stream: Stream, course: Course, k: int) -> None:
    """Lay law and bends of line ``k``; bends shorter, then the line slower if one breaks a limit or finds no room."""
    corners, pen = stream.corners, stream.pen
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
    stream.status = NO_LAW


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
