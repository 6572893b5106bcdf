"""Corners, bends and segments of the stream: what may be done there, every motion proven for tip, axis and joints."""

from __future__ import annotations

import math
from typing import Annotated

from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record, Vector2
from polish_sim.motion.certified import window
from polish_sim.motion.certified.bends import LINE_SHARE, fill_plain, off_line, plain_kernel
from polish_sim.motion.certified.connector import Ends, Peaks, least_distance
from polish_sim.motion.certified.corner import CornerShapes, corner_kernel, time_lost
from polish_sim.motion.certified.kernel import (
    PIECES,
    Corner,
    Figures,
    Kernel,
    copy_scaled,
    measure_peaks,
    runs_forwards,
    scaled_figures,
    side_of,
    with_less,
)
from polish_sim.motion.certified.merge import Shares
from polish_sim.motion.certified.proof import ProofWork, Sides, Slowdown, prove_kernel
from polish_sim.motion.certified.segment_limits import FASTEST, SHARPEST, SegmentWork, segment_limits
from polish_sim.motion.certified.window import FULL_LEVELS, LEVELS, Corners, Lines, Segments, peaks_of
from polish_sim.motion.rules.limits import Arm, LimitValues
from polish_sim.motion.segment_rates import Segment

_SHRINK, _SHRINKS = 0.8, 8  #: Kernels nothing can be proven of are made smaller, next to singularities
_REFITTED, _REFITS = 1.02, 2  #: Kernels the joints slow down by more are made anew for less acceleration or jerk
_SLACK = 1.0 + 1e-9


class Course(Record):
    """What stays the same along a stream."""

    limits: LimitValues
    bend_limits: LimitValues  #: The same with the share of joint acceleration and jerk that is left for bends
    tolerances: Vector2  #: Of tip and axis [m, rad]
    shares: Shares
    arm: Arm


class Robot(Record):
    """Work space of proofs."""

    sides: Annotated[list[Segment], (2,)]  #: Two segments in the base frame
    work: SegmentWork
    proof: ProofWork
    kernel: Kernel  #: A kernel or a bend to be looked at
    scaled: Kernel  #: Its smaller copies


def new_course(limits: LimitValues, tolerances: tuple[float, float], shares: Shares, arm: Arm) -> Course:
    """Put together what stays the same along a stream."""
    course = Course(limits, limits, tolerances, shares, arm)
    course.bend_limits.joint[1:] *= 1.0 - LINE_SHARE
    return course


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def set_side(side: Segment, segments: Segments, k: int, arm: Arm) -> None:
    """Write segment ``k`` as seen from the robot's base."""
    R, T = segments.rotations[k], arm.T_base_work
    tip, frame, direction, turn_axis = side.tip, side.rotation, side.direction, side.turn_axis
    side.length, side.angle, side.roll = segments.lengths[k], segments.angles[k], segments.rolls[k]
    for i in range(3):
        tip[i], direction[i], turn_axis[i] = T[i, 3], 0.0, 0.0
        for j in range(3):
            tip[i] += T[i, j] * segments.tips[k, j]
            direction[i] += T[i, j] * segments.directions[k, j]
            turn_axis[i] += T[i, j] * segments.turn_axes[k, j]
            frame[i, j] = T[i, 0] * R[0, j] + T[i, 1] * R[1, j] + T[i, 2] * R[2, j]


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def fill_limits(segments: Segments, k: int, feed: float, limits: LimitValues, arm: Arm, robot: Robot) -> int:
    """Write generalised length of segment ``k``, the limits along it and the joints at its end; returns a status.

    Its geometry and the joints at its start are known, ``feed`` is a cap on the tip's speed [m/s].
    """
    row, q = segments.limits[k], segments.q[k + 1]
    # Tip length that takes as long as a turn of the axis by one radian, at full speed [m].
    some = math.isinf(limits.axis_speed) or math.isinf(limits.tip_speed)
    radius = 1.0 if some else limits.tip_speed / limits.axis_speed
    span = max(segments.lengths[k], max(segments.angles[k], abs(segments.rolls[k])) * radius)
    segments.spans[k] = span
    for j in range(6):
        q[j] = segments.q[k, j]
    set_side(robot.sides[0], segments, k, arm)
    status = segment_limits(robot.sides[0], span, limits, arm, q, row, robot.work)
    cap = feed * span / segments.lengths[k] if segments.lengths[k] > 0.0 else math.inf
    for i in range(0, 6, 3):
        row[i] = min(row[i], FASTEST, cap)
        row[i + 2] = min(row[i + 2], SHARPEST)
        # More than this is never reached on the way to full speed.
        row[i + 1] = min(row[i + 1], math.sqrt(row[i] * row[i + 2]))
    return int(status)


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def corner_at(segments: Segments, k: int, course: Course, old: Peaks, new: Peaks) -> Corner:
    """The corner before segment ``k``, with limits along both sides and what merging has left of the tolerances.

    Where the joints hold a segment back, tip and axis are held back as much at its corners: there is then little left
    to slow down.
    """
    limits, spans, used = course.limits, segments.spans, segments.used
    along = cosine = 0.0
    for i in range(3):
        along += segments.directions[k - 1, i] * segments.directions[k, i]
        cosine += segments.turn_axes[k - 1, i] * segments.turn_axes[k, i]
    first, second = _held_back(segments, k - 1, limits), _held_back(segments, k, limits)
    acceleration, jerk = min(first[0], second[0]), min(first[1], second[1])
    tip = Peaks(limits.tip_speed, limits.tip_acceleration * acceleration, limits.tip_jerk * jerk)
    axis = Peaks(limits.axis_speed, limits.axis_acceleration * acceleration, limits.axis_jerk * jerk)
    off_tip = max(course.tolerances[0] - max(used[k - 1, 0], used[k, 0]), 0.0)
    off_axis = max(course.tolerances[1] - max(used[k - 1, 1], used[k, 1]), 0.0)
    one, two = spans[k - 1], spans[k]
    return Corner(
        side_of(segments.lengths[k - 1] / one, segments.lengths[k] / two, along, tip, off_tip, False),
        side_of(segments.angles[k - 1] / one, segments.angles[k] / two, cosine, axis, off_axis, True),
        Peaks(min(old.speed, new.speed), min(old.acceleration, new.acceleration), min(old.jerk, new.jerk)),
        (one, two),
    )


