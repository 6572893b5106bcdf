"""The linear force loop: statics, eigenvalues against Nyquist, and against the same loop stepped in time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polish_sim.control.loops import PiGains, PiMemory, force_pi
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.loop_model import (
    Arm,
    PiLaw,
    Setup,
    build_plant,
    hybrid_pi_linear,
    pi_law,
    plant_response,
    setup_of,
)
from polish_sim.scoring.margins import closed_loop_matrix, force_loop, growing_modes, growth, margins, response_of

FORCE = default_scenario("force")


def _scaled(law: PiLaw, gain: float) -> PiLaw:
    return law._replace(C=law.C * gain, D=law.D * gain)


def _loop(*changes: str) -> tuple[Setup, PiLaw]:
    scenario = override(FORCE, list(changes))
    return setup_of(scenario), hybrid_pi_linear(scenario.controller, scenario.simulation.timestep_s)


def test_slow_motion_presses_the_springs_in_series() -> None:
    setup, _ = _loop()
    plant, z = build_plant(setup), np.exp(np.array([0.5j]) * setup.dt)
    ratio = plant_response(plant, plant.force, z) / plant_response(plant, plant.position, z)
    assert abs(ratio[0]) == pytest.approx(5000.0, rel=1e-3)


def test_servos_pass_slow_commands_whole_and_swing_over_at_25_hz() -> None:
    setup, _ = _loop()
    plant = build_plant(setup._replace(pad_stiffness=0.0, pad_damping=0.0))
    speed = np.abs(
        plant_response(plant, plant.velocity, np.exp(2j * math.pi * np.array([0.1, 25.0, 140.0]) * setup.dt))
    )
    assert speed[0] == pytest.approx(1.0, abs=1e-3)
    assert 1.15 < speed[1] < 1.3
    assert speed[2] < 0.5


def test_filtered_pi_is_the_compiled_law() -> None:
    law, gains, state = pi_law(0.004, 0.012, 10.0, 0.001), PiGains(0.004, 0.012, 1.0, 10.0), PiMemory()
    force_pi(0.0, 0.0, gains, 0.001, state)  # the law's filter begins at its first reading
    s, rng = np.zeros(2), np.random.default_rng(1)
    for reading in rng.normal(size=200):
        speed = law.C @ s + law.D * reading
        s = law.A @ s + law.B * reading
        assert force_pi(0.0, reading, gains, 0.001, state) == pytest.approx(speed, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(
    "changes", [[], ["head.spring_scale=5"], ["robot.command_latency_s=0"], ["sensor.latency_s=0.01"]]
)
def test_eigenvalues_and_nyquist_agree_on_both_sides_of_the_border(changes: list[str]) -> None:
    setup, law = _loop(*changes)
    gain = margins(response_of(force_loop(setup, law), setup.dt)).gain
    for factor, stable in ((0.97, True), (1.03, False)):
        scaled = _scaled(law, gain * factor)
        assert (growth(closed_loop_matrix(setup, scaled), setup.dt) < 0.0) == stable
        assert (growing_modes(force_loop(setup, scaled), setup.dt) == 0) == stable


def test_delay_margin_is_where_the_eigenvalues_cross() -> None:
    setup, law = _loop()
    steps = margins(response_of(force_loop(setup, law), setup.dt)).delay / setup.dt
    late = setup._replace(command_steps=setup.command_steps + math.floor(steps))
    too_late = setup._replace(command_steps=setup.command_steps + math.ceil(steps))
    assert growth(closed_loop_matrix(late, law), setup.dt) < 0.0 < growth(closed_loop_matrix(too_late, law), setup.dt)


def test_delay_counts_the_same_before_and_after_the_law() -> None:
    setup, law = _loop()
    shifted = setup._replace(command_steps=setup.command_steps - 3, sensor_steps=setup.sensor_steps + 3)
    rates = [growth(closed_loop_matrix(s, law), s.dt) for s in (setup, shifted)]
    assert rates[0] == pytest.approx(rates[1], rel=1e-6)


def test_closed_loop_in_time_dies_away_as_its_slowest_eigenvalue_says() -> None:
    setup, law = _loop()
    plant, s, q = build_plant(setup), np.zeros(7), np.zeros(2)
    samples, commands = [0.0] * (setup.sensor_steps + 1), [0.0] * (setup.command_steps + 1)
    s[:2] = 1e-3, 0.25e-3
    force = []
    for _ in range(3000):
        samples = [plant.reading @ s, *samples[:-1]]
        speed = law.C @ q + law.D * samples[-1]
        q = law.A @ q + law.B * samples[-1]
        commands = [speed, *commands[:-1]]
        force.append(abs(plant.force @ s))
        s = plant.A @ s + plant.B * commands[-1]
    early, late = max(force[1000:1100]), max(force[2900:3000])
    assert math.log(late / early) / 1.9 == pytest.approx(growth(closed_loop_matrix(setup, law), setup.dt), rel=0.02)


def test_the_filter_is_what_keeps_the_tools_inertia_from_chattering() -> None:
    setup, law = _loop()
    bare = pi_law(0.004, 0.012, 500.0, setup.dt)
    assert growth(closed_loop_matrix(setup, law), setup.dt) < 0.0 < growth(closed_loop_matrix(setup, bare), setup.dt)
    weightless = setup._replace(arm=Arm(mount_mass=0.0))
    assert growth(closed_loop_matrix(weightless, bare), setup.dt) < 0.0
