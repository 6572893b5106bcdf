"""A robot's base from two circles: those a tracker's target runs while axis 1, then axis 2 of the robot
turns.

z1 is the first axis. x runs along the common normal of both axes, z1 x z2: on this arm the axes meet, so that
the normal's foot is where they meet, but its direction is as good. The origin lies d1 below the foot on the
first axis: its height follows from the robot's table, not from this measurement. Joint angles are not used
(paper 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from polish_sim.arrays import Array, Bools, angles_between, crosses, unit
from polish_sim.calibration.fit import CHANCE, Problem, agreeing, fit, slopes_of, solve
from polish_sim.errors import CalibrationError
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.spatial import transform, vectors_from_rotations

LEAST_POINTS = 6
LEAST_ARC = np.radians(30.0)  #: Shortest arc that is accepted; 120 deg and more are good [rad]
GOOD_ARC = np.radians(119.0)
LEAST_AXES_ANGLE = np.radians(5.0)  #: Least angle between the two axes [rad]
SQUARE_TOLERANCE = np.radians(2.0)  #: How far axes 1 and 2 may be from square, as they are on the arm [rad]
LARGEST_GAP = 5e-3  #: How far axes 1 and 2 of one arm may miss each other [m]; on the arm they meet
RADIUS_SLACK = 0.35  #: How far the target may be from the flange [m], when radii are compared with the arm's


@dataclass(frozen=True)
class SweptCircle:
    """A circle in space and the axis it was run about."""

    center: Array  #: [m], shape (3,)
    #: Columns u, v in the plane and the axis n, about which the points run in the positive sense, (3, 3)
    frame: Array
    radius: float  #: [m]
    covariance: Array  #: Of the centre [m] and the tilt of the axis towards u and v [rad], shape (5, 5)
    noise: float  #: Standard deviation of one coordinate of a point [m]
    residuals: Array  #: Distance of each point along the radius and the axis [m], shape (n, 2)
    used: Bools  #: Which points it rests on, shape (n,)
    arc: float  #: How far around the points go [rad]

    @property
    def axis(self) -> Array:
        """Unit vector along the axis, shape (3,)."""
        return self.frame[:, 2]


def _tilted(frame: Array, tilt: Array) -> Array:
    """Third axis of a frame after a tilt (2,) towards its first two."""
    return unit(frame @ np.append(tilt, 1.0))


class _Shape(NamedTuple):
    """The unknowns of a circle; a step is (centre in the circle's axes, tilt towards u and v, radius)."""

    center: Array
    frame: Array
    radius: float

    def moved(self, step: Array) -> _Shape:
        n = _tilted(self.frame, step[3:5])
        u = unit(self.frame[:, 0] - (self.frame[:, 0] @ n) * n)
        frame = np.column_stack([u, crosses(n, u), n])
        return _Shape(self.center + self.frame @ step[:3], frame, self.radius + step[5])


def fit_circle(points: Array, noise: float | None = None) -> SweptCircle:
    """Circle through points in the order they were run, least squares of their distances along radius and
    axis; those too far off to be noise are left out.

    Args:
        points: In the order of a rising joint angle, which gives the axis its sense [m], shape (n, 3).
        noise: Standard deviation of one coordinate [m]; None takes it from the residuals.

    Raises:
        CalibrationError: Too few points, on a line or in one place, too short an arc, or more than a quarter
            too far off.
    """
    check_arc_points(points)
    problem = _problem(points)
    used = agreeing(problem, solve(problem, _start(points)), "points of the arc")
    check_arc_points(points[used])
    found = fit(problem, _start(points[used]), noise, used)
    center, frame, radius = found.x
    x, y, _ = ((points[used] - center) @ frame).T
    angle = np.unwrap(np.arctan2(y, x))
    arc = angle.max() - angle.min()
    if arc < LEAST_ARC:
        raise CalibrationError(
            f"an arc of {np.degrees(arc):.0f} deg is too short to determine an axis: turn the joint by 120 "
            "deg or more."
        )
    turn = np.eye(6)
    turn[:3, :3] = frame
    covariance = (turn @ found.covariance @ turn.T)[:5, :5]
    return SweptCircle(center, frame, radius, covariance, found.noise[0], found.residuals, used, arc)


def check_arc_points(points: Array) -> None:
    """Refuse points through which no circle goes (CalibrationError): too few, in one place, or on a line."""
    if len(points) < LEAST_POINTS:
        raise CalibrationError(
            f"{len(points)} points are too few for a circle: {LEAST_POINTS} are the least, 200 are good."
        )
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[0] < 1e-3 * np.sqrt(len(points)):
        raise CalibrationError(
            "all points of the arc are in one place: did the joint turn while they were recorded?"
        )
    if spread[1] < 5e-3 * spread[0]:
        raise CalibrationError(
            "all points of the arc lie on a line: no circle goes through them. Turn one joint alone by 120 "
            "deg or more."
        )


def _start(points: Array) -> _Shape:
    """Plane by SVD, in it the linear least squares of x^2 + y^2 = 2 a x + 2 b y + c; axis by the sense of
    rotation."""
    mean = points.mean(axis=0)
    _, _, (u, v, _) = np.linalg.svd(points - mean, full_matrices=False)
    x, y = (points - mean) @ u, (points - mean) @ v
    a, b, c = np.linalg.lstsq(np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)]), x**2 + y**2, rcond=None)[
        0
    ]
    center = mean + a * u + b * v
    arms = points - center
    if np.sum(crosses(arms[:-1], arms[1:]) @ crosses(u, v)) < 0.0:
        v = -v
    return _Shape(center, np.column_stack([u, v, crosses(u, v)]), np.sqrt(c + a * a + b * b))


