"""The chain two robots close over one part: poses of both flanges, and joints that follow them (paper 2).

master_T_flange1 = master_T_work (gripper_T_work)^-1 (flange1_T_gripper)^-1
follower_T_flange2 = (master_T_follower)^-1 master_T_work work_T_tool (flange2_T_tool)^-1
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.errors import ReachError
from polish_sim.motion.kinematics import JOINT_LIMITS, nearest_solution
from polish_sim.spatial import inverse

COMFORTABLE: Final = 0.5 * np.pi  #: Distance from its limits from which on a joint counts as free [rad]


class ClosedChain(NamedTuple):
    """The fixed transforms of the chain; each (4, 4)."""

    T_master_follower: Array  #: The follower's base in the master's, from base calibration
    T_flange_gripper: Array  #: The gripper on the master's flange, from tool calibration
    T_gripper_work: Array  #: The part in the gripper, from assembly
    T_flange_tool: Array  #: The tool on the follower's flange, from tool calibration

    @property
    def T_flange_work(self) -> Array:
        """The part on the master's flange, shape (4, 4)."""
        return np.asarray(self.T_flange_gripper @ self.T_gripper_work)

    def master_flange(self, T_master_work: Array) -> Array:
        """Flange of the master for a pose of the part, both (..., 4, 4)."""
        return np.asarray(T_master_work @ inverse(self.T_flange_work))

    def follower_flange(self, T_master_work: Array, T_work_tool: Array) -> Array:
        """Flange of the follower, in its own base, for a pose of the tool on the part, shape (..., 4, 4)."""
        return np.asarray(inverse(self.T_master_follower) @ T_master_work @ T_work_tool @ inverse(self.T_flange_tool))

    def residual(self, T_master_flange: Array, T_follower_flange: Array, T_work_tool: Array) -> Array:
        """How far the chain is from closing, for both flanges in their bases and the wanted tool pose, each (n, 4, 4).

        Returns the displacement [m] and rotation vector [rad] of the actual tool pose, axes of the wanted one, (n, 6).
        """
        wanted = T_master_flange @ self.T_flange_gripper @ self.T_gripper_work @ T_work_tool
        actual = self.T_master_follower @ T_follower_flange @ self.T_flange_tool
        off = inverse(wanted) @ actual
        return np.concatenate([off[:, :3, 3], Rotation.from_matrix(off[:, :3, :3]).as_rotvec()], axis=1)


def follow_joints(T_base_flange: Array, q_near: Array, arm: str) -> Array:
    """Joints (n, 6) [rad] along flange poses, from near ``q_near``, each close to the last and inside the limits.

    Raises ReachError, which names the arm and the pose it cannot reach.
    """
    joints = np.empty((len(T_base_flange), 6))
    q = np.asarray(q_near, dtype=np.float64)
    for k, T in enumerate(T_base_flange):
        q = nearest_solution(np.ascontiguousarray(T), q, True)
        if np.isnan(q).any():
            x, y, z = 1e3 * T[:3, 3]
            raise ReachError(
                f"the {arm} cannot bring its flange to point {k + 1} of {len(T_base_flange)}, ({x:.1f}, {y:.1f}, "
                f"{z:.1f}) mm in its base, with the wanted direction. Move the part, the other base, or turn the tool."
            )
        joints[k] = q
    return joints


def limit_margin(q: Array) -> float:
    """Least distance of any joint from its limits [rad] over configurations (n, 6); negative beyond them."""
    return float(np.minimum(q - JOINT_LIMITS[:, 0], JOINT_LIMITS[:, 1] - q).min())
