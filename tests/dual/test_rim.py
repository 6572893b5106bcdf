"""A closed spline through the points of a rim: how round, how smooth, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.dual.rim import fit_closed_spline
from polish_sim.errors import SmoothingError

RADIUS = 0.2


def rim(radius: float, count: int = 12) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def test_twelve_points_of_a_rim_give_a_circle_to_a_third_of_a_micrometre() -> None:
    spline = fit_closed_spline(rim(RADIUS))
    u = np.linspace(0.0, spline.length, 4001)
    assert np.abs(np.linalg.norm(spline(u), axis=1) - RADIUS).max() <= 3.2e-7
    chord_middle = 0.5 * (rim(RADIUS)[0] + rim(RADIUS)[1])
    assert RADIUS - np.linalg.norm(chord_middle) == pytest.approx(6.8e-3, abs=1e-4)


@pytest.mark.parametrize("derivative", range(5))
def test_the_rim_is_smooth_to_its_fourth_derivative_also_where_it_closes(derivative: int) -> None:
    spline = fit_closed_spline(rim(RADIUS) + np.random.default_rng(1).normal(0.0, 0.01, (12, 3)))
    knots = np.unique(spline.curve.t[5:-5])
    before, behind = spline(knots - 1e-9, derivative), spline(knots + 1e-9, derivative)
    scale = np.abs(spline(np.linspace(0.0, spline.length, 500), derivative)).max()
    np.testing.assert_allclose(before, behind, atol=1e-5 * scale)


def test_points_of_no_rim_are_refused() -> None:
    with pytest.raises(SmoothingError, match="needs 6 points"):
        fit_closed_spline(rim(RADIUS, 5))
    points = rim(RADIUS)
    points[4] = points[3]
    with pytest.raises(SmoothingError, match="points 4 and 5 are in one place"):
        fit_closed_spline(points)
