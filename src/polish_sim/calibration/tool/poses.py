"""Orientations in which touches tell the most about a tool's tip (layer 8b).

With the tool tilted by theta towards n azimuths 2 pi k / n and turned about itself by twice the azimuth, the mean
rotation is cos(theta) e_z e_z^T exactly, for every n >= 4: the best a cone of theta allows. The 3D rms error is then
sigma sqrt((2 + 1 / sin(theta)^2) / n), within 5% of the best possible sqrt(3 / n) sigma from 62 deg on.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.tool.identifiability import LEAST_TOUCHES
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

TOOL_DOWN = np.diag([1.0, -1.0, -1.0])


def plan_touch_orientations(count: int, cone: float) -> Array:
    """Orientations of the flange for touches of one point.

    Args:
        count: Number of touches, four or more.
        cone: Angle of the flange's z axis from straight down [rad], above 0 and at most 90 deg.

    Returns:
        R_base_flange, shape (n, 3, 3).

    Raises:
        CalibrationError: Too few touches, or no cone.
    """
    if count < LEAST_TOUCHES:
        raise CalibrationError(f"{count} touches are too few for a tool point: give {LEAST_TOUCHES} or more.")
    if not math.radians(3.0) <= cone <= math.radians(90.0):
        raise CalibrationError(
            f"a cone of {math.degrees(cone):g} deg: give 3 to 90 deg. Without a tilt no touch tells "
            "how long the tool is."
        )
    azimuth = 2.0 * np.pi * np.arange(count) / count
    # Spin within half a turn either way, as a wrist has it.
    spin = np.mod(2.0 * azimuth + np.pi, 2.0 * np.pi) - np.pi
    turns = Rotation.from_euler("ZYZ", np.column_stack([azimuth, np.full(count, cone), spin]))
    return np.asarray(TOOL_DOWN @ turns.as_matrix())


def point_error_bound(R_base_flange: Array, noise: float) -> float:
    """Least 3D rms error any unbiased estimate of the tip can have [m]: the Cramér-Rao bound.

    Args:
        R_base_flange: Orientations of the touches, shape (n, 3, 3).
        noise: Standard deviation of one coordinate of a touch [m].
    """
    mean = R_base_flange.mean(axis=0)
    M = np.eye(3) - mean.T @ mean
    return float(noise * np.sqrt(np.trace(np.linalg.inv(M)) / len(R_base_flange)))
