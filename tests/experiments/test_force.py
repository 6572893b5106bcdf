"""A step of 20 N from first contact."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.scenario_file import override


@pytest.fixture(scope="module", params=[101, 102, 103])
def result(request: pytest.FixtureRequest) -> RunResult:
    """Sensor noise and bias, part displaced, turned and bent: all by the seed."""
    return run_experiment(override(default_scenario("force"), [f"seed={request.param}"]))


def test_it_settles_within_three_newton_in_four_tenths_of_a_second_and_stays(result: RunResult) -> None:
    assert result.stop_reason is None
    assert result.figures["settling_time_3n_s"] < 0.4
    assert result.figures["steady_within_3n"] == 1.0
    assert result.figures["steady_std_n"] < 0.5


def test_the_mean_force_is_the_set_force_whatever_bias_and_displacement(result: RunResult) -> None:
    held = result.trace.normal_force_n[result.trace.phase == 2]
    assert held[1000:].mean() == pytest.approx(20.0, abs=0.2)


def test_it_holds_as_long_as_asked(result: RunResult) -> None:
    held = np.sum(result.trace.phase == 2) * 0.001
    assert held == pytest.approx(result.scenario.process.hold_s, abs=0.005)
    assert result.figures["path_done"] == 1.0


def test_the_part_was_not_where_it_was_drawn(result: RunResult) -> None:
    """First contact lies 0.7 to 1 mm off, and as far as turning and bending add."""
    first = int(np.argmax(result.trace.phase == 1))
    T_base_work = np.array(result.figures["T_base_work"])
    nominal = T_base_work[2, 3] + result.path.positions_work[-1, 2]
    assert 0.0005 < abs(result.trace.tcp_position_m[first, 2] - nominal) < 0.0013


@pytest.mark.parametrize("force", [5.0, 40.0])
def test_other_forces_are_held_too(force: float) -> None:
    changes = [f"process.contact_force_n={force}", "process.hold_s=2"]
    result = run_experiment(override(default_scenario("force"), changes))
    held = result.trace.normal_force_n[result.trace.phase == 2]
    assert held[1000:].mean() == pytest.approx(force, abs=0.02 * force + 0.1)


def test_every_second_step_will_do_for_the_host() -> None:
    result = run_experiment(override(default_scenario("force"), ["simulation.control_every=2", "seed=104"]))
    assert result.figures["settling_time_3n_s"] < 0.4
    assert result.figures["steady_within_3n"] == 1.0


def test_half_the_physics_step_gives_the_same_response() -> None:
    quiet = ["sensor.force_noise_n=0", "sensor.torque_noise_nm=0", "sensor.force_drift_n_s=0", "process.hold_s=1"]
    one, half = (
        run_experiment(override(default_scenario("force"), [*quiet, f"simulation.timestep_s={dt}"])).trace
        for dt in (0.001, 0.0005)
    )
    after = [trace.normal_force_n[int(np.argmax(trace.phase == 1)) :] for trace in (one, half)]
    n = min(len(after[0]), len(after[1]) // 2)
    np.testing.assert_allclose(after[0][:n], after[1][: 2 * n : 2], atol=0.6)
