"""Measurements that disagree with all others: found, left out and named; for any least-squares fit."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, fdtri

from polish_sim.calibration.payload import (
    BIAS,
    GRAVITY,
    MASS,
    PayloadEstimate,
    PayloadReadings,
    check_identifiable,
    fit_payload,
    payload_regressor,
)
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

CHANCE = 1e-6
"""A measurement this unlikely (Gaussian noise, its coordinates together) is an outlier."""
LARGEST_SHARE = 0.25
"""More outliers than this and the measurements as a whole are not believed."""
LEAST_TO_JUDGE = 7
"""With fewer measurements nothing is left out: too few would be left to say who is right."""
SMALLEST_SCALE = 2e-6
"""Nothing nearer than this is an outlier, however exact the others are [m]."""
_ROUNDS = 25
_GAUSSIAN_MEDIAN = 0.6745


class Fitted(NamedTuple):
    """A weighted least-squares fit, as far as outliers go."""

    residuals: Array
    """Of every measurement, used or not [m], shape (n, k)."""
    leverage: Array
    """J_i (J^T W J)^-1 J_i^T: how far the fit follows each measurement, shape (n, k, k)."""
    unknowns: int


Fit = Callable[[Array], Fitted]
"""Fits with a weight for every measurement, shape (n,)."""


def agreeing(fit: Fit, count: int, kind: str) -> Mask:
    """Which measurements agree with each other.

    A fit by least absolute deviations, which a few wrong measurements do not move, says who is suspect; then they are
    left out or taken back by their distance from the least-squares fit of the others (Fisher's test).

    Args:
        fit: Fits with given weights.
        count: Number of measurements.
        kind: What they are, for the message, e.g. ``"touches"``.

    Returns:
        Mask, shape (n,); all of them where there are too few to judge.

    Raises:
        CalibrationError: More than a quarter disagree.
    """
    used = np.ones(count, dtype=bool)
    if count < LEAST_TO_JUDGE:
        return used
    used = _screened(fit, count)
    for _ in range(_ROUNDS):
        if np.sum(~used) > LARGEST_SHARE * count:
            named = ", ".join(str(k + 1) for k in np.flatnonzero(~used)[:12])
            raise CalibrationError(
                f"more than {LARGEST_SHARE:.0%} of the {count} {kind} do not fit the others ({named}). "
                "Did something move in between, or are units mixed? Measure again."
            )
        found = _near(fit(used.astype(float)), used)
        if np.array_equal(found, used):
            break
        used = found
    return used


def _screened(fit: Fit, count: int) -> Mask:
    """Measurements near the fit of least absolute deviations."""
    weights = np.ones(count)
    for _ in range(_ROUNDS):
        fitted = fit(weights)
        e = fitted.residuals
        # Such a fit goes through some measurements exactly: they say nothing about the noise.
        spread = np.sqrt(e.size / max(e.size - fitted.unknowns, 1)) / _GAUSSIAN_MEDIAN
        scale = max(spread * float(np.median(np.abs(e))), SMALLEST_SCALE)
        weights = 1.0 / np.maximum(np.linalg.norm(e, axis=1) / scale, 1e-2)
    k = e.shape[1]
    limit = k * float(fdtri(k, max(e.size - fitted.unknowns, 1), 1.0 - CHANCE))
    return np.asarray(np.sum((e / scale) ** 2, axis=1) <= limit)


def _near(fitted: Fitted, used: Mask) -> Mask:
    """Measurements within what noise explains of the fit of the others."""
    e, k = fitted.residuals, fitted.residuals.shape[1]
    expected = np.eye(k) + np.where(used, -1.0, 1.0)[:, None, None] * fitted.leverage
    distance = np.einsum("na,na->n", e, np.linalg.solve(expected + 1e-12 * np.eye(k), e[:, :, None])[:, :, 0])
    # The noise each is judged by comes from the other measurements alone.
    total, freedom = float(np.sum(e[used] ** 2)), k * int(used.sum()) - fitted.unknowns
    own = np.where(used, 1.0, 0.0)
    others = np.maximum(total - own * distance, 0.0) / np.maximum(freedom - own * k, 1.0)
    noise = np.maximum(others, SMALLEST_SCALE**2)
    return np.asarray(distance / noise / k <= fdtri(k, np.maximum(freedom - own * k, 1.0), 1.0 - CHANCE))


# Readings that fit no tool the others agree on: found and left out.

OUTLIERS_CHANCE = 1e-7
"""A reading this unlikely (Gaussian noise, its six axes together) is an outlier."""
_LEAST_LEFT = 6
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
    limit = float(chdtri(6, OUTLIERS_CHANCE))
    # Screened before anything is fitted by squares: one reading far off would give a tool of negative mass.
    used = _screened_readings(
        _regressor(readings, float(readings.time.mean()), drift, gravity), readings.wrenches, limit
    )
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


def _screened_readings(X: Array, y: Array, limit: float) -> NDArray[np.bool_]:
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


# Readings that a tool's weight does not explain: refused, and where it can be told, why.

LARGEST_REST = 0.3
"""Of the weight, what the forces may leave unexplained, rms."""
FARTHEST = 1.0
"""How far from the sensor's origin a tool's centre of mass may be [m]."""
_BETTER, _GOOD = 0.2, 0.05


def refuse_swapped_columns(readings: PayloadReadings) -> None:
    """Refuse forces or torques that follow a weight far better in another order or with other signs.

    Raises:
        CalibrationError: Naming what fits, or poses that tell nothing. Forces of the opposite sign all three are left
            to the fit, which says so.
    """
    check_identifiable(readings.up_sensor)
    X = payload_regressor(readings.up_sensor)
    forces, torques = [MASS, *range(BIAS.start, BIAS.start + 3)], [1, 2, 3, *range(BIAS.start + 3, BIAS.stop)]
    _refuse_swapped(X[:, :3, forces], readings.wrenches[:, :3], "f", lambda theta: theta[0] > 0.0)
    _refuse_swapped(X[:, 3:, torques], readings.wrenches[:, 3:], "t", lambda _: True)


def refuse_doubtful(readings: PayloadReadings, estimate: PayloadEstimate) -> None:
    """Refuse an estimate whose readings do not follow the tool's weight.

    Raises:
        CalibrationError: Forces that follow no weight, or a centre of mass where no tool has it.
    """
    weight = GRAVITY * estimate.mass
    rest = float(np.sqrt(np.mean(estimate.residuals[estimate.used, :3] ** 2)))
    if rest > LARGEST_REST * weight:
        raise CalibrationError(
            f"the forces do not follow a tool's weight: {rest:.3g} N rms are left of the {weight:.3g} N that fit best. "
            "Are units mixed, lines of several tools in one file, or the orientations not those of the readings?"
        )
    far = float(np.linalg.norm(estimate.center))
    if far > FARTHEST:
        raise CalibrationError(
            f"the tool's centre of mass comes out {far:.3g} m from the sensor: are the torques in N m, as the header "
            "says, and about the sensor's origin?"
        )


def _refuse_swapped(X: Array, y: Array, letter: str, possible: Callable[[Array], bool]) -> None:
    """Refuse three columns that fit five times better in another order or with other signs."""
    left = _left(X, y)[0]
    if left < _GOOD * float(np.std(y - y.mean(axis=0))):
        return
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order == (0, 1, 2) and max(signs) < 0.0:
            continue
        rest, theta = _left(X, y[:, order] * signs)
        if rest < _BETTER * left and possible(theta):
            named = ", ".join(
                ("-" if s < 0.0 else "") + letter + "xyz"[axis] for axis, s in zip(order, signs, strict=True)
            )
            raise CalibrationError(
                f"{letter}x, {letter}y, {letter}z follow the tool's weight far better if they are read as {named}: "
                "columns are swapped, a sign is lost, or the sensor stands otherwise than its orientations say."
            )


def _left(X: Array, y: Array) -> tuple[float, Array]:
    """What a fit leaves, rms, and the fit."""
    theta: Array = np.linalg.lstsq(X.reshape(-1, X.shape[2]), y.ravel(), rcond=None)[0].astype(np.float64)
    return float(np.sqrt(np.mean((y - X @ theta) ** 2))), theta
