"""Linear programmes whose every row touches three neighbouring unknowns (layer 6).

``maximize c x  subject to  rows x <= ends`` by Mehrotra's predictor-corrector; the matrix to be solved each time has
five diagonals, so a programme takes some thirty steps of a time that grows with its size only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

Array = NDArray[np.float64]

MOST_STEPS = 80
PRECISION = 1e-7
"""Of the solution, where unknowns, ends and gains are of size 1."""
TO_BOUNDARY = 0.995
"""Share of the way to the nearest bound a step goes."""


class Rows(NamedTuple):
    """Row i: sum over k of ``factors[i, k] x[centers[i] - 1 + k] <= ends[i]``; unknowns beyond either end are 0."""

    centers: NDArray[np.int64]
    """From 0 to n, of n unknowns, shape (m,)."""
    factors: Array
    """Shape (m, 3)."""
    ends: Array
    """Shape (m,)."""


class Point(NamedTuple):
    """Unknowns, what is left of every row, and its price; or a step of these."""

    x: Array
    slack: Array
    price: Array


def join_rows(rows: list[Rows]) -> Rows:
    """Several sets of rows as one."""
    centers, factors, ends = zip(*rows, strict=True)
    return Rows(np.concatenate(centers), np.concatenate(factors), np.concatenate(ends))


def maximize(gains: Array, rows: Rows) -> Array:
    """Solve a programme.

    Args:
        gains: c, of size 1, shape (n,).
        rows: Bounds of every unknown (of size 1) among them.

    Returns:
        x, shape (n,); of rows that contradict each other, some of which are broken, whatever it came to.
    """
    size = np.where(rows.ends > 0.0, rows.ends, np.abs(rows.factors).max(axis=1))
    rows = Rows(rows.centers, rows.factors / size[:, None], rows.ends / size)
    x = np.full(len(gains), 0.5)
    at = Point(x, np.maximum(rows.ends - _times(rows, x), 0.1), np.ones(len(size)))
    for _ in range(MOST_STEPS):
        short = rows.ends - _times(rows, at.x) - at.slack
        dual = gains - _gathered(rows, at.price, len(x))
        gap = float(at.slack @ at.price) / len(size)
        if max(gap, float(np.abs(short).max()), float(np.abs(dual).max())) < PRECISION:
            break
        matrix = _normal_matrix(rows, at.price / at.slack, len(x))
        try:
            factor = cholesky_banded(matrix, lower=True)
        except LinAlgError:
            break  # prices grow without end: rows contradict each other
        guess = _step(rows, factor, at, short, dual, -at.slack * at.price)
        left = _moved(at, guess, 1.0)
        aim = gap * (float(left.slack @ left.price) / len(size) / gap) ** 3
        step = _step(rows, factor, at, short, dual, aim - at.slack * at.price - guess.slack * guess.price)
        at = _moved(at, step, TO_BOUNDARY)
    return at.x


def _step(rows: Rows, factor: Array, at: Point, short: Array, dual: Array, products: Array) -> Point:
    """Newton's step: mends what is ``short`` and ``dual`` and changes slack times price by ``products``."""
    right = _gathered(rows, (products - at.price * short) / at.slack, len(at.x))
    x = cho_solve_banded((factor, True), dual - right)
    slack = short - _times(rows, x)
    return Point(x, slack, (products - at.price * slack) / at.slack)


def _moved(at: Point, step: Point, share: float) -> Point:
    """A share of the longest step that keeps slacks and prices positive, at most the whole step."""
    primal, dual = (min(1.0, share * _reach(*pair)) for pair in ((at.slack, step.slack), (at.price, step.price)))
    return Point(at.x + primal * step.x, at.slack + primal * step.slack, at.price + dual * step.price)


def _reach(values: Array, steps: Array) -> float:
    return 1.0 / max(float((-steps / values).max()), 1e-300)


def _times(rows: Rows, x: Array) -> Array:
    padded = np.concatenate([[0.0], x, [0.0, 0.0]])
    c, f = rows.centers, rows.factors
    return np.asarray(f[:, 0] * padded[c] + f[:, 1] * padded[c + 1] + f[:, 2] * padded[c + 2])


def _gathered(rows: Rows, weights: Array, n: int) -> Array:
    """The transposed matrix times weights of the rows, shape (n,)."""
    total = np.zeros(n + 3)
    for k in range(3):
        total += np.bincount(rows.centers + k, rows.factors[:, k] * weights, n + 3)
    return total[1:-2]


def _normal_matrix(rows: Rows, weights: Array, n: int) -> Array:
    """Rows' outer products summed with weights: lower diagonals, shape (3, n)."""
    bands = np.zeros((3, n + 3))
    for k in range(3):
        for j in range(k, 3):
            values = weights * rows.factors[:, j] * rows.factors[:, k]
            bands[j - k] += np.bincount(rows.centers + k, values, n + 3)
    return np.ascontiguousarray(bands[:, 1:-2])
