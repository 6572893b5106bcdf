"""The kinematics a controller needs in every tick, compiled: poses as a UR gives them, and its tool's
Jacobian."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.motion.kinematics import NOMINAL, advance_frame, joint_rows
from polish_sim.spatial import quaternion_from_rotation, rotation_from_quaternion

SINGULAR = 0.02  #: Damping of the inverse Jacobian [-]
_rows = lru_cache(1)(lambda table: joint_rows(np.frombuffer(table).reshape(4, 6)))


@njit
def _matrix_of(pose: Array) -> Array:
    T = np.eye(4)
    angle = math.sqrt(pose[3] ** 2 + pose[4] ** 2 + pose[5] ** 2)
    quaternion = np.empty(4)
    quaternion[0] = math.cos(0.5 * angle)
    share = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    for i in range(3):
        quaternion[1 + i] = share * pose[3 + i]
        T[i, 3] = pose[i]
    rotation_from_quaternion(quaternion, T[:3, :3])
    return T


@njit
def _pose_of(T: Array) -> Array:
    pose = np.empty(6)
    quaternion = np.empty(4)
    quaternion_from_rotation(T[:3, :3], quaternion)
    w = quaternion[0]
    sine = 0.0
    for i in range(3):
        sine += quaternion[1 + i] ** 2
    sine = math.sqrt(sine)
    share = 2.0
    if sine > 1e-12:
        share = 2.0 * math.atan2(sine, abs(w)) / sine
    if w < 0.0:
        share = -share
    for i in range(3):
        pose[i] = T[i, 3]
        pose[3 + i] = share * quaternion[1 + i]
    return pose


@njit
def _tool_at(rows: Array, q: Array, T_flange_tcp: Array) -> tuple[Array, Array]:
    frames = np.zeros((7, 4, 4))
    for i in range(4):
        frames[0, i, i] = 1.0
    for k in range(6):
        for i in range(4):
            for j in range(4):
                frames[k + 1, i, j] = frames[k, i, j]
        advance_frame(frames[k + 1], rows[k], q[k])
    T, J = np.zeros((4, 4)), np.empty((6, 6))
    for i in range(4):
        for j in range(4):
            for k in range(4):
                T[i, j] += frames[6, i, k] * T_flange_tcp[k, j]
    for k in range(6):
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            J[i, k] = frames[k, a, 2] * (T[b, 3] - frames[k, b, 3]) - frames[k, b, 2] * (
                T[a, 3] - frames[k, a, 3]
            )
            J[3 + i, k] = frames[k, i, 2]
    return T, J


@njit
def joint_speeds(J: Array, twist: Array) -> Array:
    """Joint speeds (6,) [rad/s] for a twist of the tool (6,); exact away from singularities, damped near
    them."""
    gram = J @ J.T
    least = max(np.linalg.eigvalsh(gram)[0], 0.0)
    damping = max(SINGULAR**2 - least, 0.0)
    for i in range(6):
        gram[i, i] += damping
    return J.T @ np.linalg.solve(gram, twist)


def matrix_of(pose: Array) -> Array:
    """Transform (4, 4) of a pose (6,): x, y, z [m] and a rotation vector [rad]."""
    return _matrix_of(np.array(pose, dtype=float))


def pose_of(T: Array) -> Array:
    """Pose (6,) of a transform (4, 4), as of `matrix_of`."""
    return _pose_of(np.ascontiguousarray(T, dtype=float))


def tool_at(q: Array, T_flange_tcp: Array) -> tuple[Array, Array]:
    """Pose (4, 4) of the tool in the base at joint angles (6,) [rad] and its geometric Jacobian (6, 6)."""
    return _tool_at(_rows(NOMINAL.tobytes()), np.array(q, dtype=float), T_flange_tcp)
