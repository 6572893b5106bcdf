"""One path played with every rule on the servos: figures hang together, and the run is a run like any other."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.experiments import RunResult, check_experiment, default_scenario, run_experiment
from polish_sim.motion.rules.rule import RULES
from polish_sim.smoothing.experiment import CLAIMS
from polish_sim.smoothing.trial import LENGTH


@pytest.fixture(scope="module")
def run() -> RunResult:
    return run_experiment(default_scenario("smooth"))


def test_every_figure_that_is_shown_is_measured(run: RunResult) -> None:
    assert {claim.figure for claim in CLAIMS} <= set(run.figures)


def test_each_rule_is_in_the_log_from_its_start_to_its_end(run: RunResult) -> None:
    assert run.figures["rules"] == list(RULES)
    for k, rule in enumerate(RULES):
        rows = np.asarray(run.log["rule"]) == k
        assert run.log["time_s"][rows][0] == 0.0
        assert run.log["time_s"][rows][-1] == pytest.approx(
            run.figures[f"{rule.replace('-', '_')}_cycle_time_s"], abs=0.25
        )
        assert run.log["path_s_m"][rows][-1] == pytest.approx(LENGTH, abs=1e-5)
        ends = run.log["target_position_m"][rows]
        assert np.linalg.norm(ends[0] - ends[-1]) < 1e-6  # the trial's path is closed


def test_the_servos_follow_within_two_tenths_of_a_milliradian(run: RunResult) -> None:
    for rule in RULES:
        errors = np.array(run.figures[f"{rule.replace('-', '_')}_tracking_error_max_rad"])
        assert errors.shape == (6,)
        assert np.all((errors > 0.0) & (errors < 2e-4))
    logged = np.abs(run.log["target_q_rad"] - run.log["q_rad"].astype(float)).max()
    largest = max(max(run.figures[f"{rule.replace('-', '_')}_tracking_error_max_rad"]) for rule in RULES)
    assert logged == pytest.approx(largest, rel=0.05)


def test_at_equal_cycle_times_the_slowest_rule_is_played_as_before(run: RunResult) -> None:
    times = {rule: run.figures[f"{rule.replace('-', '_')}_cycle_time_s"] for rule in RULES}
    slowest = max(times, key=lambda rule: times[rule]).replace("-", "_")
    assert run.figures["equal_time_s"] == max(times.values())
    same = run.figures[f"{slowest}_tracking_error_max_rad_at_equal_time"]
    assert same == pytest.approx(run.figures[f"{slowest}_tracking_error_max_rad"], rel=1e-6)


def test_certified_keeps_the_joint_limits_and_the_compared_rule_does_not(run: RunResult) -> None:
    assert run.figures["certified_joint_jerk_ratio_max"] <= 1.0
    assert run.figures["certified_joint_acceleration_ratio_max"] <= 1.0
    assert run.figures["joint_acceleration_joint_jerk_ratio_max"] > 1.0


def test_its_path_and_reach_can_be_checked_without_playing() -> None:
    path, reach, _ = check_experiment(default_scenario("smooth"))
    assert path.length_m == pytest.approx(LENGTH, abs=1e-6)
    assert reach.smallest_singular_value > 0.05
