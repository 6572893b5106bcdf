"""The curve near way points: straight where they are, round within the tolerances, its derivatives exact."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.errors import SmoothingError
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.spline.curve import (
    Curve,
    cross,
    curve_rates,
    dot,
    fit_curve,
    inverse_root,
    normalized,
    polyline_of,
)
from tests.motion.spline.strokes import TOLERANCES, circle, distance_from, random_stroke, stroke


def fit(chain: Chain, places: np.ndarray, tolerances: tuple[float, float] = TOLERANCES) -> Curve:
    return fit_curve(polyline_of(chain, places), *tolerances)


def test_a_straight_stroke_is_kept_exactly_at_its_own_pace() -> None:
    curve = fit(*stroke(np.outer(np.linspace(0.0, 0.1, 40) ** 1.5, [0.6, 0.0, 0.8])))
    rates = curve_rates(curve, np.linspace(0.0, curve.length, 200))
    np.testing.assert_allclose(rates.tips[1], np.tile([0.6, 0.0, 0.8], (200, 1)), atol=1e-9)
    np.testing.assert_allclose(rates.tips[2:], 0.0, atol=1e-5)
    assert rates.places[0, -1] == pytest.approx(curve.length, abs=1e-12)


def test_chords_of_a_circle_become_round_again() -> None:
    radius = 0.025
    curve = fit(*stroke(circle(radius, 2.0)))
    rates = curve_rates(curve, np.linspace(0.2, 0.8, 500) * curve.length)
    np.testing.assert_allclose(np.linalg.norm(rates.tips[0], axis=1), radius, atol=3e-6)  # chords: 1.3 um inside
    np.testing.assert_allclose(np.linalg.norm(rates.tips[2], axis=1), 1.0 / radius, rtol=0.02)
    np.testing.assert_allclose(np.linalg.norm(rates.tips[3], axis=1), 1.0 / radius**2, rtol=0.1)


@pytest.mark.parametrize("seed", range(6))
def test_tip_and_axis_stay_within_the_tolerances(seed: int) -> None:
    chain, places = random_stroke(np.random.default_rng(seed))
    line = polyline_of(chain, places)
    curve = fit_curve(line, *TOLERANCES)
    u = np.linspace(0.0, curve.length, 5003)
    rates = curve_rates(curve, u)
    assert distance_from(rates.tips[0], chain.tips).max() <= TOLERANCES[0] * 1.01
    wanted = line.at(u)[:, 6:9]
    cosines = np.sum(rates.axes[0] * wanted, axis=1) / np.linalg.norm(wanted, axis=1)
    assert np.arccos(np.clip(cosines, -1.0, 1.0)).max() <= TOLERANCES[1] * 1.01
    for end in (0, -1):
        np.testing.assert_allclose(rates.tips[0, end], chain.tips[end], atol=1e-12)
        np.testing.assert_allclose(rates.rotations[end], chain.rotations[end], atol=1e-9)


def test_derivatives_are_those_of_finite_differences() -> None:
    chain, places = random_stroke(np.random.default_rng(3))
    curve = fit(chain, places)
    knots = curve.knots
    u, h = 0.5 * (knots[1:] + knots[:-1]), 1e-3 * float(np.diff(knots).min())
    before, at, after = (curve_rates(curve, u + shift) for shift in (-h, 0.0, h))
    for name in ("tips", "axes", "spins"):
        jet, low, high = (getattr(rates, name) for rates in (at, before, after))
        for k in range(len(jet) - 1):
            slope = (high[k] - low[k]) / (2.0 * h)
            np.testing.assert_allclose(jet[k + 1], slope, atol=1e-4 * max(1.0, float(np.abs(jet[k + 1]).max())))
    # R' = [w] R
    turned = (after.rotations - before.rotations) / (2.0 * h)
    np.testing.assert_allclose(
        turned, np.cross(at.spins[0][:, :, None], at.rotations, axis=1), atol=1e-4 * float(np.abs(at.spins[0]).max())
    )


def test_a_turn_on_the_spot_is_a_curve_too() -> None:
    tips = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0, 0], [0.05, 0, 0]])
    turns = np.array([[0.0, 0, 0], [0, 0, 0], [0.5, 0, 0], [0.5, 0, 0]])
    curve = fit(*stroke(tips, turns))
    rates = curve_rates(curve, np.linspace(0.0, curve.length, 1000))
    assert np.all(np.isfinite(rates.spins))
    assert distance_from(rates.tips[0], tips).max() <= TOLERANCES[0]


def test_a_tolerance_nothing_can_meet_names_the_place() -> None:
    with pytest.raises(SmoothingError, match=r"smoothing\.tolerance_m"):
        fit(*stroke(np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0, 1.0, 0]])), (1e-13, 1e-3))


# Derivatives carried along are those of the closed form.

T = np.linspace(0.0, 3.0, 7)
ZERO = np.zeros_like(T)
GROWING = np.exp(2.0 * T)


def unit_circle() -> np.ndarray:
    """(cos t, sin t, 0) and three derivatives."""
    return np.stack([np.stack([np.cos(T + k * np.pi / 2), np.sin(T + k * np.pi / 2), ZERO], axis=1) for k in range(4)])


def test_the_inverse_root_of_an_exponential_is_an_exponential() -> None:
    found = inverse_root(np.stack([2.0**k * GROWING for k in range(4)]))
    np.testing.assert_allclose(found, [(-1.0) ** k * np.exp(-T) for k in range(4)], rtol=1e-12)


def test_a_growing_spiral_normalized_is_the_circle() -> None:
    # Derivatives of e^t (cos t, sin t): turned by 45 deg and longer by sqrt 2 each time.
    spiral = np.stack([
        2.0 ** (k / 2) * np.exp(T)[:, None]
        * np.stack([np.cos(T + k * np.pi / 4), np.sin(T + k * np.pi / 4), ZERO], axis=1)
        for k in range(4)
    ])  # fmt: skip
    np.testing.assert_allclose(normalized(spiral), unit_circle(), atol=1e-12)


def test_products_of_a_circle_with_itself_are_constant() -> None:
    c = unit_circle()
    np.testing.assert_allclose(dot(c, c), [ZERO + 1.0, ZERO, ZERO, ZERO], atol=1e-12)
    turning = cross(c[:3], c[1:])
    np.testing.assert_allclose(turning[0], np.tile([0.0, 0.0, 1.0], (len(T), 1)), atol=1e-12)
    np.testing.assert_allclose(turning[1:], 0.0, atol=1e-12)