def _problem(points: Array) -> Problem[_Shape]:
    """Distances along radius and axis (n, 2) and their derivative (n, 2, 6)."""

    def residuals(shape: _Shape) -> Array:
        xi, eta, w = ((points - shape.center) @ shape.frame).T
        return np.stack([np.hypot(xi, eta) - shape.radius, w], axis=1)

    def slopes(shape: _Shape) -> Array:
        xi, eta, w = ((points - shape.center) @ shape.frame).T
        rho = np.maximum(np.hypot(xi, eta), 1e-12)
        zero = np.zeros_like(xi)
        one = np.ones_like(xi)
        radial = np.stack([-xi / rho, -eta / rho, zero, -w * xi / rho, -w * eta / rho, -one], axis=1)
        axial = np.stack([zero, zero, -one, xi, eta, zero], axis=1)
        return np.stack([radial, axial], axis=1)

    return Problem(residuals, slopes, _Shape.moved)


class BaseFrame(NamedTuple):
    """A robot's base as the tracker sees it."""

    T: Array  #: T_tracker_base [m], shape (4, 4)
    #: Of the origin's displacement [m] and a small rotation [rad], tracker axes, shape (6, 6)
    covariance: Array
    gap: float  #: Distance between the two axes [m]; 0 on a perfect arm
    meets: bool  #: Whether it was used that the axes meet and are square


