"""Readings that fit no tool the others agree on: found and left out (layer 8b)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from polish_sim.calibration.identifiability import check_identifiable
from polish_sim.calibration.payload import GRAVITY, PayloadEstimate, fit_payload, payload_regressor
from polish_sim.calibration.readings import PayloadReadings
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

CHANCE = 1e-7
"""A reading this unlikely (Gaussian noise, its six axes together) is an outlier."""
LARGEST_SHARE = 0.25
"""More outliers than this and the readings as a whole are not believed."""
_LEAST_LEFT = 6
_ROUNDS = 25
_GAUSSIAN_MEDIAN = 0.6745  # of |x| for unit variance
_SMALLEST_SCALE = np.repeat([2e-3, 1e-4], 3)
"""Nothing this near is an outlier, however quiet the sensor: drift and residual motion move it [N, N m]."""


def fit_without_outliers(readings: PayloadReadings, drift: bool = False, gravity: float = GRAVITY) -> PayloadEstimate:
    """Fit, leaving out readings too far off to be noise.

    A fit by least absolute deviations, which a few wrong readings do not move, says who is suspect; then readings
    are left out or taken back by their distance from the least-squares fit of the others. With fewer than seven
    readings nothing is left out: too few would be left to say who is right.

    Args:
        readings: At rest, nothing touching the tool.
        drift: Whether to fit a linear drift of the bias.
        gravity: [m/s^2]

    Returns:
        The estimate; ``used`` tells which readings it rests on.

    Raises:
        CalibrationError: If the poses do not suffice, or more than a quarter of the readings do not fit.
    """
    if len(readings) <= _LEAST_LEFT:
        return fit_payload(readings, None, drift, gravity)
    check_identifiable(readings.up_sensor)
    limit = float(chi2.isf(CHANCE, 6))
    # Screened before anything is fitted by squares: one reading far off would give a tool of negative mass.
    used = _screened(_regressor(readings, float(readings.time.mean()), drift, gravity), readings.wrenches, limit)
    for _ in range(_ROUNDS):
        _check_share(used, readings)
        estimate = fit_payload(readings, None, drift, gravity, used)
        X = _regressor(readings, estimate.zero_time, drift, gravity)
        fitting = _distances(X, readings.wrenches, estimate) <= limit
        if np.array_equal(fitting, used):
            break
        used = fitting
    return estimate


def _regressor(readings: PayloadReadings, zero_time: float, drift: bool, gravity: float) -> Array:
    """Derivative of the readings by theta, the drift counted from ``zero_time`` [s]."""
    return payload_regressor(readings.up_sensor, readings.time - zero_time if drift else None, gravity)


def _check_share(used: NDArray[np.bool_], readings: PayloadReadings) -> None:
    if np.sum(~used) > LARGEST_SHARE * len(readings):
        named = ", ".join(str(i + 1) for i in np.flatnonzero(~used))
        raise CalibrationError(
            f"more than {LARGEST_SHARE:.0%} of the {len(readings)} readings fit no tool the others agree on "
            f"(readings {named}). Did the arm move or the tool touch something? Take them again."
        )
    check_identifiable(readings.up_sensor[used])


def _screened(X: Array, y: Array, limit: float) -> NDArray[np.bool_]:
    """Readings near the fit of least absolute deviations, a reading's six axes taken together."""
    scale, weights = np.repeat([1.0, 0.05], 3), np.ones(len(y))
    for _ in range(_ROUNDS):
        root = np.sqrt(weights)[:, None] / scale
        theta = np.linalg.lstsq((X * root[:, :, None]).reshape(-1, X.shape[2]), (y * root).ravel(), rcond=None)[0]
        residuals = y - X @ theta
        # Such a fit goes through some readings exactly: they say nothing about the noise.
        spread = np.sqrt(y.size / (y.size - X.shape[2])) / _GAUSSIAN_MEDIAN
        found = [spread * float(np.median(np.abs(residuals[:, axes]))) for axes in (slice(0, 3), slice(3, 6))]
        scale = np.maximum(np.repeat(found, 3), _SMALLEST_SCALE)
        weights = 1.0 / np.maximum(np.linalg.norm(residuals / scale, axis=1), 1e-3)
    return np.asarray(np.sum((residuals / scale) ** 2, axis=1) <= limit)


def _distances(X: Array, y: Array, estimate: PayloadEstimate) -> Array:
    """Squared distance of each reading from the fit, in units of what is expected of it, shape (n,).

    A reading the fit rests on has drawn it nearer, one left out has not.
    """
    noise = np.maximum(estimate.noise, _SMALLEST_SCALE)
    A, e = X / noise[:, None], (y - X @ estimate.theta) / noise
    leverage = A @ estimate.covariance @ np.swapaxes(A, 1, 2)
    expected = np.eye(6) + np.where(estimate.used, -1.0, 1.0)[:, None, None] * leverage
    return np.asarray(np.einsum("na,na->n", e, np.linalg.solve(expected, e[:, :, None])[:, :, 0]))
