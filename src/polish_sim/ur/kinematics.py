"""The kinematics a controller needs in every tick, compiled: poses as a UR gives them, and its tool's
Jacobian."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import cross, dot, minus, scaled, set_product, set_to
from polish_sim.motion.kinematics import NOMINAL, advance_frame, joint_rows
from polish_sim.spatial import quaternion_from_rotation, rotation_from_quaternion, transform

SINGULAR = 0.02  #: Damping of the inverse Jacobian [-]
_rows = lru_cache(1)(lambda table: joint_rows(np.frombuffer(table).reshape(4, 6)))


@njit
def _matrix_of(pose: Array) -> Array:
    T = np.eye(4)
    angle = math.sqrt(dot(pose[3:], pose[3:]))
    quaternion = np.empty(4)
    quaternion[0] = math.cos(0.5 * angle)
    share = math.sin(0.5 * angle) / angle if angle > 1e-9 else 0.5
    set_to(quaternion[1:], scaled(share, pose[3:]))
    set_to(T[:, 3], pose)
    rotation_from_quaternion(quaternion, T[:3, :3])
    return T


@njit
def _pose_of(T: Array) -> Array:
    pose = np.empty(6)
    quaternion = np.empty(4)
    quaternion_from_rotation(T[:3, :3], quaternion)
    w, v = quaternion[0], quaternion[1:]
    sine = math.sqrt(dot(v, v))
    share = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
    set_to(pose, T[:, 3])
    set_to(pose[3:], scaled(-share if w < 0.0 else share, v))
    return pose


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


def pose_from(T: Array, by: Array) -> Array:
    """Way and rotation vector from one transform, ``by``, to another, ``T``, in outer axes, shape (6,)."""
    return pose_of(transform(T[:3, :3] @ by[:3, :3].T, T[:3, 3] - by[:3, 3]))


def tool_at(q: Array, T_flange_tcp: Array) -> tuple[Array, Array]:
    """Pose (4, 4) of the tool in the base at joint angles (6,) [rad] and its geometric Jacobian (6, 6)."""
    return _tool_at(_rows(NOMINAL.tobytes()), np.array(q, dtype=float), T_flange_tcp)
