"""A programme given by its rows' neighbours is the one given by its whole matrix."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from polish_sim.motion.spline.program import Rows, join_rows, maximize


def random_rows(n: int, rng: np.random.Generator) -> tuple[Rows, Rows]:
    """Bounds of the unknowns, and bounds of their first and second differences."""
    most = np.clip(0.5 + np.cumsum(0.1 * rng.normal(size=n)), 0.05, 1.0)
    at, none, one = np.arange(n), np.zeros(n), np.ones(n)
    difference, bend = np.stack([-one, one, none], axis=1), np.stack([one, -2.0 * one, one], axis=1)
    bounds = [
        Rows(at, np.stack([none, factor, none], axis=1), end) for factor, end in ((one / most, one), (-one, none))
    ]
    return join_rows(bounds), join_rows([
        *(Rows(at, sign * difference, 0.1 * one) for sign in (1.0, -1.0)),
        *(Rows(at, sign * bend, 0.02 * one) for sign in (1.0, -1.0)),
        Rows(np.array([n]), np.array([[1.0, 0.0, 0.0]]), np.array([0.05])),
    ])  # fmt: skip


@pytest.mark.parametrize("seed", range(4))
def test_rows_are_those_of_the_whole_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, gains = 60, rng.uniform(0.5, 1.0, 60)
    bounds, others = random_rows(n, rng)
    rows = join_rows([bounds, others])
    matrix = np.zeros((len(rows.ends), n + 3))
    for row, (center, factors) in enumerate(zip(rows.centers, rows.factors, strict=True)):
        matrix[row, center : center + 3] += factors
    matrix = matrix[:, 1 : n + 1]
    known = linprog(-gains, A_ub=matrix, b_ub=rows.ends, bounds=(None, None), method="highs-ipm")
    found = maximize(gains, bounds, [others], 0.05 * np.ones(n))
    assert found is not None
    assert gains @ found == pytest.approx(-known.fun, rel=1e-6)
    assert np.all(matrix @ found <= rows.ends + 1e-7)


def test_rows_that_contradict_each_other_have_no_solution() -> None:
    at_most = Rows(np.array([0, 0]), np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, -2.0]))
    assert maximize(np.ones(1), at_most, [at_most], np.ones(1)) is None
