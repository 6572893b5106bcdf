"""Poses as 4x4 matrices, one notation: ``T_base_tool`` is the pose of tool in base."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, Bools, crosses, norms
from polish_sim.kernel_cache import njit
from polish_sim.kernels import kernel

GRAVITY = 9.81  #: MuJoCo's default and the model's, along -z of the base [m/s^2]


def transform(R: Array, p: Array) -> Array:
    """Homogeneous transform from a rotation (3, 3) and a translation (3,) [m]; stacks broadcast."""
    T = np.zeros((*np.broadcast_shapes(R.shape[:-2], p.shape[:-1]), 4, 4))
    T[..., :3, :3] = R
    T[..., :3, 3] = p
    T[..., 3, 3] = 1.0
    return T


def inverse(T: Array) -> Array:
    """Inverse of a homogeneous transform, shape (..., 4, 4)."""
    R_transposed = np.swapaxes(T[..., :3, :3], -1, -2)
    return transform(R_transposed, -(R_transposed @ T[..., :3, 3, None])[..., 0])


def apply(T: Array, points: Array) -> Array:
    """Move points, shape (n, 3), by one transform."""
    return points @ T[:3, :3].T + T[:3, 3]


def apply_each(T: Array, points: Array) -> Array:
    """Move points, shape (n, 3), each by its own transform, shape (n, 4, 4)."""
    return np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]


def place_of(T: Array, point: Array) -> Array:
    """Where a point (3,) fixed in each of some frames (..., 4, 4) is, shape (..., 3)."""
    return T[..., :3, :3] @ point + T[..., :3, 3]


ROTATION_TOLERANCE = 1e-3  #: For the rounding of printed digits


def no_rotations(R: Array, tolerance: float = ROTATION_TOLERANCE) -> Bools:
    """Which of some matrices (n, 3, 3) are no right-handed rotations, shape (n,); R^T R is one within a
    tolerance."""
    R = np.clip(R, -2.0, 2.0)  # wrong all the same, and no overflow
    wrong = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0) > tolerance
    return wrong | (np.linalg.det(R) < 0.0)


def matrices(quaternions: Array) -> Array:
    """Rotations (..., 3, 3) of unit quaternions wxyz (..., 4)."""
    return Rotation.from_quat(quaternions, scalar_first=True).as_matrix()


def wxyz(rotations: Array) -> Array:
    """Unit quaternions wxyz (..., 4) of rotations (..., 3, 3)."""
    return Rotation.from_matrix(rotations).as_quat(scalar_first=True)


def rotations_from_vectors(vectors: Sequence[float] | Array) -> Array:
    """Rotations (..., 3, 3) of rotation vectors (..., 3) [rad]."""
    return Rotation.from_rotvec(vectors).as_matrix()


def vectors_from_rotations(rotations: Array) -> Array:
    """Rotation vectors (..., 3) [rad] of rotations (..., 3, 3)."""
    return Rotation.from_matrix(rotations).as_rotvec()


def from_pose(pose: Sequence[float] | Array) -> Array:
    """Transform of a UR-style pose: x, y, z [m] and a rotation vector [rad]."""
    values = np.asarray(pose, dtype=float)
    return transform(rotations_from_vectors(values[3:]), values[:3])


def to_pose(T: Array) -> tuple[float, ...]:
    """UR-style pose of a transform (4, 4): x, y, z [m] and a rotation vector [rad]."""
    turn = vectors_from_rotations(T[:3, :3])
    return tuple(float(value) for value in (*T[:3, 3], *turn))


# Rotations as the kernels need them: small, compiled, on plain arrays.


@kernel
def rotation_from_quaternion(quaternion: Array, R: Array) -> None:
    """Write the rotation matrix, shape (3, 3), of a unit quaternion wxyz, shape (4,), into ``R``."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@kernel
def quaternion_from_rotation(R: Array, quaternion: Array) -> None:
    """Write the unit quaternion wxyz of a rotation matrix into ``quaternion``.

    The real part is positive up to a turn of 120 deg, beyond it the largest part: no sign jumps near a half
    turn.
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        s = 2.0 * math.sqrt(trace + 1.0)
        quaternion[0] = 0.25 * s
        quaternion[1] = (R[2, 1] - R[1, 2]) / s
        quaternion[2] = (R[0, 2] - R[2, 0]) / s
        quaternion[3] = (R[1, 0] - R[0, 1]) / s
        return
    i = 0
    if R[1, 1] > R[i, i]:
        i = 1
    if R[2, 2] > R[i, i]:
        i = 2
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2.0 * math.sqrt(1.0 + R[i, i] - R[j, j] - R[k, k])
    quaternion[0] = (R[k, j] - R[j, k]) / s
    quaternion[1 + i] = 0.25 * s
    quaternion[1 + j] = (R[j, i] + R[i, j]) / s
    quaternion[1 + k] = (R[k, i] + R[i, k]) / s


@kernel
def tilt_frame(R: Array, a: float, b: float, R_out: Array) -> None:
    """Write the frame ``R`` turned by ``a`` [rad] about its own x and ``b`` about its own y, together one
    rotation, into ``R_out``, which may be ``R`` itself."""
    angle = math.sqrt(a * a + b * b) + 1e-300
    x, y, c, d = a / angle, b / angle, 1.0 - math.cos(angle), math.sin(angle)
    for i in range(3):
        r0, r1, r2 = R[i, 0], R[i, 1], R[i, 2]
        # Rodrigues' formula for the axis (x, y, 0).
        R_out[i, 0] = r0 * (1.0 - c * y * y) + r1 * c * x * y - r2 * d * y
        R_out[i, 1] = r0 * c * x * y + r1 * (1.0 - c * x * x) + r2 * d * x
        R_out[i, 2] = r0 * d * y - r1 * d * x + r2 * (1.0 - c)


@njit
def rotation_angle(R_a: Array, R_b: Array) -> float:
    """Angle between two frames [rad], accurate near zero too."""
    trace = 0.0
    skew = 0.0
    for i in range(3):
        j = (i + 1) % 3
        first = second = 0.0
        for k in range(3):
            trace += R_a[k, i] * R_b[k, i]
            first += R_a[k, i] * R_b[k, j]
            second += R_a[k, j] * R_b[k, i]
        skew += (first - second) ** 2
    return math.atan2(math.sqrt(skew), trace - 1.0)


def rotation_to_axis(z_axis: Array, x_hint: Array) -> Array:
    """Rotations (n, 3, 3) with given unit z axes (n, 3) and x as near as can be to a hint (3,), parallel to
    none of them."""
    x_axis = x_hint - (z_axis @ x_hint)[:, None] * z_axis
    x_axis /= norms(x_axis)[:, None]
    return np.stack([x_axis, crosses(z_axis, x_axis), z_axis], axis=2)


STEEPEST = 0.99  #: The steady x axis stays this far off every z axis (cosine): 8 deg


def steady_rotations(z_axes: Array) -> Array | None:
    """Rotations (n, 3, 3) with unit z axes (n, 3) and x as near as can be to that one of their frame's axes
    which suits all of them best; None if z axes point along all three."""
    along = np.abs(z_axes).max(axis=0)
    best = int(along.argmin())
    return rotation_to_axis(z_axes, np.eye(3)[best]) if along[best] <= STEEPEST else None


def skew(v: Array) -> Array:
    """Matrix S with S w = v x w, shape (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
