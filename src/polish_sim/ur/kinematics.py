"""The kinematics a controller needs in every tick, compiled: poses as a UR gives them, and its tool's
Jacobian."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import add_to, cross, matvec, minus, set_to
from polish_sim.motion.kinematics import NOMINAL, fill_frames, joint_rows
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
    links, T, J = np.zeros((1, 7, 4, 4)), np.eye(4), np.empty((6, 6))
    for k in range(7):
        for i in range(4):
            links[0, k, i, i] = 1.0
    fill_frames(rows, q.reshape(1, 6), links)
    frames = links[0]
    for i in range(4):
        set_to(T[:, i], matvec(frames[6], T_flange_tcp[:, i]))
    add_to(T[:, 3], frames[6, :, 3])
    for k in range(6):
        set_to(J[:, k], cross(frames[k, :, 2], minus(T[:, 3], frames[k, :, 3])))
        set_to(J[3:, k], frames[k, :, 2])
    return T, J


@njit
def joint_speeds(J: Array, twist: Array) -> Array:
    """Joint speeds (6,) [rad/s] for a twist of the tool (6,); exact away from singularities, damped near
    them."""
    values, axes = np.linalg.eigh(J @ J.T)
    damping = max(SINGULAR**2 - max(values[0], 0.0), 0.0)
    return J.T @ (axes @ ((axes.T @ twist) / (values + damping)))


def matrix_of(pose: Array) -> Array:
    """Transform (4, 4) of a pose (6,): x, y, z [m] and a rotation vector [rad]."""
    return _matrix_of(np.array(pose, dtype=float))


def pose_of(T: Array) -> Array:
    """Pose (6,) of a transform (4, 4), as of `matrix_of`."""
    return _pose_of(np.array(T, dtype=float))


def tool_at(q: Array, T_flange_tcp: Array) -> tuple[Array, Array]:
    """Pose (4, 4) of the tool in the base at joint angles (6,) [rad] and its geometric Jacobian (6, 6)."""
    return _tool_at(_rows(NOMINAL.tobytes()), np.array(q, dtype=float), T_flange_tcp)
