"""What stays the same along a stream, and corners and bends made with it (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.certified.bends import (
    LINE_SHARE,
    axis_vectors,
    off_axis,
    off_line,
    plan_bend,
    tip_vectors,
)
from polish_sim.motion.certified.buffers import Corners, Lines, Segments
from polish_sim.motion.certified.corner import (
    PIECES,
    CornerFigures,
    CornerLimits,
    CornerShapes,
    corner_kernel,
    corner_shapes,
)
from polish_sim.motion.certified.corner_factor import CornerFactor, corner_factor
from polish_sim.motion.certified.corners import (
    Tolerances,
    corner_limits,
    corner_weights,
    lay_out_plain,
    lay_out_states,
    lines_slowing,
    room_scale,
    shrink_to_room,
    shrunk,
    slow_down,
)
from polish_sim.motion.certified.emit import Pen, bend_of
from polish_sim.motion.certified.law import Law, Turning, bend_load, gone_at, law_at, next_break
from polish_sim.motion.certified.merge import Shares
from polish_sim.motion.certified.plain import fill_plain, plain_kernel
from polish_sim.motion.certified.robot import Robot, base_segment
from polish_sim.motion.certified.strings import segment_line
from polish_sim.motion.certified.window import line_limits
from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.limits import LimitValues

Array = NDArray[np.float64]

_SLACK = 1.0 + 1e-9
_REFITTED = 0.7
"""Kernels the joints leave less of are made anew."""


class Course(NamedTuple):
    """What stays the same along a stream."""

    limits: LimitValues
    bend_limits: LimitValues
    """The same with the share of joint acceleration and jerk that is left for bends."""
    tolerances: Tolerances
    shares: Shares
    shapes: CornerShapes
    arm: Arm


def new_course(limits: LimitValues, tolerances: Tolerances, shares: Shares, arm: Arm) -> Course:
    """Put together what stays the same along a stream."""
    left = limits.joint * np.array([1.0, 1.0 - LINE_SHARE, 1.0 - LINE_SHARE])[:, None]
    return Course(limits, limits._replace(joint=left), tolerances, shares, corner_shapes(), arm)


@njit(cache=True, error_model="numpy")
def _joint_factor(
    segments: Segments,
    k: int,
    limits: LimitValues,
    arm: Arm,
    robot: Robot,
    durations: Array,
    remaining: Array,
    gone: Array,
) -> CornerFactor:
    """What axis and joints say of a kernel at the corner before segment ``k``."""
    old, new = base_segment(segments, k - 1, arm, robot, 0), base_segment(segments, k, arm, robot, 1)
    spans = (segments.spans[k - 1], segments.spans[k])
    for j in range(6):
        robot.vertex[j] = robot.q[k, j]
    return corner_factor(old, new, spans, durations, remaining, gone, limits, arm, robot.vertex, robot.corner)


@njit(cache=True, error_model="numpy")
def fill_corner(segments: Segments, lines: Lines, corners: Corners, k: int, course: Course, robot: Robot) -> None:
    """Find the kernel of the corner before line ``k`` and lay out its states."""
    segment = lines.first[k]
    limits = corner_limits(
        segments, segment, course.limits, course.tolerances, line_limits(lines, k - 1), line_limits(lines, k)
    )
    durations, remaining, gone = corners.durations[k], corners.remaining[k], corners.gone[k]
    figures, share = CornerFigures(0.0, 0.0, 0.0, 0.0), 1.0
    for _ in range(2):
        figures = corner_kernel(corner_weights(segments, segment), limits, course.shapes, durations, remaining, gone)
        figures, share = shrink_to_room(lines, corners, k, figures), 1.0
        if figures.duration > 0.0:
            factor = _joint_factor(segments, segment, course.limits, course.arm, robot, durations, remaining, gone)
            share = factor.size
            figures = slow_down(corners, k, figures, factor.slowdown)
        if not 0.0 < share < _REFITTED:
            break
        # A kernel made for a smaller tolerance loses less time than a large one scaled down.
        limits = _with_less_tolerance(limits, share**1.3)
    figures = slow_down(corners, k, figures, lines_slowing(lines, k, figures))
    if not lay_out_states(lines, corners, k, figures, share):
        _add_plain(segments, lines, corners, k, course, robot, limits)


@njit(cache=True, error_model="numpy")
def _with_less_tolerance(limits: CornerLimits, share: float) -> CornerLimits:
    """The same limits with a share of both tolerances."""
    return CornerLimits(
        limits.speed,
        limits.acceleration,
        limits.jerk,
        limits.tip_tolerance * share,
        limits.axis_speed,
        limits.axis_acceleration,
        limits.axis_jerk,
        limits.axis_tolerance * share,
        limits.segment_speed,
        limits.segment_acceleration,
        limits.segment_jerk,
    )


@njit(cache=True, error_model="numpy")
def _add_plain(
    segments: Segments, lines: Lines, corners: Corners, k: int, course: Course, robot: Robot, limits: CornerLimits
) -> None:
    """Add the states of a plain kernel to a corner without much room."""
    segment = lines.first[k]
    figures, share = plain_kernel(corner_weights(segments, segment), limits), 1.0
    figures = shrunk(figures, room_scale(lines, k, figures.size))
    if figures.duration > 0.0:
        fill_plain(figures.size, figures.speed, robot.durations, robot.remaining, robot.gone)
        factor = _joint_factor(
            segments, segment, course.limits, course.arm, robot, robot.durations, robot.remaining, robot.gone
        )
        slowed, share = factor.slowdown, factor.size
        figures = CornerFigures(figures.size, figures.speed / slowed, 0.0, figures.duration * slowed)
    slowed = lines_slowing(lines, k, figures)
    figures = CornerFigures(figures.size, figures.speed / slowed, 0.0, figures.duration * slowed)
    lay_out_plain(lines, corners, k, figures, share)


@njit(cache=True, error_model="numpy")
def fill_bend(segments: Segments, k: int, course: Course) -> None:
    """Plan the bend before segment ``k`` as if it lay within a line, as tip and axis allow."""
    limits = corner_limits(
        segments, k, course.limits, course.tolerances, segment_line(segments, k - 1), segment_line(segments, k)
    )
    bend = plan_bend(corner_weights(segments, k), limits, min(segments.spans[k - 1], segments.spans[k]))
    segments.bends[k, 0], segments.bends[k, 1] = bend.length, min(bend.speed, limits.segment_speed)


@njit(cache=True, error_model="numpy")
def slow_bend(segments: Segments, k: int, course: Course, robot: Robot) -> None:
    """Slow the bend before segment ``k`` down for the joints."""
    length, speed = segments.bends[k, 0], segments.bends[k, 1]
    fill_plain(0.5 * length, speed, robot.durations, robot.remaining, robot.gone)
    factor = _joint_factor(
        segments, k, course.bend_limits, course.arm, robot, robot.durations, robot.remaining, robot.gone
    )
    segments.bends[k, 1] = speed / factor.slowdown if factor.size == 1.0 else 0.0


@njit(cache=True, error_model="numpy")
def bends_hold(segments: Segments, lines: Lines, k: int, course: Course, pen: Pen, robot: Robot) -> bool:
    """Whether all bends laid in line ``k`` keep limits and tolerances at every instant, tip, axis and joints."""
    way = 0.0
    for i in range(lines.first[k] + 1, lines.first[k + 1]):
        way += segments.spans[i - 1]
        turning = bend_of(pen, i - lines.first[k])
        if not _tool_holds(segments, i, way, course, pen.law, turning):
            return False
        if not _fill_actual(robot, pen.law, turning, way):
            return False
        factor = _joint_factor(
            segments, i, course.limits, course.arm, robot, robot.durations, robot.remaining, robot.gone
        )
        if factor.size < 1.0 or factor.slowdown > _SLACK:
            return False
    return True


@njit(cache=True, error_model="numpy")
def _fill_actual(robot: Robot, law: Law, turning: Turning, way: float) -> bool:
    """A bend as it is laid, as pieces of a kernel; false if there are not enough of them."""
    time, end, p = turning.begin, turning.begin + turning.duration, 0
    while time < end:
        then = next_break(law, turning, time)
        if then <= time or p == PIECES:
            break
        line, gone = law_at(law, time), gone_at(turning, time)
        jerk = gone_at(turning, 0.5 * (time + then)).jerk
        robot.durations[p] = then - time
        _fill_cubic(robot.gone[p], gone.way, gone.speed, gone.acceleration, jerk)
        left = way - line.way + gone.way
        _fill_cubic(
            robot.remaining[p],
            left,
            gone.speed - line.speed,
            gone.acceleration - line.acceleration,
            jerk - line.jerk,
        )
        time, p = then, p + 1
    for rest in range(p, PIECES):
        robot.durations[rest] = 0.0
    return time >= end


@njit(cache=True, error_model="numpy")
def _fill_cubic(row: Array, way: float, speed: float, acceleration: float, jerk: float) -> None:
    row[0], row[1], row[2], row[3] = way, speed, 0.5 * acceleration, jerk / 6.0


@njit(cache=True, error_model="numpy")
def _tool_holds(segments: Segments, i: int, way: float, course: Course, law: Law, turning: Turning) -> bool:
    """Whether one bend keeps limits and tolerances of tip and axis."""
    weights = corner_weights(segments, i)
    limits = corner_limits(
        segments, i, course.limits, course.tolerances, segment_line(segments, i - 1), segment_line(segments, i)
    )
    tip, axis = tip_vectors(weights), axis_vectors(weights)
    tip_load, axis_load = bend_load(law, turning, tip), bend_load(law, turning, axis)
    middle = turning.begin + 0.5 * turning.duration
    gone = gone_at(turning, middle).way
    # One falls, the other rises: where they meet neither is above both at any one time.
    nearest = max(gone, way + gone - law_at(law, middle).way)
    return (
        tip_load.forwards
        and tip_load.acceleration <= limits.acceleration * _SLACK
        and tip_load.jerk <= limits.jerk * _SLACK
        and axis_load.acceleration <= limits.axis_acceleration * _SLACK
        and axis_load.jerk <= limits.axis_jerk * _SLACK
        and nearest * off_line(tip) <= limits.tip_tolerance * _SLACK
        and nearest * off_axis(weights) <= limits.axis_tolerance * _SLACK
    )
