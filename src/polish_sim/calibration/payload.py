"""A tool's mass and centre and the sensor's bias from readings at rest: linear least squares (layer 8b).

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

from polish_sim.calibration.identifiability import LARGEST_CONDITION, check_identifiable, condition_of
from polish_sim.calibration.readings import PayloadReadings
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

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
