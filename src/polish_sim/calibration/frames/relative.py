"""One robot's base in the other's, from both as the tracker sees them; covariances carried along (layer 8b)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.spatial import inverse, skew

Array = NDArray[np.float64]


def relative_frame(
    T_tracker_a: Array, covariance_a: Array, T_tracker_b: Array, covariance_b: Array
) -> tuple[Array, Array]:
    """Frame b in frame a: T_a_b = T_tracker_a^-1 T_tracker_b.

    Args:
        T_tracker_a: Frame a as the tracker sees it, shape (4, 4).
        covariance_a: Of its origin and rotation, tracker axes, shape (6, 6).
        T_tracker_b: Frame b as the tracker sees it, shape (4, 4).
        covariance_b: Of its origin and rotation, tracker axes, shape (6, 6).

    Returns:
        T_a_b and the covariance of its origin [m] and rotation [rad], axes of a, shape (6, 6).
    """
    T_a_b = inverse(T_tracker_a) @ T_tracker_b
    back = T_tracker_a[:3, :3].T
    # A turn of frame a moves what is seen from it the other way.
    by_a = -np.eye(6)
    by_a[:3, 3:] = skew(T_tracker_b[:3, 3] - T_tracker_a[:3, 3])
    turn = np.kron(np.eye(2), back)
    covariance = turn @ (by_a @ covariance_a @ by_a.T + covariance_b) @ turn.T
    return T_a_b, covariance


def point_covariance(covariance: Array, offset: Array) -> Array:
    """Covariance of a point fixed in a frame, as seen from outside [m^2], shape (3, 3).

    Args:
        covariance: Of the frame's origin and rotation, outer axes, shape (6, 6).
        offset: From the frame's origin to the point, outer axes [m], shape (3,).
    """
    J = np.concatenate([np.eye(3), -skew(offset)], axis=1)
    return np.asarray(J @ covariance @ J.T)
