"""Joint angles, speeds, accelerations and jerks of a tool motion sampled in time (layer 6)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.arm_state import ArmState, new_arm_state
from polish_sim.motion.joint_rates import solve_rates
from polish_sim.motion.segment_rates import REACHED, JointRates, reach_pose, unreachable
from polish_sim.motion.smoothing.arm import Arm

Array = NDArray[np.float64]


def joint_motion(tips: Array, rotations: Array, linear: Array, angular: Array, arm: Arm) -> JointRates:
    """Joint motion of a tool motion given with its derivatives in time, exact at every sample.

    Args:
        tips: Tool points in the work frame [m], shape (n, 3), dense enough to stay on one branch of the arm.
        rotations: R_work_tool, shape (n, 3, 3).
        linear: Velocity, acceleration and jerk of the tool point [m/s..], shape (3, n, 3).
        angular: Spatial angular velocity and its first two derivatives [rad/s..], work frame, shape (3, n, 3).
        arm: Tool and robot.

    Returns:
        q [rad] and its derivatives in time, shape (n, 6) each.

    Raises:
        ReachError: A sample cannot be reached, or is singular.
    """
    R = arm.T_base_work[:3, :3]
    poses = np.zeros((len(tips), 4, 4))
    poses[:, :3, :3] = R @ rotations
    poses[:, :3, 3] = tips @ R.T + arm.T_base_work[:3, 3]
    poses[:, 3, 3] = 1.0
    twists = np.ascontiguousarray(np.concatenate([linear @ R.T, angular @ R.T], axis=2).swapaxes(0, 1))
    out = JointRates(*(np.full((len(tips), 6), np.nan) for _ in range(4)))
    status, row = _fill_motion(poses, twists, arm, new_arm_state(), out)
    if status != REACHED:
        raise unreachable(status, row, tips[row])
    return out


@njit(cache=True, error_model="numpy")
def _fill_motion(poses: Array, twists: Array, arm: Arm, state: ArmState, out: JointRates) -> tuple[int, int]:
    """Joint rates of every sample; (status, row) of the first that fails, or (REACHED, -1)."""
    state.q[:] = arm.q_start
    for row in range(poses.shape[0]):
        status = reach_pose(state, poses[row], arm, state.q)
        if status != REACHED:
            return status, row
        for i in range(3):
            for j in range(6):
                state.twists[i, j] = twists[row, i, j]
        solve_rates(state, 3)
        for j in range(6):
            out.q[row, j] = state.q[j]
            out.first[row, j] = state.rates[0, j]
            out.second[row, j] = state.rates[1, j]
            out.third[row, j] = state.rates[2, j]
    return REACHED, -1
