"""Linear programmes whose rows touch three neighbouring unknowns, by an interior point method of linear cost.

    maximize  gains x   subject to   A x <= ends

Newton's step of the predictor-corrector method (Mehrotra, SIAM J. Optim. 2, 1992) solves ``A' D A dx = r`` with a
diagonal D. Here that matrix is pentadiagonal, so that the cost of a step is proportional to the number of rows.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.ndimage import maximum_filter1d
from scipy.sparse import csc_array, csr_array

from polish_sim.arrays import Array, Bools, Indices

MOST_STEPS: Final = 60
TOLERANCE: Final = 1e-9  #: Of the relative gap between primal and dual value, and of the violation of a row
LIKELY: Final = 0.5  #: Rows beyond this share of their end at ``guess`` are asked for from the first round on ...
TIGHT: Final = 0.9  #: ... and beyond this share those beside them too
BESIDE: Final = 16  #: Rows of the set before and after a row that count as beside it: they break once it is kept
BROKEN: Final = 1e-6  #: What a row left out may be beyond its end, which is about 1
MOST_ROUNDS: Final = 12


class Rows(NamedTuple):
    """Row i: sum over k of ``factors[i, k] x[centers[i] - 1 + k] <= ends[i]``; unknowns beyond either end are 0."""

    centers: Indices  #: From 0 to n, of n unknowns, shape (m,)
    factors: Array  #: Shape (m, 3)
    ends: Array  #: Shape (m,)


def join_rows(rows: list[Rows]) -> Rows:
    """Several sets of rows as one."""
    centers, factors, ends = zip(*rows, strict=True)
    return Rows(np.concatenate(centers), np.concatenate(factors), np.concatenate(ends))


def maximize(gains: Array, bounds: Rows, rows: list[Rows], guess: Array) -> Array | None:
    """Solve a programme; rows that do not bind are left out as long as the solution keeps them.

    Args:
        gains: Objective, maximised, shape (n,).
        bounds: Rows that keep every unknown finite; always asked for.
        rows: All other rows, in sets: those of one quantity, in the order of the unknowns.
        guess: Near a solution, shape (n,).

    Returns:
        x, shape (n,); None where the rows contradict each other or the method does not converge.
    """
    values = [_values(each, guess) for each in rows]
    asked = [
        (found > LIKELY * each.ends) | _and_beside(found > TIGHT * each.ends)
        for found, each in zip(values, rows, strict=True)
    ]
    for _ in range(MOST_ROUNDS):
        chosen = [_chosen(each, which) for each, which in zip(rows, asked, strict=True)]
        x = _interior_point(gains, _scaled(join_rows([bounds, *chosen])), 0.9 * guess)
        if x is None:
            return None
        broken = [~which & (_values(each, x) > each.ends + BROKEN) for each, which in zip(rows, asked, strict=True)]
        if not any(each.any() for each in broken):
            return x
        asked = [which | _and_beside(more) for which, more in zip(asked, broken, strict=True)]
    return None


def _and_beside(which: Bools) -> Bools:
    return np.asarray(maximum_filter1d(which, 2 * BESIDE + 1, mode="constant")) if which.any() else which


class _Matrix:
    """The rows' matrix A: products with it, and the bands of ``A' D A``."""

    def __init__(self, rows: Rows, size: int) -> None:
        m, columns = len(rows.ends), rows.centers[:, None] + np.arange(3)
        inside = (columns > 0) & (columns <= size)
        factors = np.where(inside, rows.factors, 0.0)
        self.matrix = csr_array((factors.ravel(), columns.ravel(), 3 * np.arange(m + 1)), (m, size + 3))
        self.columns = self.matrix.T
        # Products of two factors of a row, by where they go: the diagonal, the one below it, and the next.
        products = [factors[:, k] * factors[:, k + below] for below in range(3) for k in range(3 - below)]
        places = [columns[:, k] + below * (size + 3) for below in range(3) for k in range(3 - below)]
        shape = (3 * (size + 3), m)
        self.squares = csc_array(
            (np.stack(products, 1).ravel(), np.stack(places, 1).ravel(), 6 * np.arange(m + 1)), shape
        )

    def times(self, x: Array) -> Array:
        return np.asarray(self.matrix @ np.pad(x, (1, 2)))

    def transposed(self, y: Array) -> Array:
        return np.asarray((self.columns @ y)[1:-2])

    def normal(self, weights: Array) -> Array:
        """Lower bands of ``A' D A`` for D's diagonal, as LAPACK wants them, shape (3, size)."""
        return np.asarray((self.squares @ weights).reshape(3, -1)[:, 1:-2])


@np.errstate(over="ignore", invalid="ignore")  # rows that contradict each other end in no number, which is looked for
def _interior_point(gains: Array, rows: Rows, x: Array) -> Array | None:
    """Mehrotra's predictor and corrector; slacks s and multipliers z stay positive."""
    matrix = _Matrix(rows, len(gains))
    s, z = np.maximum(rows.ends - matrix.times(x), 0.1), np.full(len(rows.ends), gains.mean())
    for step in range(MOST_STEPS):
        primal, dual, mean = rows.ends - matrix.times(x) - s, gains - matrix.transposed(z), _dot(s, z) / len(s)
        if len(s) * mean < TOLERANCE * (1.0 + abs(_dot(gains, x))) and np.abs(primal).max() < TOLERANCE:
            return x
        bands = matrix.normal(z / s)
        bands[0] *= 1.0 + 1e-12
        try:
            factored = cholesky_banded(bands, lower=True)
        except (LinAlgError, ValueError):
            return None

        def direction(
            wanted: Array,
            factored: Array = factored,
            s: Array = s,
            z: Array = z,
            primal: Array = primal,
            dual: Array = dual,
        ) -> tuple[Array, Array, Array]:
            right = dual - matrix.transposed((wanted - z * primal) / s)
            dx = cho_solve_banded((factored, True), right, check_finite=False)
            ds = primal - matrix.times(dx)
            return dx, ds, (wanted - z * ds) / s

        _, ds, dz = direction(-s * z)
        left = _dot(s + _longest(s, ds) * ds, z + _longest(z, dz) * dz) / (len(s) * mean)
        dx, ds, dz = direction(left**3 * mean - s * z - ds * dz)
        part = 0.95 if step < 6 else 0.995
        by_s, by_z = min(1.0, part * _longest(s, ds)), min(1.0, part * _longest(z, dz))
        x, s, z = x + by_s * dx, s + by_s * ds, z + by_z * dz
    return None


def _scaled(rows: Rows) -> Rows:
    """The same rows with a largest factor of 1."""
    size = np.maximum(np.abs(rows.factors).max(axis=1), 1e-12)
    return Rows(rows.centers, rows.factors / size[:, None], rows.ends / size)


def _chosen(rows: Rows, chosen: Bools) -> Rows:
    return Rows(rows.centers[chosen], rows.factors[chosen], rows.ends[chosen])


def _values(rows: Rows, x: Array) -> Array:
    padded = np.pad(x, (1, 2))
    return np.asarray(sum(rows.factors[:, k] * padded[rows.centers + k] for k in range(3)))


def _longest(values: Array, changes: Array) -> float:
    """Largest share, up to 1, of changes that keeps positive values positive."""
    return 1.0 / max(1.0, -float((changes / values).min()))


def _dot(a: Array, b: Array) -> float:
    """Scalar product without the threads of a BLAS: they cost more than they save here."""
    return float(np.einsum("i,i", a, b))
