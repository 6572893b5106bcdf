"""One frame in another from points known in both: Kabsch's rotation, with covariance."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import gammainc

from polish_sim.calibration.outliers import Fitted, Mask, agreeing
from polish_sim.errors import CalibrationError
from polish_sim.spatial import apply, inverse, skew, transform

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


# One robot's base in the other's, from both as the tracker sees them; covariances carried along.


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


# How large a Gaussian error in space is: the distribution of its length, from covariances.
#
# An error with covariance C = L L^T is z L u: u a direction, all equally likely, and z a chi with three degrees of
# freedom. Where u is known the length is z |L u|; what is left is a mean over directions:
#
#     P(length <= r) = mean over u of gammainc(3/2, r^2 / (2 u^T C u))

NODES: Final = 48
"""Gauss-Legendre nodes in each angle of an eighth of the sphere: the other seven are its mirror images."""


def length_probability(covariances: Array, lengths: Array) -> Array:
    """Share of errors no longer than each length.

    Args:
        covariances: Of errors that occur equally often [m^2], shape (n, 3, 3).
        lengths: [m], shape (k,).

    Returns:
        Probabilities, shape (k,).
    """
    # Turned to its own axes the covariance is diagonal; directions are as likely as before.
    variances = np.linalg.eigvalsh(covariances)
    squares, weights = _directions()
    s = np.maximum(variances, 0.0) @ squares.T
    with np.errstate(divide="ignore", invalid="ignore"):
        below = gammainc(1.5, 0.5 * lengths[:, None, None] ** 2 / s)
    return np.asarray(np.mean(np.where(s > 0.0, below, 1.0) @ weights, axis=1))


def length_quantile(covariances: Array, share: float) -> float:
    """The length that a share of the errors stays below [m].

    Args:
        covariances: Of errors that occur equally often [m^2], shape (n, 3, 3).
        share: Between 0 and 1.
    """
    # Chebyshev: no more than (1 - share) / 2 are longer than this.
    longest = float(np.sqrt(2.0 * np.trace(covariances, axis1=1, axis2=2).max() / (1.0 - share)))
    if longest == 0.0:
        return 0.0

    def beyond(length: float) -> float:
        return float(length_probability(covariances, np.array([length]))[0]) - share

    return float(brentq(beyond, 0.0, longest, xtol=1e-6 * longest))


def quadratic_tail(covariance: Array, weight: Array, limit: float) -> float:
    """How often x^T W x is above a limit, x Gaussian with mean zero.

    With eigenvalues l of C W / limit it is the integral of exp(-s) / (s sqrt(prod(1 - 2 l s))) ds / (2 pi i) along a
    line that leaves 0 to its left and 1 / (2 l) to its right; bent to the right it falls like a Gaussian.

    Args:
        covariance: Of x, shape (n, n).
        weight: W, symmetric and positive semi-definite, shape (n, n).
        limit: Above 0, in the unit of x^T W x.
    """
    values = np.linalg.eigvals(covariance @ weight).real / limit
    if not values.max(initial=0.0) > 0.0:
        return 0.0
    first = 0.5 / float(values.max())
    bend = 0.5 / max(first, 1.0)

    def height(t: float) -> float:
        s = 0.5 * first + bend * t * t + 1j * t
        return float((np.exp(-s) / (s * np.prod(np.sqrt(1.0 - 2.0 * values * s))) * (1.0 - 2j * bend * t)).real)

    return float(quad(height, 0.0, np.sqrt(40.0 / bend), epsabs=1e-9, limit=200)[0] / np.pi)


def _directions() -> tuple[Array, Array]:
    """Squares of unit vectors' coordinates, shape (d, 3), and weights whose sum is one, shape (d,)."""
    x, w = np.polynomial.legendre.leggauss(NODES)
    x, w = 0.5 * (x + 1.0), 0.5 * w
    height, turn = np.meshgrid(x, 0.5 * np.pi * x, indexing="ij")
    flat = 1.0 - height**2
    squares = np.stack([flat * np.cos(turn) ** 2, flat * np.sin(turn) ** 2, height**2], axis=-1)
    return squares.reshape(-1, 3), np.outer(w, w).ravel()
