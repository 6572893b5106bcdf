"""Measurements that disagree with all others: found, left out and named; for any least-squares fit (layer 8b)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

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
    limit = k * float(fisher.isf(CHANCE, k, max(e.size - fitted.unknowns, 1)))
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
    return np.asarray(distance / noise / k <= fisher.isf(CHANCE, k, np.maximum(freedom - own * k, 1.0)))
