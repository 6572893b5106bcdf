"""Touches of one fixed point with the tool's tip: which orientations to take, and what is refused.

A touch says R_i p + t_i = c. Subtracting the mean of all leaves (R_i - mean R) p: the common part of the
orientations gives no information. With M = I - mean(R)^T mean(R) the covariance of p is sigma^2 M^-1 / n
(paper 2): the best is a mean rotation of zero, with 3D rms errors of sqrt(3 / n) sigma.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, norms, rms_length
from polish_sim.calibration.fit import column_orders
from polish_sim.errors import CalibrationError

TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
LEAST_TOUCHES = 4
#: Least square root of an eigenvalue of M [-]: poses that differ by 3 deg rms about some axis
LEAST_SPREAD = 0.05
SUSPECT = 2e-3  #: Touches with smaller residuals are not suspected [m]
LARGEST_LEFT = 5e-3  #: No touches by hand miss by more than this [m]
_BETTER = 0.1


def touch_rows(R_base_flange: Array) -> Array:
    """R_i p - c as a matrix on tip and touched point, shape (n, 3, 6)."""
    return np.concatenate([R_base_flange, np.tile(-np.eye(3), (len(R_base_flange), 1, 1))], axis=2)


def orientation_spread(R_base_flange: Array) -> tuple[Array, Array]:
    """How far orientations (n, 3, 3) differ along each direction of the flange, least first, and those
    directions.

    Square roots of the eigenvalues of M, 0 to 1, shape (3,); the directions as columns (3, 3).
    """
    differences = R_base_flange - R_base_flange.mean(axis=0)
    _, values, directions = np.linalg.svd(differences.reshape(-1, 3), full_matrices=False)
    return values[::-1] / np.sqrt(len(R_base_flange)), directions[::-1].T


def check_touches(R_base_flange: Array) -> None:
    """Refuse orientations (n, 3, 3) that cannot determine the tool point; names the direction that is
    unseen."""
    count = len(R_base_flange)
    if count < LEAST_TOUCHES:
        raise CalibrationError(
            f"{count} touch{'es' if count != 1 else ''} cannot separate tool point and touched point: "
            f"{LEAST_TOUCHES} in different orientations are the least, ten are good."
        )
    spread, directions = orientation_spread(R_base_flange)
    if spread[1] < LEAST_SPREAD:
        raise CalibrationError(
            f"the flange stands nearly the same in all {count} touches (they differ by "
            f"{np.degrees(spread[2]):.2g} deg rms): tilt it and turn it between touches."
        )
    if spread[0] < LEAST_SPREAD:
        unseen = directions[:, 0]
        x, y, z = unseen * np.sign(unseen[np.abs(unseen).argmax()])
        raise CalibrationError(
            f"the direction ({x:.2f}, {y:.2f}, {z:.2f}) of the flange points the same way in all {count} "
            "touches: the tool point along it is unknown. Poses that only spin, or a cone without a spin of "
            "its own, do that; 'calibrate tcp' without --data writes poses that do not."
        )


def refuse_swapped(T_base_flange: Array) -> None:
    """Refuse poses (n, 4, 4) that fit ten times better with columns in another order or turned round; says
    which."""
    R_touches, places = T_base_flange[:, :3, :3], T_base_flange[:, :3, 3]
    left = _median_left(R_touches, places)
    if left < SUSPECT:
        return
    for origins, named in column_orders(places):
        if _median_left(R_touches, origins) < _BETTER * left:
            raise CalibrationError(
                f"the touches fit to {1e3 * left:.2g} mm only, but well if x, y, z are read as {named}: "
                "columns are swapped or a sign is lost."
            )
    for R, named in _orientations_otherwise(R_touches):
        if _median_left(R, places) < _BETTER * left:
            raise CalibrationError(f"the touches fit to {1e3 * left:.2g} mm only, but well if {named}.")


def refuse_far_off(residuals: Array) -> None:
    """Refuse touches that no tip and no point explain, by the residuals of their fit [m], shape (n, 3)."""
    left = rms_length(residuals)
    if left > LARGEST_LEFT:
        raise CalibrationError(
            f"no tip fits these touches: they leave {1e3 * left:.2g} mm rms. Wanted are positions and "
            "orientations of the flange in the base, touch by touch, of one tool and one fixed point. Are "
            "orientations in another order, in degrees, or those of another frame?"
        )


def _orientations_otherwise(R: Array) -> Iterator[tuple[Array, str]]:
    """The orientations if the same numbers are meant in another way."""
    yield np.swapaxes(R, 1, 2), "every orientation is turned round: it is that of the base in the flange"
    wxyz = Rotation.from_matrix(R).as_quat(scalar_first=True)
    for order in permutations(range(4)):
        named = ", ".join("q" + "wxyz"[k] for k in order)
        turned = Rotation.from_quat(wxyz[:, order], scalar_first=True)
        yield turned.as_matrix(), f"qw, qx, qy, qz are read as {named}: columns are swapped"
        yield turned.inv().as_matrix(), f"qw, qx, qy, qz are read as {named} and turned round"


def _median_left(R: Array, origins: Array) -> float:
    """Median distance of the touches from their fit [m], which a wrong one moves little."""
    A = touch_rows(R)
    theta = np.linalg.lstsq(A.reshape(-1, 6), -origins.ravel(), rcond=None)[0]
    return float(np.median(norms(A @ theta + origins)))


def plan_touch_orientations(count: int, cone: float) -> Array:
    """Orientations R_base_flange (n, 3, 3) for touches of one point.

    With the tool tilted by theta towards n azimuths 2 pi k / n and turned about itself by twice the azimuth,
    the mean rotation is cos(theta) e_z e_z^T exactly, for every n >= 4: the best a cone of theta allows. The
    3D rms error is then sigma sqrt((2 + 1 / sin(theta)^2) / n), within 5% of the best possible from 62 deg
    on.

    Args:
        count: Number of touches, four or more.
        cone: Angle of the flange's z axis from straight down [rad], 3 to 90 deg; outside it a
            CalibrationError.
    """
    if count < LEAST_TOUCHES:
        raise CalibrationError(f"{count} touches are too few for a tool point: give {LEAST_TOUCHES} or more.")
    if not math.radians(3.0) <= cone <= math.radians(90.0):
        raise CalibrationError(
            f"a cone of {math.degrees(cone):g} deg: give 3 to 90 deg. Without a tilt the length "
            "of the tool stays unknown."
        )
    azimuth = 2.0 * np.pi * np.arange(count) / count
    # Spin within half a turn either way, as a wrist has it.
    spin = np.mod(2.0 * azimuth + np.pi, 2.0 * np.pi) - np.pi
    turns = Rotation.from_euler("ZYZ", np.column_stack([azimuth, np.full(count, cone), spin]))
    return TOOL_DOWN @ turns.as_matrix()


def point_error_bound(R_base_flange: Array, noise: float) -> float:
    """Least 3D rms error any unbiased estimate of the tip can have [m]: the Cramér-Rao bound.

    ``R_base_flange``: of the touches, (n, 3, 3); ``noise``: standard deviation of one coordinate of a touch
    [m].
    """
    mean = R_base_flange.mean(axis=0)
    M = np.eye(3) - mean.T @ mean
    return float(noise * np.sqrt(np.trace(np.linalg.inv(M)) / len(R_base_flange)))
