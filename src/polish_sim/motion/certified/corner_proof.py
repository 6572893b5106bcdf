"""How much slower a kernel must be to keep the limits of axis and joints: quick bounds first, close ones if needed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_enclosure import JointShares, MovingTool, joint_shares, new_moving_tool
from polish_sim.motion.certified.corner_factor import (
    CornerWork,
    axis_slowdown,
    joint_slowdown,
    needed_slowdown,
    new_corner_work,
)
from polish_sim.motion.certified.corner_parts import Kernel, Sides
from polish_sim.motion.rules.limits import Arm, LimitValues, is_there

Array = NDArray[np.float64]


class ProofWork(NamedTuple):
    """Work space, made once per stream."""

    family: CornerWork
    tool: MovingTool


class Slowdown(NamedTuple):
    """What a kernel's times must be multiplied by."""

    factor: float
    """At least 1; infinite if nothing could be proven."""
    for_smaller: bool
    """Whether it holds for every smaller kernel of the family too."""
    joints: JointShares
    """Shares of the joints' limits it takes as it is; zeros where they need not be known."""


def new_proof_work(pieces: int) -> ProofWork:
    """Fresh work space for kernels of ``pieces`` pieces."""
    return ProofWork(new_corner_work(pieces), new_moving_tool())


@njit(cache=True, error_model="numpy")
def prove_kernel(sides: Sides, kernel: Kernel, limits: LimitValues, arm: Arm, q: Array, work: ProofWork) -> Slowdown:
    """Factor on a kernel's times with which it keeps the limits of tool axis and joints at every instant.

    Args:
        sides: The corner.
        kernel: How it is passed.
        limits: Of axis and joints; the tip's are not looked at.
        arm: Tool and robot; `arm_or_none`: the axis alone.
        q: Joint angles at the corner, or near on the same branch [rad], shape (6,).
        work: Work space.

    Returns:
        The factor, proven.
    """
    nothing = JointShares(0.0, 0.0, 0.0)
    axis = axis_slowdown(sides, kernel, limits, work.family)
    if not is_there(arm):
        return Slowdown(axis, True, nothing)
    quick = joint_slowdown(sides, limits, arm, q, work.family)
    if quick <= axis:
        return Slowdown(axis, True, nothing)
    shares = joint_shares(sides, kernel, limits, arm, q, work.tool)
    slowdown = max(axis, needed_slowdown(shares.speed, 1))
    slowdown = max(slowdown, needed_slowdown(shares.acceleration, 2), needed_slowdown(shares.jerk, 3))
    if quick <= slowdown:
        return Slowdown(quick, math.isfinite(quick), shares)
    return Slowdown(slowdown, False, shares)
