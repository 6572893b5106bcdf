"""The length of a Gaussian error: closed forms, and draws."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi, chi2

from polish_sim.dual.calibration.error_length import length_probability, length_quantile, quadratic_tail


def test_the_same_in_all_directions_is_a_chi_with_three_degrees_of_freedom() -> None:
    lengths = np.linspace(0.0, 2e-4, 9)
    found = length_probability(4e-10 * np.eye(3)[None], lengths)
    np.testing.assert_allclose(found, chi(3, scale=2e-5).cdf(lengths), atol=1e-12)
    assert length_quantile(4e-10 * np.eye(3)[None], 0.95) == pytest.approx(chi(3, scale=2e-5).ppf(0.95), rel=1e-5)


@pytest.mark.parametrize(("variances", "freedoms"), [((1.0, 1.0, 0.0), 2), ((0.0, 1.0, 0.0), 1)])
def test_flat_and_thin_errors_are_chi_with_two_degrees_of_freedom_and_one(
    variances: tuple[float, ...], freedoms: int
) -> None:
    found = length_quantile(1e-10 * np.diag(variances)[None], 0.95)
    assert found == pytest.approx(chi(freedoms, scale=1e-5).ppf(0.95), rel=1e-5)


def test_errors_of_several_places_are_what_is_drawn_of_them() -> None:
    """A turned, uneven covariance and a small one; a million draws tell a share of 0.95 to 0.0002."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((2, 3, 3)) * np.array([1e-5, 2e-6])[:, None, None]
    drawn = np.concatenate([rng.standard_normal((500_000, 3)) @ one.T for one in root])
    covariances = root @ np.swapaxes(root, 1, 2)
    quantile = length_quantile(covariances, 0.95)
    assert np.mean(np.linalg.norm(drawn, axis=1) <= quantile) == pytest.approx(0.95, abs=8e-4)


def test_no_error_has_no_length() -> None:
    assert length_quantile(np.zeros((2, 3, 3)), 0.95) == 0.0


def test_a_sum_of_equal_squares_is_a_chi_square_and_of_unequal_ones_what_draws_say() -> None:
    weight = np.diag([2.0, 2.0, 2.0, 2.0])
    for limit in (1.0, 8.0, 30.0):
        assert quadratic_tail(0.5 * np.eye(4), weight, limit) == pytest.approx(chi2.sf(limit, 4), abs=1e-8)
    rng = np.random.default_rng(0)
    L = rng.uniform(-1.0, 1.0, (5, 5))
    squares = np.sum((L @ rng.standard_normal((5, 40_000))) ** 2, axis=0)
    limit = float(np.percentile(squares, 80.0))
    assert quadratic_tail(L @ L.T, np.eye(5), limit) == pytest.approx(0.2, abs=4.0 * np.sqrt(0.16 / 40_000))
    assert quadratic_tail(np.zeros((5, 5)), np.eye(5), 1.0) == 0.0
