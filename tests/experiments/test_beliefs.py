"""What the host believes: a tool found in the poses the robot visits, an arm whose errors are known."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from polish_sim.analysis.claim import shortfalls
from polish_sim.calibration import GRAVITY, plan_payload_poses, write_calibration
from polish_sim.calibration.arm import ArmEstimate
from polish_sim.calibration.payload import move, payload_regressor
from polish_sim.cell import weight_of
from polish_sim.cell.real_arm import AROUND, built_table, gear_errors, resting_arm
from polish_sim.cell.scene import robot_with_tool, tool_on_flange
from polish_sim.errors import CalibrationError, ConfigError, InputError
from polish_sim.experiments import PAYLOAD_SCENARIO, run_experiment, run_payload_calibration
from polish_sim.experiments.assembly import check_settings
from polish_sim.experiments.beliefs import believe_tool, readings_at_rest, track_arm
from polish_sim.experiments.free_space import prepare_arc
from polish_sim.experiments.part_setup import random_streams
from polish_sim.experiments.registry import default_scenario
from polish_sim.experiments.rows import PAYLOAD_CLAIMS
from polish_sim.experiments.surface import prepare_force
from polish_sim.motion import forward
from polish_sim.motion.kinematics import NOMINAL, use_arm
from polish_sim.scenario_file import override
from tests.cell.cells import IDEAL_SENSOR, cell_for, free_stroke, tool_pose

HERE = tool_pose(0.0, -0.5, 0.3)


@pytest.fixture(scope="module")
def calibrated():
    return run_payload_calibration(PAYLOAD_SCENARIO)


def test_an_ideal_sensor_gives_the_tool_to_the_last_digits_of_the_log():
    """The log keeps wrenches and orientations in single precision, and the arm creeps by nanometres."""
    ideal = override(PAYLOAD_SCENARIO, ["robot.arm=ideal", "payload.poses=6", *IDEAL_SENSOR])
    figures = run_payload_calibration(ideal).figures
    assert figures["mass_error_relative"] < 1e-5
    assert figures["center_error_m"] < 1e-6
    assert figures["compensation_error_max_n"] < 1e-4


def test_a_steady_drift_is_found_where_it_is_asked_for_and_a_saturated_sensor_named():
    """A walk of 0.1 N/sqrt(s): nothing else is that large, so the return to the first pose shows it."""
    scenario = override(PAYLOAD_SCENARIO, [*IDEAL_SENSOR, "payload.poses=6", "sensor.force_drift_n_s=0.1"])
    found = run_payload_calibration(scenario, drift=True)
    first, last = found.readings.R_base_sensor[[0, -1]]
    np.testing.assert_allclose(last, first, atol=1e-4)
    trend = found.estimate.drift[:3] * found.figures["drift_return_s"]
    np.testing.assert_allclose(trend, found.figures["drift_return_n"], atol=0.5)
    assert np.linalg.norm(found.figures["drift_return_n"]) > 0.3
    # With strokes a minute apart a tare before each holds it.
    assert found.figures["drift_600s_retared_rms_n"] < 0.5 * found.figures["drift_600s_rms_n"]
    with pytest.raises(CalibrationError, match=r"torque . .*sensor\.torque_range_nm"):
        run_payload_calibration(override(PAYLOAD_SCENARIO, ["sensor.torque_range_nm=1", "payload.poses=6"]))


@pytest.mark.parametrize("count", [6, 12])
def test_the_plan_spreads_gravity_close_to_the_best_and_touches_nothing_on_the_way(count):
    up = plan_payload_poses(count).R_base_sensor[:, 2]
    scaled = payload_regressor(up) / np.repeat([GRAVITY, 1.0], [4, 6])
    assert np.linalg.cond(scaled.reshape(-1, 10)) < np.sqrt(1.5) * 1.1
    model = prepare_force(default_scenario("force"))[1].model  # the part's cell has the table
    data = mujoco.MjData(model)
    q = plan_payload_poses(count).q
    for start, end in zip(q, np.roll(q, -1, axis=0), strict=True):
        for joints in move(start, end, np.linspace(0.0, 1.0, 30)):
            data.qpos[:6] = joints
            mujoco.mj_forward(model, data)
            assert data.ncon == 0
            assert data.site("tool").xpos[2] > 0.25


def test_readings_at_rest_are_those_of_the_moving_cell_up_to_noise(calibrated):
    """What every run does without moving the arm, and what the arm does: the same tool, the same accuracy."""
    cell = cell_for(PAYLOAD_SCENARIO, free_stroke(HERE))
    readings = readings_at_rest(cell, np.random.default_rng(0))
    noise = readings.wrenches - weight_of(cell.carried, readings.R_base_sensor) - cell.sensor.bias
    assert noise[:, :3].std() == pytest.approx(0.5 / np.sqrt(500.0), rel=0.4)
    assert noise[:, 3:].std() == pytest.approx(0.02 / np.sqrt(500.0), rel=0.4)
    np.testing.assert_allclose(readings.R_base_sensor, calibrated.readings.R_base_sensor[:12], atol=2e-3)


def test_the_belief_of_a_run_is_as_good_as_the_calibration_and_its_noise_does_not_hang_on_it():
    errors = []
    for seed in range(8):
        cell = cell_for(override(default_scenario("force"), [f"seed={seed}"]), free_stroke(HERE))
        believe_tool(cell, random_streams(seed).payload)
        errors.append(cell.payload_errors)
    mass, center = np.array(errors).T
    assert 0.0 < np.abs(mass).max() < 0.01 * cell.carried.mass
    assert center.max() < 1e-3
    scenario = override(default_scenario("force"), [*IDEAL_SENSOR, "sensor.payload_mass_error=0.2"])
    cell = cell_for(scenario, free_stroke(HERE))
    believe_tool(cell, np.random.default_rng(0))  # a planted error comes on top
    assert cell.payload_errors.payload_mass_error_kg == pytest.approx(0.2 * cell.carried.mass, rel=1e-6)
    asked = [override(default_scenario("force"), [f"payload.poses={count}"]) for count in (4, 20)]
    one, two = (prepare_force(scenario)[1] for scenario in asked)
    np.testing.assert_array_equal(one.sensor.bias, two.sensor.bias)
    assert one.rng.standard_normal() == two.rng.standard_normal()
    assert one.state.payload.mass != two.state.payload.mass


def test_a_run_believes_the_file_it_is_given_if_it_is_a_calibration(calibrated, tmp_path):
    file = tmp_path / "calibration.toml"
    write_calibration(file, calibrated.estimate)
    cell = cell_for(override(default_scenario("force"), [f"payload.file={file}"]), free_stroke(HERE))
    believe_tool(cell, np.random.default_rng(0))
    assert cell.state.payload.mass == calibrated.estimate.mass
    np.testing.assert_array_equal(cell.state.payload.center, calibrated.estimate.center)
    for text, said in (
        ('kind = "tcp"\n', "kind = 'tcp'"),
        ('kind = "payload"\nmass_kg = -2\ncenter_m = [0, 0, 0.1]\n', "mass_kg is -2"),
        ('kind = "payload"\nmass_kg = "2"\ncenter_m = [0, 0, 0.1]\n', "mass_kg is '2'"),
        ('kind = "payload"\nmass_kg = 2\ncenter_m = [0, 0, nan]\n', "wanted 3 finite numbers"),
        ("kind = \n", "not valid TOML"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(InputError, match=said):
            believe_tool(cell, np.random.default_rng(0))


@pytest.mark.parametrize(("seed", "table"), [(1, "uncalibrated"), (2, "calibrated")])
def test_every_claim_is_met_by_the_frames_the_host_believes(seed, table):
    asked = ["robot.arm=ur5e", f"robot.real.kinematics={table}", f"seed={seed}"]
    found = run_payload_calibration(override(PAYLOAD_SCENARIO, asked))
    assert {claim.figure for claim in PAYLOAD_CLAIMS} <= set(found.figures)
    assert shortfalls(PAYLOAD_CLAIMS, found.figures) == []
    np.testing.assert_allclose(found.readings.R_base_sensor[:-1], forward(found.q)[:-1, :3, :3], atol=1e-4)


SEED = 541
KNOWN = "robot.compensation=tracker"


def arc(*changes):
    return override(default_scenario("arc"), [f"seed={SEED}", "process.max_feed_s=6", *changes])


@cache
def circle(*changes):
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
    other = replace(arc(f"robot.compensation={file}"), seed=SEED + 1)
    with pytest.raises(InputError, match=f"seed {SEED + 1}"):
        check_settings(other)
    file.write_text(text.replace(f"seed = {SEED}\n", ""), encoding="utf-8")
    check_settings(other)


@pytest.mark.parametrize(
    ("experiment", "changes", "named"),
    [
        ("arc", ("robot.compensation=trackr",), "tracker"), ("arc", (KNOWN, "robot.arm=ideal"), "robot.arm"),
        ("teach", (KNOWN,), "teach"), ("dual", ("robot.compensation={file}",), "--calibration"),
        ("arc", ("robot.compensation={file}",), "compensation.toml"),
    ],
)  # fmt: skip
def test_what_changes_nothing_or_is_no_file_is_refused(experiment, changes, named, tmp_path):
    file = tmp_path / "other.toml"
    file.write_text('kind = "arm"\n', encoding="utf-8")
    words = [change.format(file=file) for change in changes]
    with pytest.raises((ConfigError, InputError), match=named):
        check_settings(override(default_scenario(experiment), words))


def test_two_arms_that_know_their_gears_put_the_tool_on_the_part():
    asked = [f"seed={SEED}", KNOWN, "process.max_feed_s=1.5", "simulation.log_rate_hz=0"]
    figures = run_experiment(override(default_scenario("dual"), asked)).figures
    assert figures["relative_error_rms_m"] < 0.1e-3  # 0.2 to 0.35 mm with gears the hosts do not know
    assert figures["force_max_deviation_n"] < 1.5
