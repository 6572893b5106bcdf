"""A tool's mass and centre and the sensor's bias from readings at rest: linear least squares.

At rest the sensor reads the weight and its moment, both turning with the pose, and a bias that does not:

    f = m g u + b_f          u = R_base_sensor^T z_base, against gravity
    t = g (m c) x u + b_t    c: centre of mass in the sensor frame

Linear in ten numbers: m, m c, b_f, b_t; six more with a linear drift of the bias. Quantities named ``theta`` are
in this order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from polish_sim.errors import CalibrationError

# Whether poses tell a tool's weight from the sensor's bias, and how well.

Array = NDArray[np.float64]

LEAST_READINGS = 3
LEAST_SPREAD = 0.02
"""Least spread of the up directions along two axes [-]; 1/sqrt(3) is that of a full sphere."""
LARGEST_CONDITION = 1e5
"""Of the whole regressor; beyond it the drift cannot be told from the rest."""


def check_identifiable(up_sensor: Array) -> None:
    """Refuse poses from which mass, centre and bias cannot be told apart.

    A weight shows only by how its direction changes in the sensor: readings differ by m g times the difference of
    two up directions and by its moment. Differences along one line leave the centre along that line unseen.

    Args:
        up_sensor: Unit vectors against gravity in the sensor frame, shape (n, 3).

    Raises:
        CalibrationError: Saying what cannot be told and which pose is missing.
    """
    count = len(up_sensor)
    if count < LEAST_READINGS:
        raise CalibrationError(
            f"{count} reading{'s' if count != 1 else ''} cannot tell mass, centre and bias (10 unknowns) apart: "
            f"{LEAST_READINGS} poses with gravity along different axes of the sensor are the least, a dozen is good."
        )
    _, spread, axes = np.linalg.svd(up_sensor - up_sensor.mean(axis=0), full_matrices=False)
    spread = spread / np.sqrt(count)
    if spread[0] < LEAST_SPREAD:
        raise CalibrationError(
            f"gravity pulls in nearly the same direction of the sensor in all {count} poses (they differ by "
            f"{np.degrees(spread[0]):.2g} deg rms): neither mass nor centre can be told from the bias. Turn the tool: "
            "sideways, over head, about its own axis."
        )
    if spread[1] < LEAST_SPREAD:
        x, y, z = axes[0]
        raise CalibrationError(
            f"gravity changes along one line of the sensor only, ({x:.2f}, {y:.2f}, {z:.2f}): the centre of mass along "
            "it cannot be told from the torque bias. Add a pose that turns the tool about another axis."
        )


def condition_of(regressor: Array) -> float:
    """Condition number of a regressor without units: ratio of the largest to the smallest singular value.

    Best possible for the ten parameters: sqrt(3/2) = 1.22, from up directions spread over the whole sphere.

    Args:
        regressor: As in ``payload_regressor`` with gravity 1, shape (n, 6, p).
    """
    values = np.linalg.svd(regressor.reshape(-1, regressor.shape[2]), compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0.0 else float("inf")


# What a calibration of the payload is made from: how the sensor stood and what it read.

ROTATION_TOLERANCE = 1e-3
"""How far R^T R may be from one: the rounding of printed digits."""


@dataclass(frozen=True)
class PayloadReadings:
    """Readings of a wrist sensor that carries a tool at rest, nothing touching it."""

    time: Array
    """When each was taken [s], shape (n,)."""
    R_base_sensor: Array
    """How the sensor stood, base z up, shape (n, 3, 3)."""
    wrenches: Array
    """What it read, sensor axes, about the sensor's origin: sum of m (a - g), so a tool below a sensor that looks
    down pulls with -m g along its z axis; force [N] then torque [N m], shape (n, 6)."""

    def __post_init__(self) -> None:
        count = len(self.time)
        shapes = (self.time.shape, self.R_base_sensor.shape, self.wrenches.shape)
        if shapes != ((count,), (count, 3, 3), (count, 6)):
            raise CalibrationError(f"readings need times (n,), rotations (n, 3, 3), wrenches (n, 6); got {shapes}.")
        if not all(np.isfinite(a).all() for a in (self.time, self.R_base_sensor, self.wrenches)):
            raise CalibrationError("a reading holds a value that is not finite: leave it out.")
        turned = np.swapaxes(self.R_base_sensor, 1, 2) @ self.R_base_sensor
        wrong = np.abs(turned - np.eye(3)).max(axis=(1, 2), initial=0.0) > ROTATION_TOLERANCE
        wrong |= np.linalg.det(self.R_base_sensor) < 0.0
        if wrong.any():
            raise CalibrationError(f"the orientation of reading {int(np.argmax(wrong)) + 1} is not a rotation matrix.")
        for array in (self.time, self.R_base_sensor, self.wrenches):
            array.flags.writeable = False

    def __len__(self) -> int:
        return len(self.time)

    @property
    def up_sensor(self) -> Array:
        """Unit vectors against gravity in the sensor frame, shape (n, 3)."""
        return self.R_base_sensor[:, 2, :]

    def rows(self, mask: NDArray[np.bool_]) -> PayloadReadings:
        """Some of the readings."""
        return PayloadReadings(self.time[mask].copy(), self.R_base_sensor[mask].copy(), self.wrenches[mask].copy())


GRAVITY = 9.81  # [m/s^2], the model's
MASS, MOMENT, BIAS, DRIFT = 0, slice(1, 4), slice(4, 10), slice(10, 16)
_ROUNDS = 20
_SMALLEST_NOISE = 1e-12  # of exact data [N, N m]


class ReadingNoise(NamedTuple):
    """How wrong a reading is, by axis (force; torque)."""

    white: Array
    """Standard deviation of what is independent from reading to reading [N, N m], shape (6,) or (n, 6)."""
    walk: Array
    """Random walk of the bias, rms after one second [N/sqrt(s), N m/sqrt(s)], shape (6,)."""


@dataclass(frozen=True)
class PayloadEstimate:
    """What the readings say, and how sure."""

    theta: Array
    """m [kg], m c [kg m], b_f [N], b_t [N m] and, if asked for, their drift per second, shape (10,) or (16,)."""
    covariance: Array
    """Of theta, shape (p, p)."""
    residuals: Array
    """Reading minus model [N, N m], all readings, shape (n, 6)."""
    noise: Array
    """Standard deviation of one reading, given or found from the residuals [N, N m], shape (6,)."""
    used: NDArray[np.bool_]
    """Which readings were used, shape (n,); the others are outliers."""
    condition: float
    """Condition number of the poses [-]; 1.22 is the best possible without drift."""
    zero_time: float
    """Moment at which a drifting bias is b [s]."""

    @property
    def mass(self) -> float:
        """[kg]"""
        return float(self.theta[MASS])

    @property
    def center(self) -> Array:
        """Centre of mass in the sensor frame [m], shape (3,)."""
        return np.asarray(self.theta[MOMENT] / self.mass)

    @property
    def bias(self) -> Array:
        """Bias [N, N m], shape (6,)."""
        return self.theta[BIAS]

    @property
    def drift(self) -> Array:
        """Drift of the bias [N/s, N m/s], shape (6,); zero if it was not asked for."""
        return self.theta[DRIFT] if len(self.theta) > 10 else np.zeros(6)

    def bias_at(self, time: float) -> Array:
        """Bias at a moment [s], with what it has drifted [N, N m], shape (6,)."""
        return np.asarray(self.bias + self.drift * (time - self.zero_time))

    @property
    def mass_std(self) -> float:
        """[kg]"""
        return float(np.sqrt(self.covariance[MASS, MASS]))

    @property
    def center_covariance(self) -> Array:
        """Of the centre [m^2], to first order, shape (3, 3)."""
        slope = np.column_stack([-self.center, np.eye(3)]) / self.mass
        return np.asarray(slope @ self.covariance[:4, :4] @ slope.T)

    @property
    def center_std(self) -> Array:
        """[m], shape (3,)."""
        return np.asarray(np.sqrt(np.diag(self.center_covariance)))

    @property
    def bias_std(self) -> Array:
        """[N, N m], shape (6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[BIAS]))

    @property
    def drift_std(self) -> Array:
        """[N/s, N m/s], shape (6,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)[DRIFT])) if len(self.theta) > 10 else np.zeros(6)


def payload_regressor(up_sensor: Array, time: Array | None = None, gravity: float = GRAVITY) -> Array:
    """Derivative of the readings by theta.

    Args:
        up_sensor: Unit vectors against gravity in the sensor frame, shape (n, 3).
        time: Time since the moment of the bias [s], shape (n,); None without drift.
        gravity: [m/s^2]

    Returns:
        Shape (n, 6, 10), or (n, 6, 16) with drift.
    """
    count = len(up_sensor)
    X = np.zeros((count, 6, 10 if time is None else 16))
    X[:, :3, MASS] = gravity * up_sensor
    x, y, z = gravity * up_sensor.T
    X[:, 3, 2], X[:, 3, 3] = z, -y  # (m c) x u g
    X[:, 4, 1], X[:, 4, 3] = -z, x
    X[:, 5, 1], X[:, 5, 2] = y, -x
    X[:, :, BIAS] = np.eye(6)
    if time is not None:
        X[:, :, DRIFT] = time[:, None, None] * np.eye(6)
    return X


def fit_payload(
    readings: PayloadReadings,
    noise: ReadingNoise | None = None,
    drift: bool = False,
    gravity: float = GRAVITY,
    used: NDArray[np.bool_] | None = None,
) -> PayloadEstimate:
    """Estimate tool and bias by weighted least squares: minimum variance for the noise given.

    Args:
        readings: At least three poses with gravity along different axes of the sensor.
        noise: How wrong the readings are. If not given, force and torque noise are found from the residuals, the
            readings taken as independent.
        drift: Whether to fit a linear drift of the bias.
        gravity: [m/s^2]
        used: Readings to go by, shape (n,); all if not given.

    Returns:
        The estimate.

    Raises:
        CalibrationError: If the poses cannot tell the unknowns apart, or the readings have the wrong sign.
    """
    chosen = np.ones(len(readings), dtype=bool) if used is None else used
    check_identifiable(readings.up_sensor[chosen])
    zero_time = float(readings.time[chosen].mean())
    since = readings.time - zero_time
    X = payload_regressor(readings.up_sensor, since if drift else None, gravity)
    scaled = payload_regressor(readings.up_sensor[chosen], _unit_time(since[chosen]) if drift else None, 1.0)
    condition = condition_of(scaled)
    if condition > LARGEST_CONDITION or X[chosen].size < X.shape[2] ** 2:
        raise CalibrationError(
            f"{int(chosen.sum())} readings cannot tell the drift from mass, centre and bias: visit poses again later, "
            "and give each reading its time."
        )
    if noise is None:
        theta, covariance, white = _fit_unknown_noise(X[chosen], readings.wrenches[chosen])
    else:
        white = np.broadcast_to(noise.white, (len(readings), 6))
        theta, covariance = _solve(
            *_whitened(X[chosen], readings.wrenches[chosen], readings.time[chosen], noise._replace(white=white[chosen]))
        )
        white = np.sqrt(np.mean(white**2, axis=0))
    if theta[MASS] <= 0.0:
        raise CalibrationError(
            f"the tool comes out with a mass of {theta[MASS]:.3g} kg: the readings have the opposite sign (wanted: "
            "the force that holds the tool, upwards when it hangs still), or the orientations are not R_base_sensor."
        )
    residuals = readings.wrenches - X @ theta
    return PayloadEstimate(theta, covariance, residuals, white, chosen, condition, zero_time)


def _unit_time(since: Array) -> Array:
    """Times brought to about -1..1, so that a condition number does not depend on how long it took."""
    return since / max(float(np.abs(since).max()), 1e-12)


def _whitened(X: Array, y: Array, time: Array, noise: ReadingNoise) -> tuple[Array, Array]:
    """Rows and readings divided by the root of their covariance, axis by axis: (6 n, p) and (6 n,)."""
    rows, values = [], []
    since = time - time.min()
    for axis in range(6):
        covariance = np.diag(np.maximum(noise.white[:, axis], _SMALLEST_NOISE) ** 2)
        if noise.walk[axis] > 0.0:
            covariance += noise.walk[axis] ** 2 * np.minimum(since[:, None], since)
            root = np.linalg.cholesky(covariance)
            rows.append(solve_triangular(root, X[:, axis], lower=True))
            values.append(solve_triangular(root, y[:, axis], lower=True))
        else:
            deviation = np.sqrt(np.diag(covariance))
            rows.append(X[:, axis] / deviation[:, None])
            values.append(y[:, axis] / deviation)
    return np.concatenate(rows), np.concatenate(values)


def _solve(A: Array, b: Array) -> tuple[Array, Array]:
    """Least squares through QR with scaled columns: theta and its covariance for rows of unit variance."""
    scale = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / scale)
    R_inverse = solve_triangular(R, np.eye(len(R)))
    return R_inverse @ (Q.T @ b) / scale, (R_inverse @ R_inverse.T) / np.outer(scale, scale)


def _fit_unknown_noise(X: Array, y: Array) -> tuple[Array, Array, Array]:
    """Fit with one force and one torque noise found from the residuals: theta, covariance, noise (6,)."""
    white = np.repeat([1.0, 0.05], 3)
    for _ in range(_ROUNDS):
        theta, covariance = _solve((X / white[:, None]).reshape(-1, X.shape[2]), (y / white).ravel())
        residuals = y - X @ theta
        # Each group's share of the degrees of freedom the fit has used up.
        taken = np.einsum("nap,pq,naq->a", X, covariance, X) / white**2
        found = [
            np.sqrt(np.sum(residuals[:, axes] ** 2) / max(residuals[:, axes].size - taken[axes].sum(), 1.0))
            for axes in (slice(0, 3), slice(3, 6))
        ]
        previous, white = white, np.maximum(np.repeat(found, 3), _SMALLEST_NOISE)
        if np.allclose(white, previous, rtol=1e-6):
            break
    theta, covariance = _solve((X / white[:, None]).reshape(-1, X.shape[2]), (y / white).ravel())
    return theta, covariance, white
