"""How much smaller and slower a corner kernel must be so that tool axis and joints keep their limits (layer 6).

Slowed by tau every speed falls by tau, every acceleration by tau^2, every jerk by tau^3: exact for the motion and for
all its bounds. Scaled to s of its size (speeds by s^(2/3), accelerations by s^(1/3), the same jerk) every bound falls
or stays; so one factor holds for the whole family of kernels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.certified.corner_axis import AxisCorner, axis_extent
from polish_sim.motion.certified.corner_extent import KernelControls, fill_controls, new_kernel_controls
from polish_sim.motion.certified.corner_joints import (
    JointCorner,
    confirm,
    fill_composed,
    fill_sides,
    fill_straight,
    new_joint_corner,
)
from polish_sim.motion.segment_rates import REACHED, Segment, reach_pose, tool_pose
from polish_sim.motion.smoothing.arm import Arm, is_there
from polish_sim.motion.smoothing.limits import LimitValues

Array = NDArray[np.float64]

_ROUNDING = 1.0 + 1e-9
_SMALLEST, _SHRINK = 1e-3, 0.92


class CornerFactor(NamedTuple):
    """What a kernel must be changed by."""

    size: float
    """It may be used up to this share of its size; below 1 only next to singularities, 0: stop at the corner."""
    slowdown: float
    """All its times are to be multiplied by this, at least 1; holds for every smaller kernel of its family."""


class CornerWork(NamedTuple):
    """Work space of `corner_factor`, made once per stream."""

    controls: KernelControls
    joints: JointCorner
    most: Array
    """Largest values of the kernel scaled down, shape (3, 4)."""
    turn: Array
    """Turn of the tool axis per length on both sides [rad/m], shape (2,)."""
    roll: Array
    """Roll about it per length on both sides [rad/m], shape (2,)."""


def new_corner_work(pieces: int) -> CornerWork:
    """Fresh work space for kernels of ``pieces`` pieces."""
    return CornerWork(new_kernel_controls(pieces), new_joint_corner(), np.zeros((3, 4)), np.zeros(2), np.zeros(2))


@njit(cache=True, error_model="numpy", forceinline=True)
def _needed(value: float, limit: float, order: int) -> float:
    """Factor on time that brings a derivative of an order down to its limit."""
    ratio = value / limit
    if ratio <= 1.0:
        return 1.0
    return ratio if order == 1 else (math.sqrt(ratio) if order == 2 else np.cbrt(ratio))


@njit(cache=True, error_model="numpy", forceinline=True)
def _sine(a: Array, b: Array) -> float:
    """Length of the cross product of two unit (or zero) vectors."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def axis_slowdown(old: Segment, new: Segment, limits: LimitValues, work: CornerWork) -> float:
    """Factor on the kernel's times for the tool axis alone; ``work.controls``, turn filled."""
    n1, n2, w1, w2 = old.turn_axis, new.turn_axis, work.turn[0], work.turn[1]
    if w1 == 0.0 and w2 == 0.0:
        return 1.0
    product = w1 * w2 * (n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2])
    extent = axis_extent(AxisCorner(w1, w2, product, _sine(n1, n2)), work.controls)
    slowdown = _needed(extent.speed * _ROUNDING, limits.axis_speed, 1)
    slowdown = max(slowdown, _needed(extent.acceleration * _ROUNDING, limits.axis_acceleration, 2))
    return max(slowdown, _needed(extent.jerk * _ROUNDING, limits.axis_jerk, 3))


@njit(cache=True, error_model="numpy")
def _fill_twists(old: Segment, new: Segment, spans: tuple[float, float], work: CornerWork) -> None:
    """Write the tool's (linear; angular) motion per length on both sides of the way point."""
    twists, T = work.joints.arm.twists, work.joints.T
    for i in range(3):
        twists[0, i] = old.length / spans[0] * old.direction[i]
        twists[1, i] = new.length / spans[1] * new.direction[i]
        twists[0, i + 3] = work.turn[0] * old.turn_axis[i] + work.roll[0] * T[i, 2]
        twists[1, i + 3] = work.turn[1] * new.turn_axis[i] + work.roll[1] * T[i, 2]


@njit(cache=True, error_model="numpy")
def _shrink(work: CornerWork, scale: float) -> None:
    """Largest values of the kernel at scale^3 of its size, and of the joints' straight motion."""
    share = scale * scale * scale
    for order in range(4):
        for side in range(3):
            work.most[side, order] = share * work.controls.most[side, order]
        share /= scale


@njit(cache=True, error_model="numpy")
def _joint_factor(
    old: Segment, new: Segment, spans: tuple[float, float], limits: LimitValues, arm: Arm, q: Array, work: CornerWork
) -> CornerFactor:
    """Size and factor on the kernel's times for the joints."""
    joints = work.joints
    tool_pose(new, 0.0, joints.T)
    if reach_pose(joints.arm, joints.T, arm, q) != REACHED:
        return CornerFactor(0.0, 1.0)
    _fill_twists(old, new, spans, work)
    fill_sides(joints, joints.arm.twists)
    fill_straight(joints, work.controls)
    sine, scale = _sine(old.turn_axis, new.turn_axis), 1.0
    while True:
        _shrink(work, scale)
        fill_composed(joints, work.most, work.turn, work.roll, sine)
        if confirm(joints, work.most):
            break
        scale *= _SHRINK
        if scale < _SMALLEST:
            return CornerFactor(0.0, 1.0)
        for i in range(6):
            share = _SHRINK**3
            for order in range(4):
                joints.straight[order, i] *= share
                share /= _SHRINK
    slowdown = 1.0
    for order in range(3):
        for i in range(6):
            value = (joints.straight[order + 1, i] + joints.extra[order + 1, i]) * _ROUNDING
            slowdown = max(slowdown, _needed(value, limits.joint[order, i], order + 1))
    return CornerFactor(scale * scale * scale, slowdown)


@njit(cache=True, error_model="numpy")
def corner_factor(
    old: Segment,
    new: Segment,
    spans: tuple[float, float],
    durations: Array,
    remaining: Array,
    gone: Array,
    limits: LimitValues,
    arm: Arm,
    q: Array,
    work: CornerWork,
) -> CornerFactor:
    """Share of its size and factor on its times at which a corner kernel keeps axis and joint limits, proven.

    Args:
        old: The segment that ends at the corner, base frame.
        new: The one that begins there.
        spans: Generalised lengths of both [m].
        durations: Of the kernel's pieces [s], shape (pieces,).
        remaining: Cubics of what is left of the old segment [m], shape (pieces, 4).
        gone: Cubics of what is gone of the new one [m], shape (pieces, 4).
        limits: Of axis and joints; the tip's are not looked at.
        arm: Tool and robot; `arm_or_none`: the axis alone.
        q: Joint angles at the corner, or near on the same branch [rad], shape (6,).
        work: Work space.

    Returns:
        Size and slowdown.
    """
    fill_controls(durations, remaining, gone, work.controls)
    work.turn[0], work.turn[1] = old.angle / spans[0], new.angle / spans[1]
    work.roll[0], work.roll[1] = old.roll / spans[0], new.roll / spans[1]
    slowdown = axis_slowdown(old, new, limits, work)
    if not is_there(arm):
        return CornerFactor(1.0, slowdown)
    factor = _joint_factor(old, new, spans, limits, arm, q, work)
    return CornerFactor(factor.size, max(slowdown, factor.slowdown))
