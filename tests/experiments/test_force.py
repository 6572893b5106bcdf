"""Experiment force: steps with every law, rigid blocks."""

import numpy as np
import pytest

from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.log import RETRACT_PHASE, TOUCH_PHASE
from polish_sim.scenario_file import override


@pytest.mark.parametrize("every", [1, 2])
def test_it_settles_within_three_newton_in_four_tenths_of_a_second_and_holds(every):
    """Sensor noise and bias, part displaced, turned and bent; the host at 1000 and 500 Hz."""
    asked = ["seed=101", f"simulation.control_every={every}"]
    result = run_experiment(override(default_scenario("force"), asked))
    figures, trace = result.figures, result.trace
    assert result.stop_reason is None
    assert figures["settling_time_3n_s"] < 0.4
    assert figures["steady_within_3n"] == 1.0
    assert figures["steady_std_n"] < 0.5
    assert figures["path_done"] == 1.0
    held = trace.normal_force_n[trace.fed]
    assert held[1000:].mean() == pytest.approx(20.0, abs=0.2)
    assert len(held) * 0.001 == pytest.approx(result.scenario.process.hold_s, abs=0.005)
    # First contact lies 0.7 to 1 mm off, and as far as turning and bending add.
    first = int(np.argmax(trace.phase == TOUCH_PHASE))
    nominal = np.array(figures["T_base_work"])[2, 3] + result.path.positions_work[-1, 2]
    assert 0.0005 < abs(trace.tcp_position_m[first, 2] - nominal) < 0.0013


def test_springs_stiffer_than_drawn_do_not_make_it_swing():
    changes = ["head.spring_scale=5", "seed=531", "process.hold_s=2"]
    result = run_experiment(override(default_scenario("force"), changes))
    assert result.figures["settling_time_1n_s"] < 0.6
    assert np.ptp(result.trace.normal_force_n[-1000:]) < 1.0


def test_half_the_physics_step_gives_the_same_response():
    quiet = [f"sensor.{name}=0" for name in ("force_noise_n", "torque_noise_nm", "force_drift_n_s")]
    quiet, after = override(default_scenario("force"), [*quiet, "process.hold_s=1"]), []
    for dt in (0.001, 0.0005):
        trace = run_experiment(override(quiet, [f"simulation.timestep_s={dt}"])).trace
        after.append(trace.normal_force_n[int(np.argmax(trace.phase == TOUCH_PHASE)) :])
    n = min(len(after[0]), len(after[1]) // 2)
    np.testing.assert_allclose(after[0][:n], after[1][: 2 * n : 2], atol=0.6)


ADAPTIVE = ("robot.arm=ideal", "controller.name=hybrid-adaptive", "process.approach_speed_m_s=0.02")


def pressed(*settings: str) -> RunResult:
    return run_experiment(override(default_scenario("force"), [*ADAPTIVE, "process.hold_s=1.2", *settings]))


@pytest.mark.parametrize(
    "extra", ["sensor.payload_mass_error=0.2", "seed=1 spindle.speed_rpm=6000.0 spindle.imbalance_m_s=0.0063"]
)
def test_a_step_of_20_n_settles_in_a_quarter_second_and_stays(extra):
    figures = pressed(*extra.split()).figures
    assert figures["settling_time_1n_s"] < 0.25
    assert figures["overshoot_n"] < 1.0
    assert figures["steady_std_n"] < 0.3
    assert figures["steady_max_deviation_n"] < 1.0


@pytest.mark.parametrize(
    ("scale", "sensor", "command"), [(0.2, 0.005, 0.015), (5.0, 0.001, 0.001), (5.0, 0.005, 0.015)]
)
def test_springs_and_latency_it_was_not_told_of(scale, sensor, command):
    late = f"sensor.latency_s={sensor}", f"robot.command_latency_s={command}"
    result = pressed(f"head.spring_scale={scale}", *late)
    assert result.stop_reason is None
    # Springs a fifth as stiff give by 20 mm: at 30 mm/s, which cannot strike on stiff ones, that takes 0.7 s.
    assert result.figures["settling_time_1n_s"] < (0.9 if scale < 1.0 else 0.6)
    held = result.trace.normal_force_n[result.trace.phase < RETRACT_PHASE]
    held = held[-400:]  # by then it has landed on any springs
    assert held.std() < 0.3


LITTLE = "controller.baselines.mode_damping=0.005"  # the default of older texts
FINE = ("simulation.timestep_s=0.0005", "simulation.control_every=2", "process.approach_speed_m_s=0.02")
MODE = ("controller.name=force-mode", "process.contact_force_n=10", "safety.force_limit_n=80")


def late(stiffer: float, *changes: str) -> np.ndarray:
    """Exact force [N] of force mode in the last two seconds, on springs stiffer than drawn by a factor."""
    asked = [f"head.spring_scale={stiffer}", "process.hold_s=4", *MODE, *FINE, *changes]
    run = run_experiment(override(default_scenario("force"), asked))
    assert run.stop_reason is None
    return np.asarray(run.trace.normal_force_n)[-4000:]


def test_on_a_block_ten_times_as_stiff_force_mode_bounces_off_and_on_and_damping_lowers_it():
    force = late(10.0, LITTLE)
    assert force.max() > 20.0
    assert 0.25 < np.mean(force < 0.01) < 0.6
    landings = np.sum((force[1:] > 0.5) & (force[:-1] <= 0.5))
    assert 2 * 2 <= landings <= 4 * 2  # slow: some three times a second
    assert late(10.0, "controller.baselines.mode_damping=0.1").std() < 0.1 * force.std()
    drawn = late(1.0)
    assert drawn.mean() == pytest.approx(10.0, abs=0.2)
    assert drawn.std() < 0.3
