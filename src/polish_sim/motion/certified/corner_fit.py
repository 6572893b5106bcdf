"""The kernels a corner may be passed with, every one proven for tip, axis and joints (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import FULL_LEVELS, LEVELS, Corners, Lines, Segments
from polish_sim.motion.certified.corner import corner_kernel
from polish_sim.motion.certified.corner_enclosure import JointShares
from polish_sim.motion.certified.corner_parts import Sides, copy_scaled
from polish_sim.motion.certified.corner_proof import Slowdown, prove_kernel
from polish_sim.motion.certified.corner_task import CornerFigures, CornerLimits, CornerWeights
from polish_sim.motion.certified.corner_time import time_lost
from polish_sim.motion.certified.corners import (
    corner_limits,
    corner_weights,
    is_roomy,
    kernel_of,
    lines_slowing,
    room_scale,
    scaled_figures,
    set_state,
)
from polish_sim.motion.certified.course import Course
from polish_sim.motion.certified.plain import fill_plain, plain_kernel
from polish_sim.motion.certified.robot import Robot, base_sides
from polish_sim.motion.certified.window import line_limits

Array = NDArray[np.float64]

_SHRINK, _SHRINKS = 0.8, 8
"""Kernels nothing can be proven of are made smaller, next to singularities."""
_REFITTED, _REFITS = 1.02, 2
"""Kernels the joints slow down by more are made anew for less acceleration or jerk."""


class _Task(NamedTuple):
    """One corner."""

    weights: CornerWeights
    limits: CornerLimits
    sides: Sides
    q: Array
    """Joint angles there [rad], shape (6,)."""


class _Fit(NamedTuple):
    """A kernel and what is proven of it."""

    figures: CornerFigures
    """Before it is slowed down."""
    proof: Slowdown


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def fill_corner(segments: Segments, lines: Lines, corners: Corners, k: int, course: Course, robot: Robot) -> None:
    """Find the kernels of the corner before line ``k`` and lay out its states: exact stop, smaller ones, the full one.

    Args:
        segments: Buffers.
        lines: Those on both sides are known.
        corners: Filled at ``k``.
        k: The corner.
        course: What stays the same.
        robot: Joints at the corner, and work space.
    """
    i = lines.first[k]
    old, new = line_limits(lines, k - 1), line_limits(lines, k)
    task = _Task(
        corner_weights(segments, i),
        corner_limits(segments, i, course.limits, course.tolerances, old, new),
        base_sides(segments, i, course.arm, robot),
        robot.q[i],
    )
    corners.chosen[k], corners.levels[k], corners.scales[k, 0] = -1, 1, 0.0
    set_state(corners, k, 0, CornerFigures(0.0, 0.0, 0.0, 0.0))
    fit = _Fit(CornerFigures(0.0, 0.0, 0.0, 0.0), Slowdown(math.inf, False, JointShares(0.0, 0.0, 0.0)))
    limits, soonest = task.limits, math.inf
    for _ in range(1 + _REFITS):
        other = _fit_kernel(task, limits, lines, k, course, robot)
        slowed = scaled_figures(other.figures, 1.0, other.proof.factor)
        lost = time_lost(slowed, task.limits)
        if not lost < soonest:
            break
        fit, soonest = other, lost
        copy_scaled(robot.kernel, 1.0, 1.0, kernel_of(corners, k))
        if other.proof.factor <= _REFITTED:
            break
        limits = _lowered(limits, other.proof.joints)
    if not _lay_out_states(fit, task, lines, corners, k, course, robot):
        _lay_out_plain(task, lines, corners, k, course, robot)


@njit(cache=True, error_model="numpy", inline="always")
def _fit_kernel(task: _Task, limits: CornerLimits, lines: Lines, k: int, course: Course, robot: Robot) -> _Fit:
    """Fill the robot's kernel, as large as tolerances, lines and the arm allow."""
    kernel = robot.kernel
    durations, remaining, gone = kernel
    figures = corner_kernel(task.weights, limits, course.shapes, durations, remaining, gone)
    scale = room_scale(lines, k, figures.size)
    proof = Slowdown(1.0, True, JointShares(0.0, 0.0, 0.0))
    for _ in range(_SHRINKS):
        figures = scaled_figures(figures, scale, 1.0)
        slowdown = lines_slowing(lines, k, figures)
        figures = scaled_figures(figures, 1.0, slowdown)
        copy_scaled(kernel, scale, slowdown, kernel)
        if figures.duration == 0.0:
            break
        proof = prove_kernel(task.sides, kernel, course.limits, course.arm, task.q, robot.proof)
        if math.isfinite(proof.factor):
            break
        scale = _SHRINK
    return _Fit(figures, proof)


