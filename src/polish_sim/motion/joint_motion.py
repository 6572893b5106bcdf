"""Joint angles, speeds, accelerations and jerks of a tool motion sampled in time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.inverse_kinematics import nearest_solution
from polish_sim.motion.joint_rates import ArmState, new_arm_state, solve_rates
from polish_sim.motion.kinematics import JOINT_LIMITS, smallest_singular_values
from polish_sim.motion.rules.limits import Arm
from polish_sim.motion.segment_rates import REACHED, JointRates, reach_pose, unreachable

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


# Following a sequence of tool poses with the joints: is the whole path reachable, before anything moves.


class JointPath(NamedTuple):
    """A pose sequence followed by the joints, without jumping between the arm's configurations."""

    q: Array
    """Joint angles [rad], shape (n, 6); NaN from the first unreachable pose on."""
    first_unreachable: int | None
    """Index of the first pose out of reach, or None."""
    first_beyond_limit: int | None
    """Index of the first pose at which a joint is outside its limits, or None."""
    limit_joint: int | None
    """The joint (0-5) that is outside its limits there, or None."""
    largest_step: float
    """Largest change of one joint between neighbouring poses [rad]; a large one is a jump near a singularity."""
    largest_step_index: int
    """Index of the pose that this step ends at (0: `q_start` to the first pose)."""
    smallest_singular_value: float
    """Least of the Jacobian's smallest singular values at the tool point, mixed units (see kinematics)."""
    smallest_singular_index: int
    """Index of the pose closest to a singularity."""


@njit(cache=True)
def _follow(T_base_tool: Array, T_tool_flange: Array, q_start: Array) -> Array:
    """Joint angles (n, 6) along the poses, each the solution closest to the last one; NaN once out of reach."""
    q = np.full((T_base_tool.shape[0], 6), np.nan)
    last = q_start
    for i in range(T_base_tool.shape[0]):
        last = nearest_solution(T_base_tool[i] @ T_tool_flange, last, False)
        if np.isnan(last[0]):
            break
        q[i] = last
    return q


def _first(mask: NDArray[np.bool_]) -> int | None:
    """Index of the first true value, or None."""
    return int(np.argmax(mask)) if mask.any() else None


def track(T_base_tool: Array, T_flange_tool: Array, q_start: Array) -> JointPath:
    """Follow a sequence of tool poses, staying in the arm configuration nearest to the start.

    Joint limits are reported, not enforced, so that a path that leaves them shows where.

    Args:
        T_base_tool: Tool poses in order, shape (n, 4, 4), n at least 1.
        T_flange_tool: Where the tool sits on the flange, shape (4, 4).
        q_start: Configuration to start near [rad], shape (6,).

    Returns:
        The joint path and its worst points.
    """
    T_tool_flange: Array = np.linalg.inv(np.asarray(T_flange_tool, dtype=float))
    start: Array = np.asarray(q_start, dtype=float)
    q = _follow(np.ascontiguousarray(T_base_tool, dtype=float), T_tool_flange, start)
    q.flags.writeable = False
    reached = ~np.isnan(q[:, 0])
    beyond: NDArray[np.bool_] = (q < JOINT_LIMITS[:, 0]) | (q > JOINT_LIMITS[:, 1])
    first_beyond = _first(np.any(beyond, axis=1))
    steps = np.abs(np.diff(q, axis=0, prepend=start[None])).max(axis=1)[reached]
    singular = smallest_singular_values(q[reached], np.ascontiguousarray(T_flange_tool[:3, 3], dtype=float))
    return JointPath(
        q=q,
        first_unreachable=_first(~reached),
        first_beyond_limit=first_beyond,
        limit_joint=None if first_beyond is None else int(np.argmax(beyond[first_beyond])),
        largest_step=float(steps.max(initial=0.0)),
        largest_step_index=int(np.argmax(steps)) if steps.size else 0,
        smallest_singular_value=float(singular.min(initial=np.inf)),
        smallest_singular_index=int(np.argmin(singular)) if singular.size else 0,
    )
