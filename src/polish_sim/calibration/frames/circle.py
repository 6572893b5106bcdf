"""The circle a tracker's target runs while one axis of a robot turns: plane, centre, radius, covariance (layer 8b)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.left_out import Fitted, Mask, agreeing
from polish_sim.errors import CalibrationError
from polish_sim.spatial import unit

Array = NDArray[np.float64]

LEAST_POINTS = 6
LEAST_ARC = np.radians(30.0)
"""Shortest arc that is believed; 120 deg and more are good [rad]."""
GOOD_ARC = np.radians(119.0)
_ROUNDS, _SCREENING_ROUNDS = 30, 3


@dataclass(frozen=True)
class Circle:
    """A circle in space and the axis it was run about."""

    center: Array
    """[m], shape (3,)."""
    frame: Array
    """Columns u, v in the plane and the axis n, about which the points run in the positive sense, shape (3, 3)."""
    radius: float
    """[m]"""
    covariance: Array
    """Of the centre [m] and the tilt of the axis towards u and v [rad], shape (5, 5)."""
    noise: float
    """Standard deviation of one coordinate of a point [m]."""
    residuals: Array
    """Distance of each point along the radius and the axis [m], shape (n, 2)."""
    used: Mask
    """Which points it rests on, shape (n,)."""
    arc: float
    """How far around the points go [rad]."""

    @property
    def axis(self) -> Array:
        """Unit vector along the axis, shape (3,)."""
        return self.frame[:, 2]


class _Shape:
    """A circle on the way to its best fit: centre, frame, radius."""

    def __init__(self, center: Array, frame: Array, radius: float) -> None:
        self.center, self.frame, self.radius = center, frame, radius

    def residuals(self, points: Array) -> tuple[Array, Array]:
        """Residuals (n, 2) and their derivative (n, 2, 6) by centre (circle's axes), tilt towards u and v, radius."""
        xi, eta, w = ((points - self.center) @ self.frame).T
        rho = np.maximum(np.hypot(xi, eta), 1e-12)
        zero, one = np.zeros_like(xi), np.ones_like(xi)
        radial = np.stack([-xi / rho, -eta / rho, zero, -w * xi / rho, -w * eta / rho, -one], axis=1)
        axial = np.stack([zero, zero, -one, xi, eta, zero], axis=1)
        return np.stack([rho - self.radius, w], axis=1), np.stack([radial, axial], axis=1)

    def moved(self, step: Array) -> _Shape:
        """The circle after a step of the six parameters."""
        n = unit(self.frame @ np.array([step[3], step[4], 1.0]))
        u = unit(self.frame[:, 0] - (self.frame[:, 0] @ n) * n)
        frame = np.column_stack([u, np.cross(n, u), n])
        return _Shape(self.center + self.frame @ step[:3], frame, self.radius + float(step[5]))


def fit_circle(points: Array, noise: float | None = None, used: Mask | None = None) -> Circle:
    """Circle through points in the order they were run, least squares of their true distances.

    Plane by SVD, an algebraic start, then Gauss-Newton on distances along the radius and the axis: the maximum
    likelihood for equal Gaussian noise.

    Args:
        points: Points in the order of a rising joint angle [m], shape (n, 3).
        noise: Standard deviation of one coordinate [m]; None takes it from the residuals.
        used: Points to use, shape (n,); None uses all.

    Returns:
        The circle, its axis by the sense of rotation.

    Raises:
        CalibrationError: Too few points, on a line or in one place, or too short an arc.
    """
    used = np.ones(len(points), dtype=bool) if used is None else used
    check_arc_points(points[used])
    shape = _refined(_start(points[used]), points, used.astype(float), _ROUNDS)
    shape = _by_sense(shape, points[used])
    e, J = shape.residuals(points)
    rows = J[used].reshape(-1, 6)
    if noise is None:
        noise = float(np.sqrt(np.sum(e[used] ** 2) / (len(rows) - 6)))
    turn = np.eye(6)
    turn[:3, :3] = shape.frame
    covariance = noise**2 * turn @ np.linalg.inv(rows.T @ rows) @ turn.T
    arc = _arc(shape, points[used])
    if arc < LEAST_ARC:
        raise CalibrationError(
            f"an arc of {np.degrees(arc):.0f} deg is too short to tell an axis: turn the joint by 120 deg or more."
        )
    return Circle(shape.center, shape.frame, shape.radius, covariance[:5, :5], noise, e, used, arc)


def fit_circle_without_outliers(points: Array, noise: float | None = None) -> Circle:
    """The same, leaving out points too far off to be noise.

    Raises:
        CalibrationError: As `fit_circle`, or more than a quarter of the points do not fit.
    """
    check_arc_points(points)
    start = _refined(_start(points), points, np.ones(len(points)), _ROUNDS)
    used = agreeing(lambda weights: _fitted(start, points, weights), len(points), "points of the arc")
    return fit_circle(points, noise, used)


def check_arc_points(points: Array) -> None:
    """Refuse points through which no circle goes.

    Raises:
        CalibrationError: Too few, in one place, or on a line.
    """
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise CalibrationError(f"points of an arc need the shape (n, 3), all finite; got {points.shape}.")
    if len(points) < LEAST_POINTS:
        raise CalibrationError(
            f"{len(points)} points are too few for a circle: {LEAST_POINTS} are the least, 200 are good."
        )
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] < 1e-3 * np.sqrt(len(points)):
        raise CalibrationError("all points of the arc are in one place: did the joint turn while they were recorded?")
    if spread[1] < 5e-3 * spread[0]:
        raise CalibrationError(
            "all points of the arc lie on a line: no circle goes through them. Turn one joint alone by 120 deg or more."
        )


