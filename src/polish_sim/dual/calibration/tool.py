"""A tool's frame on the flange: its tip from touches of one fixed point, its axes from moves along them.

Every touch says R_i p + t_i = c with p the tip in the flange frame and c the point in the base frame (paper 2).
Solved for both at once: differences between successive touches, as the paper has it, lose a fifth to a third of the
information.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.calibration.fit import Fit, Problem, agreeing, fit
from polish_sim.calibration.poses import check_poses
from polish_sim.dual.calibration.matched_points import fit_frame
from polish_sim.dual.calibration.tool_checks import ToolTouches, check_touches, refuse_far_off, refuse_swapped
from polish_sim.errors import CalibrationError
from polish_sim.spatial import transform

LEAST_MOVE = 5e-3
"""Shortest move that gives a direction [m]."""
LEAST_SINE = 0.1
"""Least sine of the angle between the two moves."""


class ToolPoint(Fit[Array]):
    """Tip and touched point: x [m], shape (6,); residuals: tip minus touched point, base frame [m], shape (n, 3)."""

    @property
    def point(self) -> Array:
        """Tip in the flange frame [m], shape (3,)."""
        return self.x[:3]

    @property
    def touched(self) -> Array:
        """The touched point in the base frame [m], shape (3,)."""
        return self.x[3:]

    @property
    def std(self) -> Array:
        """Standard deviations of the tip [m], shape (3,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[:3]))


def fit_tool_point(touches: ToolTouches, noise: float | None = None, used: Bools | None = None) -> ToolPoint:
    """Tip and touched point by least squares.

    Args:
        touches: Flange poses of the touches.
        noise: Standard deviation of one coordinate of a touch [m]; None takes it from the residuals.
        used: Touches to use, shape (n,); None uses all.

    Returns:
        The estimate, efficient for equal Gaussian noise: covariance sigma^2 (A^T A)^-1.

    Raises:
        CalibrationError: If the orientations cannot tell the tip.
    """
    check_touches(touches.R if used is None else touches.R[used])
    return ToolPoint(**vars(fit(_problem(touches), np.zeros(6), noise, used)))


def fit_tool_point_without_outliers(touches: ToolTouches, noise: float | None = None) -> ToolPoint:
    """The same, leaving out touches too far off to be noise; with six touches or fewer all are used.

    Raises:
        CalibrationError: If the orientations cannot tell the tip, columns are swapped, more than a quarter of the
            touches do not fit, or, with unknown noise, no tip explains them.
    """
    check_touches(touches.R)
    refuse_swapped(touches)
    found = fit_tool_point(touches, noise, agreeing(_problem(touches), np.zeros(6), "touches"))
    if noise is None:
        refuse_far_off(found.residuals[found.used])
    return found


def _problem(touches: ToolTouches) -> Problem[Array]:
    """R_i p - c = -t_i for the unknowns p, c."""
    A = np.concatenate([touches.R, np.tile(-np.eye(3), (len(touches), 1, 1))], axis=2)
    return Problem(lambda x: A @ x + touches.origins, lambda _: A)


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
    R = found.x[:3, :3]
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


@dataclass(frozen=True)
class ToolMeasurements:
    """Touches of one fixed point, and moves of the tip along known directions of the tool."""

    touches: ToolTouches
    T_base_flange_moves: Array
    """Flange poses: start, then along +x, then in the x-z plane; or start and any moves; none if not measured,
    shape (m, 4, 4)."""
    moves_tool: Array | None = None
    """How far each lies from the start, tool axes [m], shape (m, 3); None for the three points."""

    def __post_init__(self) -> None:
        check_poses(self.T_base_flange_moves, "move")
        self.T_base_flange_moves.flags.writeable = False


@dataclass(frozen=True)
class ToolFrameEstimate:
    """Where the tool's tip is and how the tool stands, on the flange."""

    tip: ToolPoint
    orientation: ToolOrientation | None
    """None if no moves were measured: the tool is then taken to stand as the flange does."""

    @property
    def T_flange_tool(self) -> Array:
        """Pose of the tool on the flange, shape (4, 4)."""
        R = np.eye(3) if self.orientation is None else self.orientation.R_flange_tool
        return transform(R, self.tip.point)


def fit_tool_frame(measured: ToolMeasurements, noise: float | None = None) -> ToolFrameEstimate:
    """Tip and axes of a tool; touches too far off to be noise are left out.

    Args:
        measured: Touches and moves.
        noise: Standard deviation of one coordinate of the tip [m]; None takes it from the touches' residuals.

    Returns:
        The estimate.

    Raises:
        CalibrationError: If poses or moves cannot tell the frame, or touches do not fit each other; with unknown noise
            also columns swapped and touches no tip explains.
    """
    tip = fit_tool_point_without_outliers(measured.touches, noise)
    if len(measured.T_base_flange_moves) == 0:
        return ToolFrameEstimate(tip, None)
    points = tip_positions_flange(measured.T_base_flange_moves, tip.point)
    if measured.moves_tool is None:
        return ToolFrameEstimate(tip, orientation_from_three_points(points, float(tip.noise[0])))
    return ToolFrameEstimate(tip, orientation_from_moves(points, measured.moves_tool, float(tip.noise[0])))
