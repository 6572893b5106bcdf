"""How a tool stands on its flange, from moves of its tip along known directions of the tool (layer 8b)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.frames.matched_points import fit_frame
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

LEAST_MOVE = 5e-3
"""Shortest move that tells a direction [m]."""
LEAST_SINE = 0.1
"""Least sine of the angle between the two moves."""


class ToolOrientation(NamedTuple):
    """How the tool stands on the flange."""

    R_flange_tool: Array
    """Shape (3, 3)."""
    covariance: Array
    """Of a small rotation about the tool's axes [rad^2], shape (3, 3)."""
    residuals: Array
    """Measured minus fitted points, flange axes [m], shape (m, 3); zero for three points."""


def tip_positions_flange(T_base_flange: Array, point_flange: Array) -> Array:
    """Where the tip was, in the axes of the flange, from the first pose's tip on.

    The flange should keep its orientation; what it turned by mistake is allowed for.

    Args:
        T_base_flange: Flange poses, the start first, shape (m, 4, 4).
        point_flange: Tip in the flange frame [m], shape (3,).

    Returns:
        Tip positions less the first one [m], axes of the first flange, shape (m, 3).
    """
    tips = T_base_flange[:, :3, :3] @ point_flange + T_base_flange[:, :3, 3]
    return np.asarray((tips - tips[0]) @ T_base_flange[0, :3, :3])


def orientation_from_three_points(points: Array, noise: float) -> ToolOrientation:
    """Tool axes from a start, a move along the tool's +x and a move in its x-z plane, z positive (Gram-Schmidt).

    Args:
        points: The three tip positions, flange axes [m], shape (3, 3).
        noise: Standard deviation of one coordinate [m].

    Returns:
        The orientation; its covariance to first order.

    Raises:
        CalibrationError: Moves too short, or both along one line.
    """
    if points.shape != (3, 3):
        raise CalibrationError(f"an orientation from three points needs the shape (3, 3); got {points.shape}.")
    along, across = points[1] - points[0], points[2] - points[0]
    lengths = np.linalg.norm([along, across], axis=1)
    if lengths.min() < LEAST_MOVE:
        raise CalibrationError(
            f"a move of {1e3 * lengths.min():.2g} mm is too short to tell a direction: move {1e3 * LEAST_MOVE:g} mm or "
            "more, 100 mm is good."
        )
    x = along / lengths[0]
    height = across - (across @ x) * x
    if np.linalg.norm(height) < LEAST_SINE * lengths[1]:
        raise CalibrationError(
            "the move along x and the move in the x-z plane are nearly parallel: the second must leave the x axis."
        )
    z = height / np.linalg.norm(height)
    R = np.column_stack([x, np.cross(z, x), z])
    J = _three_point_slopes(R, float(lengths[0]), across)
    return ToolOrientation(R, noise**2 * J @ J.T, np.zeros((3, 3)))


def orientation_from_moves(points: Array, moves_tool: Array, noise: float) -> ToolOrientation:
    """Tool axes from any number of moves by known amounts along the tool's axes, by SVD (Kabsch).

    Args:
        points: Tip positions, flange axes, the start among them [m], shape (m, 3).
        moves_tool: How far each lies from the start, tool axes [m], shape (m, 3).
        noise: Standard deviation of one coordinate [m].

    Returns:
        The orientation.

    Raises:
        CalibrationError: Fewer than three points, points on a line, or columns swapped.
    """
    found = fit_frame(points, moves_tool, noise)
    R = found.T[:3, :3]
    return ToolOrientation(R, R.T @ found.covariance[3:, 3:] @ R, found.residuals)


def _three_point_slopes(R: Array, length: float, across: Array) -> Array:
    """Derivative of the rotation about the tool's axes by the three points, shape (3, 9).

    With x turned by (y.dx) y + (z.dx) z over the length: phi_z = y.dx / L, phi_y = -z.dx / L; z turns towards y by what
    the second move shows less what x took along.
    """
    x, y, z = R.T
    height, run = float(across @ z), float(across @ x)
    of_x, of_xz = np.zeros((3, 3)), np.zeros((3, 3))
    of_x[2], of_x[1] = y / length, -z / length
    of_xz[0], of_x[0] = -y / height, y * run / (height * length)
    return np.concatenate([-of_x - of_xz, of_x, of_xz], axis=1)