def _start(points: Array) -> _Shape:
    """Plane by SVD, then the linear least squares of x^2 + y^2 = 2 a x + 2 b y + c in it."""
    mean = points.mean(axis=0)
    _, _, Vt = np.linalg.svd(points - mean)
    frame = np.column_stack([Vt[0], Vt[1], np.cross(Vt[0], Vt[1])])
    x, y, _ = ((points - mean) @ frame).T
    a, b, c = np.linalg.lstsq(np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)]), x**2 + y**2, rcond=None)[0]
    return _Shape(mean + frame @ np.array([a, b, 0.0]), frame, float(np.sqrt(c + a * a + b * b)))


def _refined(shape: _Shape, points: Array, weights: Array, rounds: int) -> _Shape:
    root = np.repeat(np.sqrt(weights), 2)
    for _ in range(rounds):
        e, J = shape.residuals(points)
        step = np.linalg.lstsq(J.reshape(-1, 6) * root[:, None], -e.ravel() * root, rcond=None)[0]
        shape = shape.moved(step)
        if np.abs(step).max() < 1e-13 * (1.0 + shape.radius):
            break
    return shape


def _fitted(start: _Shape, points: Array, weights: Array) -> Fitted:
    e, J = _refined(start, points, weights, _SCREENING_ROUNDS).residuals(points)
    spread = np.linalg.inv(np.einsum("n,nka,nkb->ab", weights, J, J))
    return Fitted(e, J @ spread @ np.swapaxes(J, 1, 2), 6)


def _by_sense(shape: _Shape, points: Array) -> _Shape:
    """The same circle with its axis along the sense in which the points are run."""
    arms = points - shape.center
    if np.sum(np.cross(arms[:-1], arms[1:]) @ shape.frame[:, 2]) >= 0.0:
        return shape
    u, v, n = shape.frame.T
    return _Shape(shape.center, np.column_stack([u, -v, -n]), shape.radius)


def _arc(shape: _Shape, points: Array) -> float:
    """Angle from the first to the last point, turns included [rad]."""
    x, y, _ = ((points - shape.center) @ shape.frame).T
    angle = np.unwrap(np.arctan2(y, x))
    return float(angle.max() - angle.min())
