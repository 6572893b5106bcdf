"""The chain two robots close over one part: flange poses from the part's pose and the tool's pose on it (layer 6).

master_T_flange1 = master_T_work (gripper_T_work)^-1 (flange1_T_gripper)^-1
follower_T_flange2 = (master_T_follower)^-1 master_T_work work_T_tool (flange2_T_tool)^-1          (paper 2)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.spatial import inverse

Array = NDArray[np.float64]


class Chain2(NamedTuple):
    """What does not move in the chain; each (4, 4)."""

    T_master_follower: Array
    """The follower's base in the master's, from base calibration."""
    T_flange_gripper: Array
    """The gripper on the master's flange, from tool calibration."""
    T_gripper_work: Array
    """The part in the gripper, from assembly."""
    T_flange_tool: Array
    """The tool on the follower's flange, from tool calibration."""


def master_flange(chain: Chain2, T_master_work: Array) -> Array:
    """Flange of the master that puts the part there, shape (..., 4, 4)."""
    return np.asarray(T_master_work @ inverse(chain.T_flange_gripper @ chain.T_gripper_work))


def follower_flange(chain: Chain2, T_master_work: Array, T_work_tool: Array) -> Array:
    """Flange of the follower, in its own base, that puts the tool there on the part, shape (..., 4, 4)."""
    return np.asarray(inverse(chain.T_master_follower) @ T_master_work @ T_work_tool @ inverse(chain.T_flange_tool))


def chain_residual(chain: Chain2, T_master_flange: Array, T_follower_flange: Array, T_work_tool: Array) -> Array:
    """How far the chain is from closing, in the axes of the tool as wanted.

    Args:
        chain: What does not move.
        T_master_flange: The master's flange in its base, shape (n, 4, 4).
        T_follower_flange: The follower's flange in its base, shape (n, 4, 4).
        T_work_tool: The tool as wanted on the part, shape (n, 4, 4).

    Returns:
        Displacement [m] and rotation vector [rad] of the tool as it is, shape (n, 6).
    """
    wanted = T_master_flange @ chain.T_flange_gripper @ chain.T_gripper_work @ T_work_tool
    is_now = chain.T_master_follower @ T_follower_flange @ chain.T_flange_tool
    off = inverse(wanted) @ is_now
    return np.concatenate([off[:, :3, 3], Rotation.from_matrix(off[:, :3, :3]).as_rotvec()], axis=1)
