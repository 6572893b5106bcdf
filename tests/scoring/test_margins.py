"""Margins against closed forms, and gains designed for margins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polish_sim.scoring.margins import design_gains, margins, pi_on_spring


@pytest.mark.parametrize(("crossover", "delay"), [(5.0, 0.02), (20.0, 0.01), (60.0, 0.004)])
def test_integrator_with_delay_has_the_margins_of_the_textbook(crossover: float, delay: float) -> None:
    found = margins(pi_on_spring(crossover / 5000.0, 0.0, 5000.0, delay))
    assert found.crossover == pytest.approx(crossover, rel=1e-4)
    assert found.gain == pytest.approx(0.5 * math.pi / (crossover * delay), rel=1e-4)
    assert found.phase == pytest.approx(0.5 * math.pi - crossover * delay, abs=1e-4)
    assert found.delay == pytest.approx(found.phase / crossover, rel=1e-4)
    assert found.phase_crossover == pytest.approx(0.5 * math.pi / delay, rel=1e-3)


def test_a_loop_without_delay_has_no_gain_margin_to_lose() -> None:
    assert margins(pi_on_spring(0.004, 0.0, 5000.0, 0.0)).gain == math.inf


@pytest.mark.parametrize("stiffness", [1000.0, 5000.0, 25000.0])
@pytest.mark.parametrize("delay", [0.003, 0.012, 0.04])
@pytest.mark.parametrize("felt_mass", [0.0, 0.7, 2.75])
def test_designed_gains_keep_the_margins_asked_for(stiffness: float, delay: float, felt_mass: float) -> None:
    gains = design_gains(stiffness, delay, (80.0, 30.0), math.radians(55.0), gain_margin=2.5, felt_mass=felt_mass)
    assert gains.margins.gain > 2.5 * 0.999
    assert gains.margins.phase > math.radians(54.9)
    assert gains.margins.delay > 0.0


def test_designed_gains_are_the_fastest_that_keep_them() -> None:
    wanted = math.radians(60.0)
    gains = design_gains(5000.0, 0.012, (80.0,), wanted)
    faster = margins(pi_on_spring(1.1 * gains.p, 1.1 * gains.i, 5000.0, 0.012, (80.0,)))
    assert faster.phase < wanted


def test_designed_gains_scale_with_the_spring() -> None:
    soft, stiff = design_gains(1000.0, 0.01), design_gains(25000.0, 0.01)
    assert soft.p / stiff.p == pytest.approx(25.0)
    assert soft.margins.crossover == pytest.approx(stiff.margins.crossover)


def test_more_delay_makes_the_loop_slower_in_proportion() -> None:
    quick, late = design_gains(5000.0, 0.01, ()), design_gains(5000.0, 0.03, ())
    assert quick.margins.crossover / late.margins.crossover == pytest.approx(3.0, rel=1e-3)
    assert np.isfinite(late.i)
