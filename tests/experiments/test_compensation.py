"""A host that knows its arm: what it sees at rest, on the circle, with two arms; files and refusals."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polish_sim.calibration.arm import ArmEstimate
from polish_sim.cell.real_arm import AROUND, built_table, gear_errors, resting_arm
from polish_sim.cell.scene import robot_with_tool, tool_on_flange
from polish_sim.config import Scenario
from polish_sim.errors import ConfigError, InputError
from polish_sim.experiments import RunResult, default_scenario, run_experiment
from polish_sim.experiments.assembly import check_settings
from polish_sim.experiments.beliefs import track_arm
from polish_sim.experiments.free_space import prepare_arc
from polish_sim.motion.kinematics import NOMINAL, use_arm
from polish_sim.scenario_file import override

SEED = 541
KNOWN = "robot.compensation=tracker"


def arc(*changes: str) -> Scenario:
    return override(default_scenario("arc"), [f"seed={SEED}", "process.max_feed_s=6", *changes])


@cache
def circle(*changes: str) -> RunResult:
    return run_experiment(arc(*changes))


def test_the_arm_found_is_the_arm_built():
    scenario = arc(KNOWN)
    use_arm(scenario.robot.arm)
    start = prepare_arc(scenario).reach.q_start
    found = track_arm(scenario.robot, scenario.head, SEED, tuple(start))
    model = robot_with_tool(scenario).compile()
    arm = resting_arm(scenario.robot.real, SEED, model)
    tool = tool_on_flange()[:3, 3]
    built = ArmEstimate(built_table(scenario.robot.real, SEED, model, start), np.eye(4), tool)
    q = start + 0.5 * AROUND * np.random.default_rng(5).uniform(-1.0, 1.0, (200, 6))
    there = built.target_at(arm.links(q))
    off = np.linalg.norm(found.target_at(q, arm.weight(q)) - there, axis=1)
    maker = np.linalg.norm(built._replace(table=NOMINAL).target_at(q) - there, axis=1)
    assert np.sqrt(np.mean(off**2)) < 0.03e-3
    assert np.sqrt(np.mean(maker**2)) > 0.1e-3
    # The last axis goes through the tool's point, which its gear does not move.
    errors = gear_errors(scenario.robot.real, np.random.default_rng([SEED, 17, 1]))
    assert np.linalg.norm(found.gears[:5, 3:] - errors[:5]) < 0.25 * np.linalg.norm(errors[:5])


def test_the_tool_keeps_to_a_tenth_of_a_millimetre_and_the_file_gives_the_same_run_of_its_own_arm(tmp_path):
    first, unknown = circle(KNOWN), circle()
    error = first.figures["tracking_error_max_m"]
    assert error < 0.1e-3
    assert error < 0.5 * unknown.figures["tracking_error_max_m"]
    (name, text), *_ = first.files.items()
    (file := tmp_path / name).write_text(text, encoding="utf-8")
    again = circle(f"robot.compensation={file}")
    for name in first.log.columns:
        np.testing.assert_array_equal(first.log[name], again.log[name])
    assert unknown.files == {}
    # Of another arm it is refused, unless somebody takes its seed out.
    other = replace(arc(f"robot.compensation={file}"), seed=SEED + 1)
    with pytest.raises(InputError, match=f"seed {SEED + 1}"):
        check_settings(other)
    file.write_text(text.replace(f"seed = {SEED}\n", ""), encoding="utf-8")
    check_settings(other)


@pytest.mark.parametrize(
    ("experiment", "changes", "named"),
    [
        ("arc", ("robot.compensation=trackr",), "tracker"),
        ("arc", (KNOWN, "robot.arm=ideal"), "robot.arm"),
        ("teach", (KNOWN,), "teach"),
        ("dual", ("robot.compensation={file}",), "--calibration"),
        ("arc", ("robot.compensation={file}",), "compensation.toml"),
    ],
)
def test_what_changes_nothing_or_is_no_file_is_refused(experiment, changes, named, tmp_path):
    file = tmp_path / "other.toml"
    file.write_text('kind = "arm"\n', encoding="utf-8")
    words = [change.format(file=file) for change in changes]
    with pytest.raises((ConfigError, InputError), match=named):
        check_settings(override(default_scenario(experiment), words))


def test_two_arms_that_know_their_gears_put_the_tool_on_the_part():
    asked = [f"seed={SEED}", KNOWN, "process.max_feed_s=2.5", "simulation.log_rate_hz=0"]
    figures = run_experiment(override(default_scenario("dual"), asked)).figures
    assert figures["relative_error_rms_m"] < 0.1e-3  # 0.2 to 0.35 mm with gears the hosts do not know
    assert figures["force_max_deviation_n"] < 1.5
