"""One frame in another from points known in both, with covariance."""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array, crosses
from polish_sim.errors import CalibrationError
from polish_sim.spatial import inverse, rotation_angle, rotations_from_vectors, skew, transform

LEAST_WIDTH = 0.02  #: Least width of the points across their longest direction, as a share of it


def moved_frame(T: Array, step: Array) -> Array:
    """A frame (4, 4) after a displacement of its origin and a rotation about it, outer axes, (6,) [m],
    [rad]."""
    return transform(rotations_from_vectors(step[3:]) @ T[:3, :3], T[:3, 3] + step[:3])


def point_slopes(T: Array, points: Array) -> Array:
    """How points (n, 3) that move with a frame T move with a step of it, see `moved_frame`, shape (n, 3,
    6)."""
    J = np.zeros((len(points), 3, 6))
    J[:, :, :3] = np.eye(3)
    # Column j of the turn is e_j x r, its row i therefore r x e_i.
    J[:, :, 3:] = crosses((points - T[:3, 3])[:, None], np.eye(3))
    return J


def check_spread(points: Array) -> None:
    """Refuse points (n, 3) on a line, which give no frame."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] <= LEAST_WIDTH * spread[0]:
        raise CalibrationError(
            f"all {len(points)} points lie on a line or in one place: the turn about it is unknown. Add "
            "points well off it."
        )


def kabsch(points_a: Array, points_b: Array) -> Array:
    """T_a_b of points seen in a and in b, each (n, 3), in closed form (Kabsch); unchecked, see
    `check_spread`."""
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    U, _, Vt = np.linalg.svd((points_a - mean_a).T @ (points_b - mean_b))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return transform(R, mean_a - R @ mean_b)


def frame_offset(T: Array, wanted: Array) -> tuple[float, float]:
    """How far a frame (4, 4) is from another: distance of the origins [m] and angle [rad]."""
    angle = rotation_angle(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(wanted[:3, :3]))
    return float(np.linalg.norm(T[:3, 3] - wanted[:3, 3])), angle


def relative_frame(
    T_tracker_a: Array, covariance_a: Array, T_tracker_b: Array, covariance_b: Array
) -> tuple[Array, Array]:
    """Frame b in frame a, T_a_b = T_tracker_a^-1 T_tracker_b, and its covariance in axes of a.

    Covariances (6, 6) are of an origin [m] and a small rotation [rad], those given in tracker axes.
    """
    T_a_b = inverse(T_tracker_a) @ T_tracker_b
    # A turn of frame a moves what is seen from it the other way.
    by_a = -np.eye(6)
    by_a[:3, 3:] = skew(T_tracker_b[:3, 3] - T_tracker_a[:3, 3])
    turn = np.kron(np.eye(2), T_tracker_a[:3, :3].T)
    covariance = turn @ (by_a @ covariance_a @ by_a.T + covariance_b) @ turn.T
    return T_a_b, covariance