@njit(cache=True, error_model="numpy")
def _lowered(limits: CornerLimits, shares: JointShares) -> CornerLimits:
    """Limits of tip and axis with which the joints keep theirs, nearly."""
    acceleration, jerk = max(shares.acceleration, 1.0), max(shares.jerk, 1.0)
    return CornerLimits(
        limits.speed,
        limits.acceleration / acceleration,
        limits.jerk / jerk,
        limits.tip_tolerance,
        limits.axis_speed,
        limits.axis_acceleration / acceleration,
        limits.axis_jerk / jerk,
        limits.axis_tolerance,
        limits.segment_speed,
        limits.segment_acceleration,
        limits.segment_jerk,
    )


@njit(cache=True, error_model="numpy", inline="always")
def _lay_out_states(
    fit: _Fit, task: _Task, lines: Lines, corners: Corners, k: int, course: Course, robot: Robot
) -> bool:
    """Lay out the states of a corner's kernel, from the full one to small ones.

    Returns:
        Whether there is so much room that no smaller kernel is needed.
    """
    proof = fit.proof
    roomy = is_roomy(lines, k, fit.figures)
    if math.isinf(proof.factor):
        return False
    levels = 2 if roomy else FULL_LEVELS
    corners.levels[k] = levels
    for i in range(levels - 1, 0, -1):
        scale = i / (levels - 1)
        if not proof.for_smaller:
            copy_scaled(kernel_of(corners, k), scale, 1.0, robot.scaled)
            proof = prove_kernel(task.sides, robot.scaled, course.limits, course.arm, task.q, robot.proof)
        corners.scales[k, i], corners.slowdowns[k, i] = scale, proof.factor
        set_state(corners, k, i, scaled_figures(fit.figures, scale, proof.factor))
    return roomy


@njit(cache=True, error_model="numpy", inline="always")
def _lay_out_plain(task: _Task, lines: Lines, corners: Corners, k: int, course: Course, robot: Robot) -> None:
    """Add the states of plain kernels to a corner without much room; their scales are negative."""
    figures, kernel = plain_kernel(task.weights, task.limits), robot.kernel
    figures = scaled_figures(figures, room_scale(lines, k, figures.size), 1.0)
    if figures.duration == 0.0:
        return
    figures = scaled_figures(figures, 1.0, lines_slowing(lines, k, figures))
    first, count = corners.levels[k], LEVELS - FULL_LEVELS
    proof = Slowdown(1.0, False, JointShares(0.0, 0.0, 0.0))
    for i in range(count - 1, -1, -1):
        smaller = scaled_figures(figures, (i + 1) / count, 1.0)
        if not proof.for_smaller:
            fill_plain(smaller.size, smaller.speed, kernel.durations, kernel.remaining, kernel.gone)
            proof = prove_kernel(task.sides, kernel, course.limits, course.arm, task.q, robot.proof)
        corners.scales[k, first + i] = -1.0
        set_state(corners, k, first + i, scaled_figures(smaller, 1.0, proof.factor))
    corners.levels[k] = first + count
