"""A tool's tip from touches of one fixed point: joint least squares of tip and point (layer 8b).

Every touch says R_i p + t_i = c with p the tip in the flange frame and c the point in the base frame (paper 2). Solved
for both at once: differences between successive touches, as the paper has it, throw away a fifth to a third.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.left_out import Fitted, Mask, agreeing
from polish_sim.calibration.tool.identifiability import check_touches
from polish_sim.calibration.tool.swapped import refuse_far_off, refuse_swapped
from polish_sim.calibration.tool.touches import ToolTouches

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ToolPointEstimate:
    """Where the tool's tip is, and how well that is known."""

    point: Array
    """Tip in the flange frame [m], shape (3,)."""
    touched: Array
    """The touched point in the base frame [m], shape (3,)."""
    covariance: Array
    """Of tip and touched point [m^2], shape (6, 6)."""
    noise: float
    """Standard deviation of one coordinate of a touch [m]."""
    residuals: Array
    """Tip minus touched point, base frame [m], shape (n, 3)."""
    used: Mask
    """Which touches the estimate rests on, shape (n,)."""

    @property
    def std(self) -> Array:
        """Standard deviations of the tip [m], shape (3,)."""
        return np.sqrt(np.diag(self.covariance)[:3])


def fit_tool_point(touches: ToolTouches, noise: float | None = None, used: Mask | None = None) -> ToolPointEstimate:
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
    used = np.ones(len(touches), dtype=bool) if used is None else used
    check_touches(touches.R[used])
    A, y = _equations(touches)
    rows, right = A[used].reshape(-1, 6), y[used].ravel()
    Q, R = np.linalg.qr(rows)
    theta = np.linalg.solve(R, Q.T @ right)
    # One correction takes out what rounding left of exact touches.
    theta += np.linalg.solve(R, Q.T @ (right - rows @ theta))
    residuals = A @ theta - y
    if noise is None:
        noise = float(np.sqrt(np.sum(residuals[used] ** 2) / (len(rows) - 6)))
    R_inverse = np.linalg.inv(R)
    covariance = noise**2 * R_inverse @ R_inverse.T
    return ToolPointEstimate(theta[:3], theta[3:], covariance, noise, residuals, used)


def fit_tool_point_without_outliers(touches: ToolTouches, noise: float | None = None) -> ToolPointEstimate:
    """The same, leaving out touches too far off to be noise; with six touches or fewer all are used.

    Raises:
        CalibrationError: If the orientations cannot tell the tip, columns are swapped, more than a quarter of the
            touches do not fit, or, with unknown noise, no tip explains them.
    """
    check_touches(touches.R)
    refuse_swapped(touches)
    A, y = _equations(touches)

    def weighted(weights: Array) -> Fitted:
        information = np.einsum("n,nka,nkb->ab", weights, A, A)
        theta = np.linalg.solve(information, np.einsum("n,nka,nk->a", weights, A, y))
        return Fitted(A @ theta - y, A @ np.linalg.inv(information) @ np.swapaxes(A, 1, 2), 6)

    found = fit_tool_point(touches, noise, agreeing(weighted, len(touches), "touches"))
    if noise is None:
        refuse_far_off(found.residuals[found.used])
    return found


def _equations(touches: ToolTouches) -> tuple[Array, Array]:
    """Matrices (n, 3, 6) and right-hand sides (n, 3) of R_i p - c = -t_i."""
    A = np.concatenate([touches.R, np.tile(-np.eye(3), (len(touches), 1, 1))], axis=2)
    return A, -touches.origins
