"""The kinematics a controller needs in every tick: poses as a UR gives them, and its tool's Jacobian."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import cross, minus, set_product, set_to
from polish_sim.motion.kinematics import NOMINAL, advance_frame, joint_rows
from polish_sim.spatial import transform

TICK_S = 0.002  #: Cycle of the robot's controller
SINGULAR = 0.02  #: Damping of the inverse Jacobian [-]
_rows = lru_cache(1)(lambda table: joint_rows(np.frombuffer(table).reshape(4, 6)))


@njit
def _tool_at(rows: Array, q: Array, T_flange_tcp: Array) -> tuple[Array, Array]:
    flange, T, J = np.eye(4), np.eye(4), np.empty((6, 6))
    for k in range(6):
        set_to(J[:, k], flange[:, 3])
        set_to(J[3:, k], flange[:, 2])
        advance_frame(flange, rows[k], q[k])
    set_product(T, flange, T_flange_tcp)
    for k in range(6):
        set_to(J[:, k], cross(J[3:, k], minus(T[:, 3], J[:, k])))
    return T, J


def joint_speeds(J: Array, twist: Array) -> Array:
    """Joint speeds (6,) [rad/s] for a twist of the tool (6,); exact away from singularities, damped near
    them."""
    values, axes = np.linalg.eigh(J @ J.T)
    damping = max(SINGULAR**2 - max(values[0], 0.0), 0.0)
    return J.T @ (axes @ ((axes.T @ twist) / (values + damping)))


def pose_of(T: Array) -> Array:
    """Pose (6,) of a transform (4, 4): x, y, z [m] and a rotation vector [rad], as of `from_pose`; by MuJoCo,
    for scipy's conversion of one rotation is slow in every tick."""
    quaternion, turn = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, T[:3, :3].ravel())
    mujoco.mju_quat2Vel(turn, quaternion, 1.0)
    return np.concatenate([T[:3, 3], turn])


def pose_from(T: Array, by: Array) -> Array:
    """Way and rotation vector from one transform, ``by``, to another, ``T``, in outer axes, shape (6,)."""
    return pose_of(transform(T[:3, :3] @ by[:3, :3].T, T[:3, 3] - by[:3, 3]))


def tool_at(q: Array, T_flange_tcp: Array) -> tuple[Array, Array]:
    """Pose (4, 4) of the tool in the base at joint angles (6,) [rad] and its geometric Jacobian (6, 6)."""
    return _tool_at(_rows(NOMINAL.tobytes()), np.array(q, dtype=float), T_flange_tcp)
