"""One least-squares fit for every calibration: unknowns with covariance, outliers found, left out and
named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.optimize import least_squares
from scipy.special import fdtri

from polish_sim.arrays import Array, Bools, Uncertain, norms
from polish_sim.errors import CalibrationError

X = TypeVar("X")

CHANCE = 1e-6  #: A measurement this unlikely (Gaussian noise, its coordinates together) is an outlier
LARGEST_SHARE = 0.25  #: With more outliers than this the measurements as a whole are refused
LEAST_TO_JUDGE = 7  #: With fewer measurements nothing is left out: too few would be left to decide
SMALLEST_NOISE = 1e-12  # of exact data with several kinds of noise
_ROUNDS = 25
_STEP = 1e-5
_EVALUATIONS = 100  #: Levenberg-Marquardt needs 5 to 20; on exact data rounding hides its end
_NOISE_ROUNDS = 21
_GAUSSIAN_MEDIAN = 0.6745


@dataclass(frozen=True)
class Problem(Generic[X]):
    """Measurements that follow from unknowns ``x``; n measurements of k coordinates, p unknowns."""

    residuals: Callable[[X], Array]  #: Of every measurement, shape (n, k)
    slopes: Callable[[X], Array]  #: Their derivative by a step of the unknowns, shape (n, k, p)
    moved: Callable[[X, Array], X] = lambda x, step: x + step  # type: ignore[operator]
    """The unknowns after a step, shape (p,)."""
    kinds: tuple[slice, ...] = (slice(None),)  #: Columns of the residuals that share one noise, all together
    #: First guess of its standard deviations, one or by column; only the ratios between kinds count
    start: Array | float = 1.0
    floor: Array | float = 2e-6  #: Nothing nearer than this is an outlier, however exact the others are


@dataclass(frozen=True)
class Fit(Uncertain, Generic[X]):
    """The best fit and how well it is known."""

    x: X  #: The unknowns
    covariance: Array  #: Of a step of the unknowns, shape (p, p)
    residuals: Array  #: Of every measurement, used or not, shape (n, k)
    used: Bools  #: The measurements it rests on, shape (n,); the others are outliers
    #: Standard deviation of each coordinate of a measurement, given or found by residuals, shape (k,)
    noise: Array


def fit(problem: Problem[X], start: X, noise: float | None = None, used: Bools | None = None) -> Fit[X]:
    """Fit by least squares from a close start, the maximum likelihood for independent Gaussian noise.

    ``noise``: standard deviation of a coordinate, None takes that of each kind from the residuals; ``used``:
    measurements to use, (n,), None uses all.
    """
    x = start
    e = problem.residuals(x)
    scale = np.full(e.shape[1], problem.start if noise is None else noise)
    used = np.ones(len(e), dtype=bool) if used is None else used
    settled = False
    for _ in range(_NOISE_ROUNDS):
        x = solve(problem, x, used[:, None] / scale**2)
        e, J = problem.residuals(x), problem.slopes(x)
        rows = J[used] / scale[:, None]
        covariance = _covariance(rows.reshape(-1, rows.shape[2]))
        if settled or noise is not None:
            break
        # Each kind's share of the degrees of freedom the fit has used up.
        taken = np.einsum("nap,pq,naq->a", rows, covariance, rows)
        previous = scale
        scale = np.maximum(_noise(problem, e[used], taken), SMALLEST_NOISE)
        settled = np.allclose(scale, previous, rtol=1e-6)
    return Fit(x, covariance, e, used, scale)


def solve(problem: Problem[X], start: X, weights: Array | float = 1.0) -> X:
    """Unknowns with the least sum of weighted squares; weights of residuals (n, k), or one for each row (n,
    1).

    Levenberg-Marquardt, then Gauss-Newton: the cost is flat at its minimum and does not determine the last
    digits.
    """
    root = np.broadcast_to(np.sqrt(weights), problem.residuals(start).shape)

    def at(step: Array) -> X:
        return problem.moved(start, step)

    found = least_squares(
        lambda step: _left(problem, at(step), root), np.zeros(problem.slopes(start).shape[2]),
        lambda step: _rows(problem, at(step), root), method="lm", max_nfev=_EVALUATIONS,
    )  # fmt: skip
    x = at(found.x)
    for _ in range(_ROUNDS):
        step = _gauss_newton(problem, x, root)
        x = problem.moved(x, step)
        if np.abs(step).max() < 1e-13:
            break
    return x


def _left(problem: Problem[X], x: X, root: Array) -> Array:
    """Residuals weighted by ``root`` (n, k), in a row."""
    return (root * problem.residuals(x)).ravel()


def _rows(problem: Problem[X], x: X, root: Array) -> Array:
    """Their slopes, shape (n k, p)."""
    J = problem.slopes(x)
    return (root[:, :, None] * J).reshape(-1, J.shape[2])


def _gauss_newton(problem: Problem[X], x: X, root: Array) -> Array:
    """The step (p,) to the least squares of the linearised problem, rows weighted by ``root`` (n, k)."""
    return np.asarray(np.linalg.lstsq(_rows(problem, x, root), -_left(problem, x, root), rcond=1e-14)[0])


def _covariance(rows: Array) -> Array:
    """Covariance of the unknowns from derivatives of residuals of unit variance (m, p)."""
    scale = np.linalg.norm(rows, axis=0)
    inverse = np.linalg.inv(np.linalg.qr(rows / scale, mode="r")) / scale[:, None]
    return inverse @ inverse.T


def _noise(problem: Problem[Any], e: Array, taken: Array) -> Array:
    """Noise of each column (k,) from residuals (n, k) and the degrees of freedom taken from each column
    (k,)."""
    found = np.empty(e.shape[1])
    for kind in problem.kinds:
        part = e[:, kind]
        found[kind] = np.sqrt(np.sum(part**2) / max(part.size - taken[kind].sum(), 1.0))
    return found


def agreeing(problem: Problem[X], start: X, measurements: str) -> Bools:
    """The measurements that agree with each other, (n,); all of them where there are too few to judge.

    A fit by least absolute deviations, which a few wrong measurements hardly move, names the suspects; then
    measurements are left out or taken back by their distance from the least-squares fit of the others
    (Fisher's test). Raises CalibrationError, with their name such as ``"touches"``, if more than a quarter
    disagree.
    """
    count = len(problem.residuals(start))
    if count < LEAST_TO_JUDGE:
        return np.ones(count, dtype=bool)
    x, used = _screened(problem, start)
    for _ in range(_ROUNDS):
        if np.sum(~used) > LARGEST_SHARE * count:
            named = ", ".join(str(k + 1) for k in np.flatnonzero(~used)[:12])
            raise CalibrationError(
                f"more than {LARGEST_SHARE:.0%} of the {count} {measurements} do not fit the others "
                f"({named}). Did something move or touch in between, are units mixed or columns swapped?"
            )
        x, found = _near(problem, x, used)
        if np.array_equal(found, used):
            break
        used = found
    return used


def _screened(problem: Problem[X], x: X) -> tuple[X, Bools]:
    """The fit of least absolute deviations, by reweighting, and the measurements near it."""
    count, k, unknowns = problem.slopes(x).shape
    scale = np.full(k, problem.start)
    weights = np.ones(count)
    freedom = max(count * k - unknowns, 1)
    for _ in range(_ROUNDS):
        x = problem.moved(x, _gauss_newton(problem, x, np.sqrt(weights)[:, None] / scale))
        e = problem.residuals(x)
        # Such a fit goes through some measurements exactly: they say nothing about the noise.
        spread = np.sqrt(e.size / freedom) / _GAUSSIAN_MEDIAN
        for kind in problem.kinds:
            scale[kind] = spread * np.median(np.abs(e[:, kind]))
        scale = np.maximum(scale, problem.floor)
        weights = 1.0 / np.maximum(norms(e / scale), 1e-2)
    return x, np.sum((e / scale) ** 2, axis=1) <= k * _fisher(k, freedom)


def _near(problem: Problem[X], x: X, used: Bools) -> tuple[X, Bools]:
    """The fit of the measurements used, and all measurements within what noise explains of the fit of the
    others."""
    e = problem.residuals(x)
    k, unknowns = problem.slopes(x).shape[1:]
    scale = np.maximum(_noise(problem, e[used], np.full(k, unknowns / k)), problem.floor)
    x = solve(problem, x, used[:, None] / scale**2)
    e, J = problem.residuals(x) / scale, problem.slopes(x) / scale[:, None]
    leverage = J @ _covariance(J[used].reshape(-1, unknowns)) @ np.swapaxes(J, 1, 2)
    expected = np.eye(k) + np.where(used, -1.0, 1.0)[:, None, None] * leverage
    distance = np.einsum("na,na->n", e, np.linalg.solve(expected + 1e-12 * np.eye(k), e[:, :, None])[:, :, 0])
    # The noise each is judged by comes from the other measurements alone.
    freedom = k * used.sum() - unknowns
    own = used.astype(float)
    others = np.maximum(np.sum(e[used] ** 2) - own * distance, 0.0) / np.maximum(freedom - own * k, 1.0)
    noise = np.maximum(others, np.max(problem.floor / scale) ** 2)
    return x, distance / noise / k <= _fisher(k, np.maximum(freedom - own * k, 1.0))


def slopes_of(function: Callable[[Array], Array], count: int) -> Array:
    """Derivative (..., count) of a function of ``count`` numbers at zero, by central differences."""
    ends = [function(step) - function(-step) for step in _STEP * np.eye(count)]
    return np.stack(ends, axis=-1) / (2.0 * _STEP)


def _fisher(k: int, freedom: Array | float) -> Any:
    """The ratio of variances, with k and ``freedom`` degrees of freedom, that noise exceeds once in a
    million."""
    return fdtri(k, freedom, 1.0 - CHANCE)