@njit(cache=True, error_model="numpy", _nrt=False)
def _held_back(segments: Segments, k: int, limits: LimitValues) -> tuple[float, float]:
    """Shares of acceleration and jerk that the joints leave of what tip and axis allow along a segment."""
    row, span = segments.limits[k], segments.spans[k]
    tip, axis = segments.lengths[k] / span, segments.angles[k] / span
    acceleration, jerk = math.sqrt(row[0] * row[2]), math.inf
    if tip > 0.0:
        acceleration, jerk = min(acceleration, limits.tip_acceleration / tip), limits.tip_jerk / tip
    if axis > 0.0:
        acceleration, jerk = min(acceleration, limits.axis_acceleration / axis), min(jerk, limits.axis_jerk / axis)
    return min(row[1] / acceleration, 1.0), 1.0 if math.isinf(jerk) else min(row[2] / jerk, 1.0)


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def prove(
    segments: Segments, k: int, corner: Corner, kernel: Kernel, limits: LimitValues, arm: Arm, robot: Robot
) -> Slowdown:
    """Prove a kernel or a bend before segment ``k`` for axis and joints."""
    old, new = robot.sides[0], robot.sides[1]
    set_side(old, segments, k - 1, arm)
    set_side(new, segments, k, arm)
    return prove_kernel(corner.axis, Sides(old, new, corner.spans), kernel, limits, arm, segments.q[k], robot.proof)


