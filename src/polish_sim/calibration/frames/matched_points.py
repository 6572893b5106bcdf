"""One frame in another from points known in both: Kabsch's rotation, with covariance (layer 8b)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.left_out import Fitted, Mask, agreeing
from polish_sim.errors import CalibrationError
from polish_sim.spatial import apply, skew, transform

Array = NDArray[np.float64]

LEAST_POINTS = 3
LEAST_WIDTH = 0.02
"""Least width of the points across their longest direction, as a share of it."""
LARGEST_STRETCH = 0.02
"""How far the same distances may differ in both frames, as a share."""


class FrameEstimate(NamedTuple):
    """A frame ``b`` as seen in a frame ``a``."""

    T: Array
    """T_a_b [m], shape (4, 4)."""
    covariance: Array
    """Of the origin's displacement [m] and a small rotation [rad], both in frame a, shape (6, 6)."""
    noise: float
    """Standard deviation of one coordinate of one measurement [m]."""
    residuals: Array
    """Measured minus fitted, frame a [m], shape (n, 3)."""
    used: Mask
    """Which measurements it rests on, shape (n,)."""


def fit_frame(points_a: Array, points_b: Array, noise: float | None = None, used: Mask | None = None) -> FrameEstimate:
    """The rigid transform that carries points of frame b to where frame a sees them.

    Args:
        points_a: Points in frame a [m], shape (n, 3).
        points_b: The same points in frame b [m], shape (n, 3).
        noise: Standard deviation of one coordinate of the difference [m]; None takes it from the residuals.
        used: Points to use, shape (n,); None uses all.

    Returns:
        T_a_b, least squares.

    Raises:
        CalibrationError: Fewer than three points, all on a line, unlike distances (units), or mirrored (columns).
    """
    used = np.ones(len(points_a), dtype=bool) if used is None else used
    check_matched(points_a[used], points_b[used])
    T = kabsch(points_a, points_b, used.astype(float))
    residuals = points_a - apply(T, points_b)
    count = int(used.sum())
    if noise is None:
        noise = float(np.sqrt(np.sum(residuals[used] ** 2) / (3 * count - 6)))
    J = _slopes(T, points_b)[used].reshape(-1, 6)
    return FrameEstimate(T, np.asarray(noise**2 * np.linalg.inv(J.T @ J)), noise, residuals, used)


def fit_frame_without_outliers(points_a: Array, points_b: Array, noise: float | None = None) -> FrameEstimate:
    """The same, leaving out points too far off to be noise; with six points or fewer all are used.

    Raises:
        CalibrationError: As `fit_frame`, or more than a quarter of the points do not fit.
    """
    check_matched(points_a, points_b)

    def weighted(weights: Array) -> Fitted:
        T = kabsch(points_a, points_b, weights)
        J = _slopes(T, points_b)
        spread = np.linalg.inv(np.einsum("n,nka,nkb->ab", weights, J, J))
        return Fitted(points_a - apply(T, points_b), J @ spread @ np.swapaxes(J, 1, 2), 6)

    return fit_frame(points_a, points_b, noise, agreeing(weighted, len(points_a), "points"))


def check_matched(points_a: Array, points_b: Array) -> None:
    """Refuse points that give no frame, and say why.

    Raises:
        CalibrationError: Fewer than three points, all on a line, unlike distances (units), or mirrored (columns).
    """
    if points_a.shape != points_b.shape or points_a.ndim != 2 or points_a.shape[1] != 3:
        raise CalibrationError(f"matched points need the same shape (n, 3); got {points_a.shape}, {points_b.shape}.")
    if len(points_a) < LEAST_POINTS:
        raise CalibrationError(
            f"{len(points_a)} points give no frame: three not on a line are the least, ten are good."
        )
    spreads = [np.linalg.svd(p - p.mean(axis=0), compute_uv=False) for p in (points_a, points_b)]
    for spread in spreads:
        if spread[1] <= LEAST_WIDTH * spread[0]:
            raise CalibrationError(
                f"all {len(points_a)} points lie on a line or in one place: a turn about it cannot be told. "
                "Add points well off it."
            )
    stretch = float(np.median(spreads[0][:2] / spreads[1][:2]))
    if abs(stretch - 1.0) > LARGEST_STRETCH:
        raise CalibrationError(
            f"the same distances are {stretch:.4g} times as long in one frame as in the other: are units mixed (mm, m, "
            "inch), or the points not in the same order?"
        )
    _refuse_mirrored(points_a, points_b)


def _refuse_mirrored(points_a: Array, points_b: Array) -> None:
    """A mirror image fits far better than any rotation: a left-handed frame."""
    a, b = points_a - points_a.mean(axis=0), points_b - points_b.mean(axis=0)
    U, values, Vt = np.linalg.svd(a.T @ b)
    # Planar points can be turned onto their mirror image.
    if np.linalg.det(U @ Vt) > 0.0 or values[2] <= LEAST_WIDTH**2 * values[0]:
        return
    mirrored = float(np.sum((a - b @ (U @ Vt).T) ** 2))
    turned = float(np.sum(a**2) + np.sum(b**2) - 2.0 * (values[0] + values[1] - values[2]))
    if turned > 25.0 * mirrored:
        raise CalibrationError(
            "the points fit a mirror image, not a rotation: one of the frames is left-handed. Two columns are swapped "
            "or one has the wrong sign."
        )


def kabsch(points_a: Array, points_b: Array, weights: Array) -> Array:
    """T_a_b of points seen in a and in b, each (n, 3), weighted (n,); unchecked, see `fit_frame`."""
    share = weights / weights.sum()
    mean_a, mean_b = share @ points_a, share @ points_b
    U, _, Vt = np.linalg.svd((points_a - mean_a).T @ (share[:, None] * (points_b - mean_b)))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return transform(R, mean_a - R @ mean_b)


def _slopes(T: Array, points_b: Array) -> Array:
    """Derivative of the points seen in a by displacement and rotation of b, shape (n, 3, 6)."""
    turned = points_b @ T[:3, :3].T
    return np.stack([np.concatenate([np.eye(3), -skew(v)], axis=1) for v in turned])
