"""The curve near way points: straight where they are, round within the tolerances, its derivatives exact."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.spline.curve import Curve, curve_rates, fit_curve, polyline_of
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
    # chords: 1.3 um inside
    np.testing.assert_allclose(np.linalg.norm(rates.tips[0], axis=1), radius, atol=3e-6)
    np.testing.assert_allclose(np.linalg.norm(rates.tips[2], axis=1), 1.0 / radius, rtol=0.02)
    np.testing.assert_allclose(np.linalg.norm(rates.tips[3], axis=1), 1.0 / radius**2, rtol=0.1)


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
            np.testing.assert_allclose(
                jet[k + 1], slope, atol=1e-4 * max(1.0, float(np.abs(jet[k + 1]).max()))
            )
    # R' = [w] R
    turned = (after.rotations - before.rotations) / (2.0 * h)
    np.testing.assert_allclose(
        turned,
        np.cross(at.spins[0][:, :, None], at.rotations, axis=1),
        atol=1e-4 * float(np.abs(at.spins[0]).max()),
    )


@pytest.mark.parametrize(("turn", "tolerance"), [(20.0, 2e-5), (90.0, 1e-4), (130.0, 1e-5), (165.0, 2e-5)])
def test_a_corner_between_long_legs_uses_the_whole_tolerance_on_both_sides_of_the_path(
    turn: float, tolerance: float
) -> None:
    angle = np.radians(turn)
    tips = 0.03 * np.array([[-1.0, 0, 0], [0, 0, 0], [np.cos(angle), np.sin(angle), 0]])
    curve = fit(*stroke(tips), (tolerance, 1e-3))
    drawn = curve_rates(curve, np.linspace(0.0, curve.length, 40001)).tips[0]
    off = distance_from(drawn, tips)
    missed = np.linalg.norm(drawn, axis=1).min()
    assert max(off.max(), 0.5 * missed) == pytest.approx(tolerance, rel=0.05)
    assert off.max() <= tolerance
    assert missed <= 2.0 * tolerance
    half = (
        drawn[:, 0] < -5.0 * tolerance
    )  # beside the first leg: the racing line swings out before it turns in
    assert drawn[half, 1].min() < -0.5 * off.max() < 0.5 * off.max() < drawn[half, 1].max()