@njit(cache=True, error_model="numpy", _nrt=False)
def bend_at(segments: Segments, k: int, course: Course) -> Corner:
    """The corner before segment ``k`` as if it lay within a line."""
    return corner_at(segments, k, course, peaks_of(segments.limits, k - 1), peaks_of(segments.limits, k))


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def slow_bend(segments: Segments, k: int, course: Course, robot: Robot) -> None:
    """Slow the bend before segment ``k`` down for the joints."""
    bend, corner = segments.bends[k], bend_at(segments, k, course)
    fill_plain(0.5 * bend[0], bend[1], robot.kernel)
    bend[1] /= prove(segments, k, corner, robot.kernel, course.bend_limits, course.arm, robot).factor


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def bend_holds(segments: Segments, k: int, nearest: float, course: Course, robot: Robot) -> bool:
    """Whether the bend before segment ``k``, in the robot's kernel, keeps limits and tolerances at every instant.

    What is left of the old chord falls and what is gone of the new one rises: at no time are both above ``nearest``,
    the larger one in the middle [m].
    """
    corner, kernel = bend_at(segments, k, course), robot.kernel
    for side in (corner.tip, corner.axis):
        peaks, most = measure_peaks(side, kernel, PIECES), side.limits
        if peaks.acceleration > most.acceleration * _SLACK or peaks.jerk > most.jerk * _SLACK:
            return False
        if nearest * off_line(side) > side.tolerance * _SLACK:
            return False
    if not runs_forwards(kernel):
        return False
    return prove(segments, k, corner, kernel, course.limits, course.arm, robot).factor <= _SLACK


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def fill_corner(
    segments: Segments, lines: Lines, corners: Corners, k: int, course: Course, shapes: CornerShapes, robot: Robot
) -> None:
    """Find the kernels of the corner before line ``k`` and lay out its states, from an exact stop to the full one."""
    i = lines.first[k]
    corner = corner_at(segments, i, course, peaks_of(lines.limits, k - 1), peaks_of(lines.limits, k))
    stop = Figures(0.0, 0.0, 0.0, 0.0)
    corners.chosen[k], corners.levels[k] = -1, 1
    window.set_state(corners, k, 0, stop, 0.0, 1.0)
    full, factor, asked, soonest = stop, math.inf, corner, math.inf
    for _ in range(1 + _REFITS):
        figures, proof = _fit_kernel(segments, i, asked, lines, corner, k, course, shapes, robot)
        lost = time_lost(scaled_figures(figures, 1.0, proof.factor), corner.along)
        if not lost < soonest:
            break
        full, factor, soonest = figures, proof.factor, lost
        copy_scaled(robot.kernel, 1.0, 1.0, corners.kernels[k])
        if factor <= _REFITTED:
            break
        tip, axis = with_less(asked.tip, proof.joints), with_less(asked.axis, proof.joints)
        asked = Corner(tip, axis, corner.along, corner.spans)
    roomy = _is_roomy(lines, k, full)
    if math.isfinite(factor):
        levels = 2 if roomy else FULL_LEVELS
        corners.levels[k] = levels
        for state in range(levels - 1, 0, -1):
            scale = state / (levels - 1)
            if scale < 1.0:
                copy_scaled(corners.kernels[k], scale**3, scale, robot.scaled)
                factor = prove(segments, i, corner, robot.scaled, course.limits, course.arm, robot).factor
            figures = scaled_figures(full, scale**3, scale * factor)
            window.set_state(corners, k, state, figures, scale**3, scale * factor)
    if not (roomy and math.isfinite(factor)):
        _lay_out_plain(segments, i, corner, lines, corners, k, course, robot)


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _fit_kernel(
    segments: Segments, i: int, asked: Corner, lines: Lines, corner: Corner, k: int, course: Course,
    shapes: CornerShapes, robot: Robot,
) -> tuple[Figures, Slowdown]:  # fmt: skip
    """Fill the robot's kernel, as large as tolerances, lines and the arm allow; its figures before it is slowed."""
    kernel = robot.kernel
    figures = corner_kernel(asked, shapes, kernel)
    scale = _room_scale(lines, k, figures.size)
    proof = Slowdown(1.0, Peaks(0.0, 0.0, 0.0))
    for _ in range(_SHRINKS):
        figures = scaled_figures(figures, scale**3, scale)
        slowdown = _lines_slowing(lines, k, figures)
        figures = scaled_figures(figures, 1.0, slowdown)
        copy_scaled(kernel, scale**3, scale * slowdown, kernel)
        if figures.duration == 0.0:
            break
        proof = prove(segments, i, corner, kernel, course.limits, course.arm, robot)
        if math.isfinite(proof.factor):
            break
        scale = _SHRINK
    return figures, proof


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _lay_out_plain(
    segments: Segments, i: int, corner: Corner, lines: Lines, corners: Corners, k: int, course: Course, robot: Robot
) -> None:
    """Add the states of plain kernels to a corner without much room; their scales are negative."""
    figures, kernel = plain_kernel(corner), robot.kernel
    scale = _room_scale(lines, k, figures.size)
    figures = scaled_figures(figures, scale**3, scale)
    if figures.duration == 0.0:
        return
    figures = scaled_figures(figures, 1.0, _lines_slowing(lines, k, figures))
    first, count = corners.levels[k], LEVELS - FULL_LEVELS
    for state in range(count):
        scale = (state + 1) / count
        smaller = scaled_figures(figures, scale**3, scale)
        fill_plain(smaller.size, smaller.speed, kernel)
        factor = prove(segments, i, corner, kernel, course.limits, course.arm, robot).factor
        window.set_state(corners, k, first + state, scaled_figures(smaller, 1.0, factor), -1.0, -1.0)
    corners.levels[k] = first + count


@njit(cache=True, error_model="numpy", _nrt=False)
def _lines_slowing(lines: Lines, k: int, figures: Figures) -> float:
    """Factor on a kernel's times with which runs along both lines can begin and end at it, at least 1."""
    factor = 1.0
    for side in range(k - 1, k + 1):
        limits = peaks_of(lines.limits, side)
        if figures.acceleration > limits.acceleration:
            factor = max(factor, math.sqrt(figures.acceleration / limits.acceleration))
        peak = figures.speed / factor + 0.5 * figures.acceleration**2 / limits.jerk / factor**4
        # Both terms fall at least as the factor grows.
        factor *= max(peak / limits.speed, 1.0)
    return factor


@njit(cache=True, error_model="numpy", _nrt=False)
def _room_scale(lines: Lines, k: int, size: float) -> float:
    """Largest scale whose size both lines have room for."""
    room = min(lines.rooms[k - 1, 1], lines.rooms[k, 0])
    return 1.0 if size <= room else (room / size) ** (1.0 / 3.0)


@njit(cache=True, error_model="numpy", _nrt=False)
def _is_roomy(lines: Lines, k: int, figures: Figures) -> bool:
    """Whether half of either line is enough for a corner and to stop before it: no smaller kernel is needed."""
    roomy = _room_scale(lines, k, figures.size) == 1.0
    for side in range(k - 1, k + 1):
        stop = least_distance(Ends(figures.speed, figures.acceleration, 0.0, 0.0), peaks_of(lines.limits, side))
        roomy = roomy and 2.0 * (figures.size + stop) <= lines.spans[side]
    return roomy
