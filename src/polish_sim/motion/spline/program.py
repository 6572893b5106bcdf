"""Linear programmes whose every row touches three neighbouring unknowns (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import coo_array

Array = NDArray[np.float64]


class Rows(NamedTuple):
    """Row i: sum over k of ``factors[i, k] x[centers[i] - 1 + k] <= ends[i]``; unknowns beyond either end are 0."""

    centers: NDArray[np.int64]
    """From 0 to n, of n unknowns, shape (m,)."""
    factors: Array
    """Shape (m, 3)."""
    ends: Array
    """Shape (m,)."""


def join_rows(rows: list[Rows]) -> Rows:
    """Several sets of rows as one."""
    centers, factors, ends = zip(*rows, strict=True)
    return Rows(np.concatenate(centers), np.concatenate(factors), np.concatenate(ends))


def maximize(gains: Array, rows: Rows) -> Array | None:
    """Solve a programme by HiGHS' dual simplex.

    Args:
        gains: What is to be as large as can be: gains x, shape (n,).
        rows: What holds; x is not negative.

    Returns:
        x, shape (n,); None where rows contradict each other or the solver gives up.
    """
    numbers, columns = np.repeat(np.arange(len(rows.ends)), 3), (rows.centers[:, None] + np.arange(-1, 2)).ravel()
    values = rows.factors.ravel()
    kept = (columns >= 0) & (columns < len(gains)) & (values != 0.0)
    matrix = coo_array((values[kept], (numbers[kept], columns[kept])), (len(rows.ends), len(gains))).tocsr()
    solved = linprog(-gains, A_ub=matrix, b_ub=rows.ends, bounds=(0.0, None), method="highs-ds")
    return np.asarray(solved.x) if solved.status == 0 else None
