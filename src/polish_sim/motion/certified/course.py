"""What stays the same along a stream, and corners and bends made with it (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.bends import LINE_SHARE, axis_vectors, off_axis, off_line, plan_bend, tip_vectors
from polish_sim.motion.certified.buffers import Lines, Segments
from polish_sim.motion.certified.corner_proof import prove_kernel
from polish_sim.motion.certified.corner_shapes import PIECES, CornerShapes, corner_shapes
from polish_sim.motion.certified.corners import Tolerances, corner_limits, corner_weights
from polish_sim.motion.certified.emit import Pen, bend_of
from polish_sim.motion.certified.law import Law, Turning, bend_load, gone_at, law_at, next_break
from polish_sim.motion.certified.merge import Shares
from polish_sim.motion.certified.plain import fill_plain
from polish_sim.motion.certified.robot import Robot, base_sides
from polish_sim.motion.certified.strings import segment_line
from polish_sim.motion.rules.limits import Arm, LimitValues

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
def fill_bend(segments: Segments, k: int, course: Course) -> None:
    """Plan the bend before segment ``k`` as if it lay within a line, as tip and axis allow."""
    limits = corner_limits(
        segments, k, course.limits, course.tolerances, segment_line(segments, k - 1), segment_line(segments, k)
    )
    bend = plan_bend(corner_weights(segments, k), limits, min(segments.spans[k - 1], segments.spans[k]))
    segments.bends[k, 0], segments.bends[k, 1] = bend.length, min(bend.speed, limits.segment_speed)


@njit(cache=True, error_model="numpy", inline="always")
def slow_bend(segments: Segments, k: int, course: Course, robot: Robot) -> None:
    """Slow the bend before segment ``k`` down for the joints."""
    length, speed = segments.bends[k, 0], segments.bends[k, 1]
    kernel = robot.kernel
    fill_plain(0.5 * length, speed, kernel.durations, kernel.remaining, kernel.gone)
    sides = base_sides(segments, k, course.arm, robot)
    segments.bends[k, 1] = (
        speed / prove_kernel(sides, kernel, course.bend_limits, course.arm, robot.q[k], robot.proof).factor
    )


@njit(cache=True, error_model="numpy", inline="always")
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
        sides = base_sides(segments, i, course.arm, robot)
        proof = prove_kernel(sides, robot.kernel, course.limits, course.arm, robot.q[i], robot.proof)
        if proof.factor > _SLACK:
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
        robot.kernel.durations[p] = then - time
        _fill_cubic(robot.kernel.gone[p], gone.way, gone.speed, gone.acceleration, jerk)
        left = way - line.way + gone.way
        _fill_cubic(
            robot.kernel.remaining[p],
            left,
            gone.speed - line.speed,
            gone.acceleration - line.acceleration,
            jerk - line.jerk,
        )
        time, p = then, p + 1
    for rest in range(p, PIECES):
        robot.kernel.durations[rest] = 0.0
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
