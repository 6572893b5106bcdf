"""Poses as 4x4 matrices, one notation: ``T_base_tool`` is the pose of tool in base (layer 2)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


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


def from_pose(pose: Sequence[float]) -> Array:
    """Transform of a UR-style pose: x, y, z [m] and a rotation vector [rad]."""
    values = np.asarray(pose, dtype=float)
    return transform(Rotation.from_rotvec(values[3:]).as_matrix(), values[:3])
