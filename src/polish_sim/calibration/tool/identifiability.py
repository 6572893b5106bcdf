"""Whether orientations of the flange tell where the tool's tip is (layer 8b).

A touch says R_i p + t_i = c. Subtracting the mean of all leaves (R_i - mean R) p: what the orientations share says
nothing. With M = I - mean(R)^T mean(R) the covariance of p is sigma^2 M^-1 / n (paper 2): nothing is better than a
mean rotation of zero, and 3D rms errors of sqrt(3 / n) sigma.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

LEAST_TOUCHES = 4
LEAST_SPREAD = 0.05
"""Least square root of an eigenvalue of M [-]: poses that differ by about 3 deg rms about some direction."""


def orientation_spread(R_base_flange: Array) -> tuple[Array, Array]:
    """How far orientations differ along each direction of the flange, least first, and those directions.

    Args:
        R_base_flange: Orientations, shape (n, 3, 3).

    Returns:
        Square roots of the eigenvalues of M, 0 to 1, shape (3,); the directions as columns (3, 3).
    """
    differences = R_base_flange - R_base_flange.mean(axis=0)
    _, values, directions = np.linalg.svd(differences.reshape(-1, 3), full_matrices=False)
    return values[::-1] / np.sqrt(len(R_base_flange)), directions[::-1].T


def check_touches(R_base_flange: Array) -> None:
    """Refuse orientations that cannot tell the tool point.

    Raises:
        CalibrationError: Saying which direction of the flange stays unseen.
    """
    count = len(R_base_flange)
    if count < LEAST_TOUCHES:
        raise CalibrationError(
            f"{count} touch{'es' if count != 1 else ''} cannot tell tool point and touched point: {LEAST_TOUCHES} in "
            "different orientations are the least, ten are good."
        )
    spread, directions = orientation_spread(R_base_flange)
    if spread[1] < LEAST_SPREAD:
        raise CalibrationError(
            f"the flange stands nearly the same in all {count} touches (they differ by "
            f"{np.degrees(spread[2]):.2g} deg rms): tilt it and turn it between touches."
        )
    if spread[0] < LEAST_SPREAD:
        x, y, z = directions[:, 0] * (1.0 if directions[np.argmax(np.abs(directions[:, 0])), 0] > 0.0 else -1.0)
        raise CalibrationError(
            f"the direction ({x:.2f}, {y:.2f}, {z:.2f}) of the flange points the same way in all {count} touches: the "
            "tool point along it cannot be told. Poses that only spin, or a cone without a spin of its own, do that; "
            "'calibrate tcp' without --data writes poses that do not."
        )