def base_from_circles(first: SweptCircle, second: SweptCircle) -> BaseFrame:
    """Base frame of an arm and its covariance, to first order in the noise of the circles of joints 1 and 2.

    Joint 2 turns with joint 1 at zero, all others are at zero, points in rising order. By the arm's table
    axes 1 and 2 meet and are square: both circles are adjusted to that by their covariances. Where they
    contradict the table by more than noise explains (one in a million), the arm is not as its table says, and
    they are taken as they are. Raises CalibrationError for axes nearly parallel or not square, circles that
    cannot be the arm's, or axes that miss each other as those of one arm never do.
    """
    none = np.zeros(10)

    def axes(step: Array) -> tuple[Array, Array, Array, Array]:
        """A point and the direction of both axes after a step of centre (3) and tilt (2) of both."""
        c1, c2 = first.center + step[:3], second.center + step[5:8]
        return c1, _tilted(first.frame, step[3:5]), c2, _tilted(second.frame, step[8:])

    def off_table(step: Array) -> Array:
        """Signed distance between both axes [m] and their angle less 90 deg [rad], shape (2,)."""
        c1, z1, c2, z2 = axes(step)
        return np.array([(c2 - c1) @ unit(crosses(z1, z2)), angles_between(z1, z2) - 0.5 * np.pi])

    def frame(step: Array) -> Array:
        c1, z1, c2, z2 = axes(step)
        across = crosses(z1, z2)
        x = unit(across)
        # Foot of the common normal on the first axis.
        foot = c1 + crosses(c2 - c1, z2) @ across / (across @ across) * z1
        return transform(np.column_stack([x, crosses(z1, x), z1]), foot - NOMINAL[1, 0] * z1)

    _check_axes(first, second)
    _check_sense(first, second, frame(none)[:3, 3] + NOMINAL[1, 0] * first.axis)
    C, step = block_diag(first.covariance, second.covariance), none
    off, G = off_table(none), slopes_of(off_table, 10)
    S, gap = G @ C @ G.T, abs(off[0])
    meets = off @ np.linalg.solve(S, off) <= chdtri(2, CHANCE)
    if meets:
        gain = C @ G.T @ np.linalg.inv(S)
        C, step = C - gain @ G @ C, -gain @ off
    elif gap > LARGEST_GAP:
        raise CalibrationError(
            f"axes 1 and 2 miss each other by {1e3 * gap:.4g} mm, here they meet: arcs of two robots taken "
            "for one's, or a tracker, target or stand that moved in between?"
        )
    T = frame(step)

    def displaced(more: Array) -> Array:
        moved = frame(step + more)
        return np.concatenate([moved[:3, 3], vectors_from_rotations(moved[:3, :3] @ T[:3, :3].T)])

    J = slopes_of(displaced, 10)
    return BaseFrame(T, J @ C @ J.T, gap, meets)


def _check_axes(first: SweptCircle, second: SweptCircle) -> None:
    """Refuse circles that are not those of the arm's axes 1 and 2.

    Radii are compared with those of the stretched arm, give or take the target's place on the flange: a wrong
    unit is far off.
    """
    angle = angles_between(first.axis, second.axis)
    if min(angle, np.pi - angle) < LEAST_AXES_ANGLE:
        raise CalibrationError(
            f"axes 1 and 2 are nearly parallel ({np.degrees(angle):.1f} deg): they have no common normal. "
            "Was the same joint turned twice?"
        )
    reach = abs(NOMINAL[2].sum())
    wanted = (np.hypot(reach, NOMINAL[1, 3] + NOMINAL[1, 5]), np.hypot(reach, NOMINAL[1, 4]))
    for axis, (circle, radius) in enumerate(zip((first, second), wanted, strict=True), 1):
        if abs(circle.radius - radius) > RADIUS_SLACK:
            raise CalibrationError(
                f"the circle of axis {axis} has a radius of {1e3 * circle.radius:.4g} mm; with the arm "
                f"stretched out (all other joints at zero) it is about {1e3 * radius:.0f} mm. Wrong unit, or "
                "joints not at zero?"
            )
    if abs(angle - 0.5 * np.pi) > SQUARE_TOLERANCE:
        raise CalibrationError(
            f"axes 1 and 2 are {np.degrees(angle):.2f} deg apart, on this arm they are square: did another "
            "joint or the robot's stand move?"
        )


def _check_sense(first: SweptCircle, second: SweptCircle, foot: Array) -> None:
    """Refuse a mirror image, and points recorded backwards, by the side of where axes 1 and 2 meet (3,) on
    which the circles lie: with all joints at zero the flange is d4 + d6 out along axis 2 and d5 below it."""
    backwards_2 = (second.center - foot) @ second.axis < 0.0
    backwards_1 = (first.center - foot) @ first.axis > 0.0
    if backwards_1 and backwards_2:
        raise CalibrationError(
            "the circles are the mirror image of the arm's: the measurements are left-handed. Two columns "
            "are swapped, one has the wrong sign, or both arcs were recorded with falling joint angles."
        )
    if backwards_1 or backwards_2:
        raise CalibrationError(
            f"the arc of axis {1 if backwards_1 else 2} runs against the joint's positive sense: give its "
            "points in the order of rising joint angle, the target within 90 mm of the flange's centre line."
        )
