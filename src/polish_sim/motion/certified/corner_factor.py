"""How much slower a corner kernel must be so that tool axis and joints keep their limits, by norms (layer 6).

Slowed by tau every speed falls by tau, every acceleration by tau^2, every jerk by tau^3: exact for the motion and for
all its bounds. Scaled to s of its size (speeds by s^(2/3), accelerations by s^(1/3), the same jerk) every bound falls
or stays; so one factor holds for the whole family of kernels. For the joints it is quick but cautious: where it asks
for much, `corner_proof` looks closer.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
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
from polish_sim.motion.certified.corner_parts import Kernel, Sides
from polish_sim.motion.rules.limits import Arm, LimitValues
from polish_sim.motion.segment_rates import REACHED, reach_pose, tool_pose

Array = NDArray[np.float64]

_ROUNDING = 1.0 + 1e-9


class CornerWork(NamedTuple):
    """Work space, made once per stream."""

    controls: KernelControls
    joints: JointCorner
    turn: Array
    """Turn of the tool axis per length on both sides [rad/m], shape (2,)."""
    roll: Array
    """Roll about it per length on both sides [rad/m], shape (2,)."""


def new_corner_work(pieces: int) -> CornerWork:
    """Fresh work space for kernels of ``pieces`` pieces."""
    return CornerWork(new_kernel_controls(pieces), new_joint_corner(), np.zeros(2), np.zeros(2))


@njit(cache=True, error_model="numpy", forceinline=True)
def needed_slowdown(ratio: float, order: int) -> float:
    """Factor on time that brings a derivative of an order down to its limit, ``ratio`` times exceeded."""
    if ratio <= 1.0:
        return 1.0
    return ratio if order == 1 else (math.sqrt(ratio) if order == 2 else np.cbrt(ratio))


@njit(cache=True, error_model="numpy", forceinline=True)
def _sine(a: Array, b: Array) -> float:
    """Length of the cross product of two unit (or zero) vectors."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def axis_slowdown(sides: Sides, kernel: Kernel, limits: LimitValues, work: CornerWork) -> float:
    """Factor on the kernel's times for the tool axis alone.

    Args:
        sides: The corner.
        kernel: How it is passed.
        limits: Of the axis.
        work: Work space; controls, turns and rolls are written.

    Returns:
        At least 1; holds for every smaller kernel of its family.
    """
    old, new = sides.old, sides.new
    fill_controls(kernel.durations, kernel.remaining, kernel.gone, work.controls)
    work.turn[0], work.turn[1] = old.angle / sides.spans[0], new.angle / sides.spans[1]
    work.roll[0], work.roll[1] = old.roll / sides.spans[0], new.roll / sides.spans[1]
    n1, n2, w1, w2 = old.turn_axis, new.turn_axis, work.turn[0], work.turn[1]
    if w1 == 0.0 and w2 == 0.0:
        return 1.0
    product = w1 * w2 * (n1[0] * n2[0] + n1[1] * n2[1] + n1[2] * n2[2])
    extent = axis_extent(AxisCorner(w1, w2, product, _sine(n1, n2)), work.controls)
    slowdown = needed_slowdown(extent.speed * _ROUNDING / limits.axis_speed, 1)
    slowdown = max(slowdown, needed_slowdown(extent.acceleration * _ROUNDING / limits.axis_acceleration, 2))
    return max(slowdown, needed_slowdown(extent.jerk * _ROUNDING / limits.axis_jerk, 3))


@njit(cache=True, error_model="numpy")
def _fill_twists(sides: Sides, work: CornerWork) -> None:
    """Write the tool's (linear; angular) motion per length on both sides of the way point."""
    twists, T, old, new = work.joints.arm.twists, work.joints.T, sides.old, sides.new
    for i in range(3):
        twists[0, i] = old.length / sides.spans[0] * old.direction[i]
        twists[1, i] = new.length / sides.spans[1] * new.direction[i]
        twists[0, i + 3] = work.turn[0] * old.turn_axis[i] + work.roll[0] * T[i, 2]
        twists[1, i + 3] = work.turn[1] * new.turn_axis[i] + work.roll[1] * T[i, 2]


@njit(cache=True, error_model="numpy")
def joint_slowdown(sides: Sides, limits: LimitValues, arm: Arm, q: Array, work: CornerWork) -> float:
    """Factor on the kernel's times for the joints, after `axis_slowdown`.

    Args:
        sides: The corner.
        limits: Of the joints.
        arm: Tool and robot.
        q: Joint angles at the corner, or near on the same branch [rad], shape (6,).
        work: Work space, filled by `axis_slowdown`.

    Returns:
        At least 1, holds for every smaller kernel of its family; infinite if the kernel is too large for norms.
    """
    joints, most = work.joints, work.controls.most
    tool_pose(sides.new, 0.0, joints.T)
    if reach_pose(joints.arm, joints.T, arm, q) != REACHED:
        return math.inf
    _fill_twists(sides, work)
    fill_sides(joints, joints.arm.twists)
    fill_straight(joints, work.controls)
    fill_composed(joints, most, work.turn, work.roll, _sine(sides.old.turn_axis, sides.new.turn_axis))
    if not confirm(joints, most):
        return math.inf
    slowdown = 1.0
    for order in range(3):
        for i in range(6):
            value = (joints.straight[order + 1, i] + joints.extra[order + 1, i]) * _ROUNDING
            slowdown = max(slowdown, needed_slowdown(value / limits.joint[order, i], order + 1))
    return slowdown
