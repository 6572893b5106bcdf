"""Where robot, work and tool sit: what a smoothing rule needs to know the joints (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.smoothing.chain import Chain
from polish_sim.spatial import apply, inverse

Array = NDArray[np.float64]


class Arm(NamedTuple):
    """A UR5e with a tool before a part; arrays a compiled kernel can take."""

    T_base_work: Array
    """Pose of the frame the chain is given in, shape (4, 4)."""
    T_flange_tool: Array
    """The tool on the flange, shape (4, 4)."""
    T_tool_flange: Array
    """Its inverse, shape (4, 4)."""
    q_start: Array
    """Joint angles at (or near) the first way point: says which of the arm's configurations is meant [rad], (6,)."""


def build_arm(T_base_work: Array, T_flange_tool: Array, q_start: Array) -> Arm:
    """Put an arm together; see `Arm` for the arguments."""
    # Copies: a read-only array is another type, and kernels would be compiled once more for it.
    T_work, T_tool = (np.array(T, dtype=float, order="C") for T in (T_base_work, T_flange_tool))
    return Arm(T_work, T_tool, np.ascontiguousarray(inverse(T_tool)), np.array(q_start, dtype=float))


def arm_or_none(arm: Arm | None) -> Arm:
    """The arm, or one of the same type that stands for none: kernels are then compiled for both at once."""
    return Arm(np.eye(4), np.zeros((4, 4)), np.zeros((4, 4)), np.zeros(6)) if arm is None else arm


@njit(cache=True, error_model="numpy", forceinline=True)
def is_there(arm: Arm) -> bool:
    """Whether there is an arm, see `arm_or_none`."""
    return bool(arm.T_flange_tool[3, 3] != 0.0)


def chain_in_base(chain: Chain, arm: Arm) -> Chain:
    """The chain as seen from the robot's base."""
    R = arm.T_base_work[:3, :3]
    return chain._replace(
        tips=np.ascontiguousarray(apply(arm.T_base_work, chain.tips)),
        axes=np.ascontiguousarray(chain.axes @ R.T),
        rotations=np.ascontiguousarray(R @ chain.rotations),
        directions=np.ascontiguousarray(chain.directions @ R.T),
        turn_axes=np.ascontiguousarray(chain.turn_axes @ R.T),
    )
