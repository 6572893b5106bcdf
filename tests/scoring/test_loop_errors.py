"""Noise and surface through the modelled loop, against the loop run in time."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.force_theory import noise_rms, surface_error
from polish_sim.experiments import default_scenario
from polish_sim.scoring.loop_model import build_plant, hybrid_pi_linear, setup_of

FORCE = default_scenario("force")


def test_noise_through_the_loop_has_the_rms_of_a_run() -> None:
    setup = setup_of(FORCE)
    law, plant, rng = hybrid_pi_linear(FORCE.controller, setup.dt), build_plant(setup), np.random.default_rng(0)
    s, q, noisy = np.zeros(7), np.zeros(2), 0.0
    samples, commands, forces = [0.0] * (setup.sensor_steps + 1), [0.0] * (setup.command_steps + 1), []
    for draw in rng.normal(0.0, 0.5, 60_000):
        noisy += setup.sensor_blend * (draw - noisy)
        samples = [plant.reading @ s + noisy, *samples[:-1]]
        speed = law.C @ q + law.D * samples[-1]
        q = law.A @ q + law.B * samples[-1]
        commands = [speed, *commands[:-1]]
        forces.append(plant.force @ s)
        s = plant.A @ s + plant.B * commands[-1]
    assert noise_rms(setup, law, 0.5) == pytest.approx(np.std(forces[5000:]), rel=0.08)


def test_slow_waves_are_taken_out_and_quick_ones_pass_to_the_springs() -> None:
    setup = setup_of(FORCE)
    error = np.abs(surface_error(setup, hybrid_pi_linear(FORCE.controller, setup.dt))(np.array([0.1, 100.0])))
    assert error[0] < 0.01 * 5000.0
    assert error[1] > 0.9 * 5000.0
