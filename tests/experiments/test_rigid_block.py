"""The known bounce of a robot's force mode on a stiff part: 10 N wanted on a block that hardly gives way."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.scenario_file import override

FINE = ("simulation.timestep_s=0.0005", "simulation.control_every=2", "process.approach_speed_m_s=0.02")


def pressed_on(stiffer: float, *changes: str) -> RunResult:
    """Force mode on springs so many times as stiff as drawn."""
    asked = ["controller.name=force-mode", "process.contact_force_n=10", "safety.force_limit_n=80", *FINE, *changes]
    return run_experiment(override(default_scenario("force"), [f"head.spring_scale={stiffer}", *asked]))


def late(run: RunResult) -> np.ndarray:
    """Exact force in the last two seconds [N]."""
    force = np.asarray(run.trace.normal_force_n)
    return force[-4000:]


@pytest.fixture(scope="module")
def bouncing() -> RunResult:
    return pressed_on(10.0, "process.hold_s=4")


def test_on_a_block_ten_times_as_stiff_force_mode_bounces_off_and_on_and_does_not_come_to_rest(
    bouncing: RunResult,
) -> None:
    force = late(bouncing)
    assert bouncing.stop_reason is None
    assert force.max() > 30.0
    assert 0.4 < np.mean(force < 0.01) < 0.8
    landings = np.sum((force[1:] > 0.5) & (force[:-1] <= 0.5))
    assert 3 * 2 <= landings <= 6 * 2  # slow: some four times a second


def test_on_the_springs_as_drawn_it_comes_to_rest() -> None:
    force = late(pressed_on(1.0, "process.hold_s=4"))
    assert force.mean() == pytest.approx(10.0, abs=0.2)
    assert force.std() < 0.3


def test_more_damping_lowers_the_bounce(bouncing: RunResult) -> None:
    damped = late(pressed_on(10.0, "process.hold_s=4", "controller.baselines.mode_damping=0.1"))
    assert damped.std() < 0.1 * late(bouncing).std()


def test_the_bounce_is_the_loops_delay_not_the_noise() -> None:
    quiet = ("sensor.force_noise_n=0", "sensor.torque_noise_nm=0", "sensor.force_quantum_n=0")
    assert late(pressed_on(10.0, "process.hold_s=4", *quiet)).max() > 30.0
    prompt = ("robot.command_latency_s=0", "sensor.latency_s=0", "sensor.bandwidth_hz=0")
    assert late(pressed_on(10.0, "process.hold_s=4", *prompt)).min() > 2.0
