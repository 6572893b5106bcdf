"""A law made linear by asking it is the law by formula, and says so for loops nobody wrote a formula for."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.control import CONTROLLERS, Measurement, Target, build_controller
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.loop_model import hybrid_pi_linear, setup_of
from polish_sim.scoring.margins import (
    SLOWEST,
    closed_loop_matrix,
    growth,
    longest_latency,
    share_latency,
    with_latency,
    with_springs,
)
from polish_sim.scoring.measured_law import measure_law

FORCE = default_scenario("force")
Z = np.exp(1j * np.geomspace(0.5, 3000.0, 9) * 1e-3)


class PressByPlace:
    """No force at all: takes the tool's place back to its target in 0.1 s."""

    def reset(self, cycle_s: float) -> None:
        pass

    def step(self, measurement: Measurement, target: Target) -> np.ndarray:
        return np.concatenate([10.0 * (target.position - measurement.position), np.zeros(3)])


def test_measured_hybrid_pi_is_its_formula() -> None:
    setup = setup_of(FORCE)
    law = measure_law(build_controller(FORCE.controller), setup, 20.0, 5000.0)
    formula = hybrid_pi_linear(FORCE.controller, setup.dt)
    assert law.by_force(Z) == pytest.approx(formula.by_force(Z), rel=1e-6)
    assert np.abs(law.by_motion(Z)).max() < 1e-9


def test_a_law_on_the_place_answers_to_motion_only() -> None:
    law = measure_law(PressByPlace(), setup_of(FORCE), 20.0, 5000.0)
    assert np.abs(law.by_force(Z)).max() < 1e-12
    assert law.by_motion(Z) == pytest.approx(-10.0 * 1e-3 / (1.0 - 1.0 / Z), rel=1e-6)  # the sum of velocity


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_longest_latency_is_where_the_eigenvalues_say(scale: float) -> None:
    setup, law = with_springs(setup_of(FORCE), scale), hybrid_pi_linear(FORCE.controller, 0.001)
    totals = [0.001 * n for n in range(1, 200)]
    longest = longest_latency(setup, law, totals)
    rates = [growth(closed_loop_matrix(with_latency(setup, share_latency(t)), law), 0.001) for t in totals]
    unstable = next(t for t, rate in zip(totals, rates, strict=True) if rate > SLOWEST)
    assert longest == pytest.approx(unstable - 0.001, abs=1e-9)


def test_latency_is_shared_as_in_the_default_cell() -> None:
    assert share_latency(0.008) == pytest.approx((FORCE.sensor.latency_s, FORCE.robot.command_latency_s))
    assert share_latency(0.001) == pytest.approx((0.001, 0.0))


@pytest.mark.parametrize("name", ["hybrid-pi", "admittance", "impedance-position"])
def test_every_force_controller_is_stable_as_delivered(name: str) -> None:
    assert name in CONTROLLERS
    scenario = override(FORCE, [f"controller.name={name}"])
    law = measure_law(build_controller(scenario.controller), setup_of(scenario), 20.0, 5000.0)
    assert longest_latency(setup_of(scenario), law, [0.008]) > 0.0
