"""The banded programme's solution is that of an independent solver."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import coo_matrix

from polish_sim.motion.spline.program import Rows, join_rows, maximize


def random_rows(n: int, rng: np.random.Generator) -> Rows:
    """Bounds that wander, and bounds of first and second differences."""
    most = np.clip(0.5 + np.cumsum(0.1 * rng.normal(size=n)), 0.05, 1.0)
    at, none, one = np.arange(n), np.zeros(n), np.ones(n)
    difference, bend = np.stack([-one, one, none], axis=1), np.stack([one, -2.0 * one, one], axis=1)
    return join_rows([
        Rows(at, np.stack([none, one / most, none], axis=1), one), Rows(at, np.stack([none, -one, none], axis=1), none),
        *(Rows(at, sign * difference, 0.1 * one) for sign in (1.0, -1.0)),
        *(Rows(at, sign * bend, 0.02 * one) for sign in (1.0, -1.0)),
        Rows(np.array([n]), np.array([[1.0, 0.0, 0.0]]), np.array([0.05])),
    ])  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_it_is_as_large_as_what_highs_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, gains = 200, rng.uniform(0.5, 1.0, 200)
    rows = random_rows(n, rng)
    number, column = np.repeat(np.arange(len(rows.ends)), 3), (rows.centers[:, None] + np.arange(-1, 2)).ravel()
    inside = (column >= 0) & (column < n)
    matrix = coo_matrix((rows.factors.ravel()[inside], (number[inside], column[inside])), (len(rows.ends), n))
    known = linprog(-gains, A_ub=matrix.tocsr(), b_ub=rows.ends, bounds=(None, None))
    found = maximize(gains, rows)
    assert gains @ found == pytest.approx(-known.fun, rel=1e-5)
    assert np.all(matrix @ found <= rows.ends + 1e-6)
