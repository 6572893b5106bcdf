"""hybrid-adaptive in the cell: the figures asked of it, and springs, latencies and noise it was not told of."""

from __future__ import annotations

import pytest

from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.scenario_file import override


def press(*settings: str) -> RunResult:
    base = override(
        default_scenario("force"),
        ["controller.name=hybrid-adaptive", "process.approach_speed_m_s=0.02", "process.hold_s=1.2", *settings],
    )
    return run_experiment(base)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("extra", [(), ("spindle.speed_rpm=6000.0", "spindle.imbalance_m_s=0.0063")])
def test_a_step_of_20_n_settles_in_a_quarter_second_and_stays(seed: int, extra: tuple[str, ...]) -> None:
    figures = press(f"seed={seed}", *extra).figures
    assert figures["settling_time_1n_s"] < 0.25
    assert figures["overshoot_n"] < 1.0
    assert figures["steady_std_n"] < 0.3
    assert figures["steady_max_deviation_n"] < 1.0


@pytest.mark.parametrize("scale", [0.2, 5.0])
@pytest.mark.parametrize(("sensor", "command"), [(0.001, 0.001), (0.005, 0.015)])
def test_springs_and_latency_it_was_not_told_of(scale: float, sensor: float, command: float) -> None:
    result = press(f"head.spring_scale={scale}", f"sensor.latency_s={sensor}", f"robot.command_latency_s={command}")
    assert result.stop_reason is None
    assert result.figures["settling_time_1n_s"] < 0.6
    assert result.figures["steady_std_n"] < 0.3


def test_a_payload_taken_for_a_fifth_too_heavy_does_not_show() -> None:
    wrong, right = press("sensor.payload_mass_error=0.2").figures, press().figures
    assert wrong["settling_time_1n_s"] == pytest.approx(right["settling_time_1n_s"], abs=0.02)
    assert wrong["steady_std_n"] < 0.3


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_the_noise_sets_how_still_the_force_stands(noise: float) -> None:
    result = press(f"sensor.force_noise_n={noise}")
    assert result.stop_reason is None
    assert result.figures["settling_time_1n_s"] < 0.3
    assert result.figures["steady_std_n"] < 0.05 + 0.15 * noise
