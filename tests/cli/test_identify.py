"""`polish-sim identify` as a user calls it."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from polish_sim.cli.identify import asked_of, simulated
from polish_sim.config import RobotConfig
from polish_sim.identification.excitation import random_motion
from polish_sim.identification.fourier import MotionLimits
from polish_sim.identification.regressor import TorqueModel
from polish_sim.identification.robot_model import read_chain
from polish_sim.identification.settings import IDENTIFY, IdentifySettings
from polish_sim.motion.serial_chain import link_parameters
from tests.cli.conftest import Tool
from tests.identification.chains import ODD
from tests.identification.logs import played, write_log
from tests.identification.motions import SIGMA, known_robot, noisy

NAMES = ["time_s", *(f"q{j}_rad" for j in range(1, 7)), *(f"torque{j}_nm" for j in range(1, 7))]


def _log(file: Path, still: int | None = None) -> Path:
    """A log of one period, as a user might bring it; a joint may stand still."""
    known = known_robot(4000)
    coefficients = known.motion.coefficients.copy()
    if still is not None:
        coefficients[still, 1:] = 0.0
    t = np.arange(4000) / 400.0
    states = type(known.motion)(coefficients)(t)
    torque = noisy(known.model.torque(states, known.model.truth()), np.random.default_rng(0))
    table = np.column_stack([t, states.q, torque])
    np.savetxt(file, table, delimiter=",", header=",".join(NAMES), comments="")
    return file


def test_a_log_becomes_a_model_with_a_table_and_figures(polish_sim: Tool, tmp_path: Path) -> None:
    call = polish_sim("identify", "--data", _log(tmp_path / "log.csv"), "--period", 10, "--out", "found", "--check")
    assert call.code == 0, call.err
    assert {path.name for path in Path("found").iterdir()} == {
        "identified.xml", "meshes", "parameters.csv", "metrics.json", "torques.png",
    }  # fmt: skip
    metrics = json.loads(Path("found/metrics.json").read_text(encoding="utf-8"))
    assert metrics["base_parameters"] == 58
    assert metrics["error_over_crb"] is None
    rows = list(csv.DictReader(Path("found/parameters.csv").read_text(encoding="utf-8").splitlines()))
    friction = {row["name"]: row for row in rows if row["identifiable"] == "alone"}
    assert float(friction["fc1"]["value"]) == pytest.approx(5.0, abs=5 * float(friction["fc1"]["std"]))
    # The folder may be moved: what the model needs is inside.
    Path("found").rename(tmp_path / "moved")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "moved" / "identified.xml"))
    assert model.nmesh > 0
    assert model.dof_frictionloss[0] == pytest.approx(5.0, abs=0.3)
    mujoco.mj_step(model, mujoco.MjData(model))


def test_the_simulated_arm_leaves_its_files(tmp_path: Path) -> None:
    outcome = simulated(
        IdentifySettings(periods=1, iterations=5, robot=RobotConfig(arm="ideal"), payload=1.0), tmp_path
    )
    assert {path.name for path in tmp_path.iterdir()} == {
        "identified.xml", "meshes", "parameters.csv", "payload.csv", "metrics.json", "torques.png", "motion.png",
    }  # fmt: skip
    assert outcome.claims == IDENTIFY["short"]
    metrics = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    assert len(metrics["nrms_heldout"]) == 6
    assert metrics["condition"] > 1.0


def test_of_the_real_arm_no_error_is_asked(polish_sim: Tool) -> None:
    call = polish_sim("identify", "--periods", 1, "--set", "robot.arm=ur5e", "--out", "found", "--check")
    assert call.code == 0, call.err
    assert json.loads(Path("found/metrics.json").read_text(encoding="utf-8"))["nrms_heldout_mean"] > 0.0013


def test_the_report_says_what_torques_can_tell(polish_sim: Tool) -> None:
    call = polish_sim("identify", "--report")
    assert call.code == 0
    assert "the 58 base parameters" in call.out
    assert not list(Path().iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--method", "guess"], "unknown method 'guess'. Known: joint, stepwise, stepwise-axes."),
        (["--objective", "best"], "unknown objective 'best'"),
        (["--periods", "0"], "at least one whole period"),
        (["--period", "5"], "--period belongs to --data"),
        (["--data", "none.csv"], "cannot read the samples 'none.csv'"),
        (["--data", "none.csv", "--seed", "3"], "--seed would change nothing with --data"),
        (["--data", "none.csv", "--period", "-1"], "more than 0 s"),
        (["--data", "none.csv", "--method", "stepwise", "--period", "10"], "leave --period out"),
        (["--model", "robot.xml"], "--model belongs to --data or --report"),
        (["--payload", "9"], "--payload 9: wanted 0 to 3 kg"),
        (["--payload-data", "none.csv", "--method", "joint"], "leave it out, or add --data"),
        (["--payload-data", "none.csv"], "cannot read the samples 'none.csv'"),
        (["--data", "none.csv", "--task", "line.csv"], "--task would change nothing with --data"),
        (["--report", "--data", "log.csv", "--seed", "3"], "--seed, --data would change nothing with --report"),
        (["--report", "--out", "id"], "--out would change nothing with --report"),
        (["--joints", "a"], "--joints belongs to --model"),
        (["--set", "head.mass_kg=1"], "--set head.mass_kg=1 would change nothing in 'identify'"),
        (["--set", "robot.arm=ur10"], "unknown robot.arm 'ur10'"),
        (["--report", "--set", "robot.arm=ur5e"], "--set would change nothing with --report"),
        (["--report", "--model", "none.xml"], "cannot read the robot model 'none.xml'"),
    ],
)
def test_bad_usage_is_one_message_and_writes_nothing(polish_sim: Tool, words: list[str], said: str) -> None:
    call = polish_sim("identify", *words)
    assert call.code == 2
    assert said in call.err
    assert not list(Path().iterdir())


def test_another_robot_is_identified_from_its_log_and_written_back(polish_sim: Tool, tmp_path: Path) -> None:
    (tmp_path / "odd.xml").write_text(ODD, encoding="utf-8")
    model = TorqueModel(read_chain(mujoco.MjModel.from_xml_string(ODD)))
    reach = np.array([[-2.0, 2.0], [-0.5, 0.5], [-2.0, 2.0], [-2.0, 2.0]])
    limits = MotionLimits(reach, np.full(4, 2.0), np.full(4, 8.0), np.full(4, 100.0))
    planted = model.truth()
    planted[30:40] *= 1.2
    planted[model.names.index("fc3")] = 2.0
    states = played(random_motion(limits, np.random.default_rng(0)), 2)
    log = write_log(tmp_path / "odd.csv", model, states, 0.05, planted)
    call = polish_sim("identify", "--data", log, "--model", tmp_path / "odd.xml", "--out", "found")
    assert call.code == 0, call.err
    written = TorqueModel(read_chain(mujoco.MjModel.from_xml_path("found/identified.xml")))
    off, drawn = (
        x.torque(states, parameters) - model.torque(states, planted)
        for x, parameters in ((written, written.truth()), (model, model.truth()))
    )
    assert np.abs(off).max() < 0.05
    assert np.abs(drawn).max() > 2.0


def test_a_payload_is_found_from_a_second_log_and_from_the_robots_model_alone(polish_sim: Tool, tmp_path: Path) -> None:
    known = known_robot()
    loaded = known.model.truth()
    loaded[50:60] += link_parameters(
        1.5, np.array([0.02, -0.01, 0.08]) - known.model.chain.origins[-1], np.zeros((3, 3))
    )
    empty = write_log(tmp_path / "empty.csv", known.model, played(known.motion, 1), SIGMA)
    other = write_log(tmp_path / "loaded.csv", known.model, played(known.motion, 1), SIGMA, loaded, seed=1)
    for words in (["--data", empty], []):
        call = polish_sim("identify", *words, "--payload-data", other, "--out", "found", "--overwrite")
        assert call.code == 0, call.err
        rows = csv.DictReader(Path("found/payload.csv").read_text(encoding="utf-8").splitlines())
        found = {row["name"]: row for row in rows}
        for name, true in (("mass", 1.5), ("center_x", 0.02), ("center_y", -0.01), ("center_z", 0.08)):
            assert float(found[name]["value"]) == pytest.approx(true, abs=4.5 * float(found[name]["std"]))
        assert float(found["mass"]["std"]) < 0.01


def test_noise_for_torques_is_noted(polish_sim: Tool, tmp_path: Path) -> None:
    file = _log(tmp_path / "log.csv")
    assert "explains little" not in polish_sim("identify", "--data", file, "--period", 10, "--out", "good").err
    table = np.loadtxt(file, delimiter=",", skiprows=1)
    table[:, 9] = np.random.default_rng(0).normal(size=len(table))
    np.savetxt(file, table, delimiter=",", header=",".join(NAMES), comments="")
    call = polish_sim("identify", "--data", file, "--period", 10, "--out", "noise")
    assert call.code == 0
    assert "explains little of the torque of elbow_joint (" in call.err + call.out


def test_the_model_it_wrote_is_taken_again_with_the_joints_it_names(polish_sim: Tool, tmp_path: Path) -> None:
    file = _log(tmp_path / "log.csv")
    assert polish_sim("identify", "--data", file, "--period", 10, "--out", "found").code == 0
    words = ["identify", "--data", file, "--period", 10, "--model", "found/identified.xml", "--out", "again"]
    call = polish_sim(*words)
    assert call.code == 2
    joints = "".join(call.err.split("--joints")[1].split()).rstrip(".")
    call = polish_sim(*words, "--joints", joints)
    assert call.code == 0, call.err
    metrics = [json.loads(Path(name, "metrics.json").read_text(encoding="utf-8")) for name in ("found", "again")]
    assert metrics[1]["base_parameters"] == 58
    assert metrics[1]["nrms_heldout_mean"] == pytest.approx(metrics[0]["nrms_heldout_mean"], rel=1e-3)


@pytest.mark.parametrize(
    ("settings", "bounded"), [(IdentifySettings(), True), (IdentifySettings(objective="condition"), False)]
)
def test_the_bound_of_the_default_objective_is_asked_of_no_other(settings: IdentifySettings, bounded: bool) -> None:
    for method, periods in (("joint", 5), ("joint", 1), ("stepwise", 1)):
        claims = {
            claim.figure: claim for claim in IDENTIFY[asked_of(replace(settings, method=method, periods=periods))]
        }
        assert math.isfinite(claims["predicted_error_sigma"].high) == bounded
        assert math.isfinite(claims["nrms_heldout_mean"].high)


def test_a_joint_that_stood_still_is_named(polish_sim: Tool, tmp_path: Path) -> None:
    call = polish_sim("identify", "--data", _log(tmp_path / "log.csv", still=4), "--period", 10, "--out", "found")
    assert call.code == 2
    assert "wrist_2_joint did not move" in call.err
    assert not Path("found").exists()
