"""`polish-sim identify` as a user calls it."""

import csv
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from polish_sim.arms import arm_table
from polish_sim.cli.identify import asked_of
from polish_sim.config import RobotConfig
from polish_sim.identification import ELASTIC, GEARS, IdentifySettings
from polish_sim.identification.arm import arm_of_table
from polish_sim.identification.excitation import MotionLimits, random_motion
from polish_sim.identification.regressor import TorqueModel
from polish_sim.identification.robot_model import read_chain
from polish_sim.motion.serial_chain import link_parameters
from tests.cli.conftest import done, metrics_of, refused
from tests.identification.known import ODD, RATE, SIGMA, design_once, known_robot, played, write_log


def _log(file, still=slice(0)):
    """A log of one period, as a user might bring it; some joints may stand still."""
    known = known_robot()
    return write_log(file, known.model, known.with_still(still)(np.arange(2500) / RATE), SIGMA)


def _rows(file):
    return list(csv.DictReader(Path(file).read_text(encoding="utf-8").splitlines()))


def test_a_log_becomes_a_model_that_may_be_moved_and_is_taken_again(polish_sim):
    file = _log(Path("log.csv"))
    call = done(polish_sim("identify", "--data", file, "--period", 10, "--out", "found", "--check"))
    assert "explains little" not in call.err + call.out
    files = "identified.xml meshes metrics.json parameters.csv torques.png"
    assert sorted(path.name for path in Path("found").iterdir()) == files.split()
    assert metrics_of("found")["base_parameters"] == 58
    assert metrics_of("found")["error_over_crb"] is None
    friction = {row["name"]: row for row in _rows("found/parameters.csv") if row["identifiable"] == "alone"}
    assert float(friction["fc1"]["value"]) == pytest.approx(5.0, abs=5 * float(friction["fc1"]["std"]))
    Path("found").rename("moved")
    model = mujoco.MjModel.from_xml_path("moved/identified.xml")
    assert model.nmesh > 0
    assert model.dof_frictionloss[0] == pytest.approx(5.0, abs=0.3)
    mujoco.mj_step(model, mujoco.MjData(model))
    # It has the head's slide besides, which the log has not: the message names the joints to take.
    words = ["identify", "--data", file, "--period", 10, "--model", "moved/identified.xml", "--out", "again"]
    call = polish_sim(*words)
    assert call.code == 2
    joints = "".join(call.err.split("--joints")[1].split()).rstrip(".")
    done(polish_sim(*words, "--joints", joints))
    assert metrics_of("again")["base_parameters"] == 58
    first, again = (metrics_of(Path(name))["nrms_heldout_mean"] for name in ("moved", "again"))
    assert again == pytest.approx(first, rel=1e-3)


def test_of_more_seeds_only_those_that_are_missing_are_identified(polish_sim, monkeypatch):
    asked = design_once(monkeypatch, iterations=2)
    monkeypatch.setattr("polish_sim.identification.identify.USE_MOTIONS", 1)
    words = ("identify", "--periods", "1", "--set", "robot.arm=ideal", "--on", "here", "--out", "many")
    for count in (1, 2):
        done(polish_sim(*words, "--seed", "3", "--seeds", count))
    assert [settings.seed for settings in asked] == [3, 4]  # the first seed was there
    metrics = metrics_of("many")
    assert metrics["seeds"] == [3, 4]
    assert len(metrics["runs"]["3"]["nrms_heldout"]) == 6


def test_the_report_needs_no_log_and_one_that_cannot_be_taken_is_refused_with_what_takes_it(polish_sim):
    assert "the 58 base parameters" in done(polish_sim("identify", "--report")).out
    assert not list(Path().iterdir())
    known = known_robot()
    time = np.arange(2500) / RATE
    columns = {"time_s": time, "q_rad": known.motion(time).q, "current_a": np.ones((2500, 6))}
    np.savez(Path("currents.npz"), **columns)
    torn = {name: np.delete(column, slice(900, 1200), 0) for name, column in columns.items()}
    np.savez(Path("torn.npz"), **{**torn, "torque_nm": torn["q_rad"]})
    for file, cure in (("torn", "--period"), ("currents", "--arm")):
        call = polish_sim("identify", "--data", f"{file}.npz", "--out", "none")
        refused(call, f"{file}.npz")
        assert call.err.count(cure) == 1
    call = polish_sim("compare", "torn.npz", "--out", "none")
    assert (call.code, call.err.count("--period")) == (2, 0)
    file = _log(Path("log.csv"))
    head, *lines = file.read_text().splitlines()
    table = np.loadtxt(lines, delimiter=",")
    table[:, 9] = np.random.default_rng(0).normal(size=len(table))
    np.savetxt(file, table, delimiter=",", header=head, comments="")
    done(polish_sim("identify", "--data", file, "--period", 10, "--out", "noise"), "torque of elbow_joint (")
    still = _log(Path("still.csv"), still=slice(4, 5))
    call = polish_sim("identify", "--data", still, "--period", 10, "--out", "none")
    refused(call, "wrist_2_joint did not move")
    assert not Path("none").exists()


def test_the_predicted_error_is_asked_of_the_default_task_and_of_an_elastic_arm_its_own():
    for periods in (5, 1):
        settings = IdentifySettings(periods=periods, robot=RobotConfig(arm="ideal"))
        for for_task in (False, True):
            claims = {claim.figure: claim for claim in asked_of(settings, for_task)}
            assert math.isfinite(claims["predicted_error_sigma"].high) == (not for_task)
            assert math.isfinite(claims["nrms_heldout_mean"].high)
    claims = {claim.figure: claim for claim in asked_of(IdentifySettings(robot=RobotConfig(arm="ur5e")))}
    assert claims["nrms_heldout_mean"].high == ELASTIC
    assert {claim.figure for claim in GEARS} <= claims.keys()


def test_another_robot_is_identified_from_its_log_and_a_make_of_arm_with_its_gears_from_currents(polish_sim):
    Path("odd.xml").write_text(ODD, encoding="utf-8")
    model = TorqueModel(read_chain(mujoco.MjModel.from_xml_string(ODD)))
    reach = np.array([[-2.0, 2.0], [-0.5, 0.5], [-2.0, 2.0], [-2.0, 2.0]])
    limits = MotionLimits(reach, np.full(4, 2.0), np.full(4, 8.0), np.full(4, 100.0))
    planted = model.truth()
    planted[30:40] *= 1.2
    planted[model.names.index("fc3")] = 2.0
    states = played(random_motion(limits, np.random.default_rng(0)), 2)
    log = write_log(Path("odd.csv"), model, states, 0.05, planted)
    done(polish_sim("identify", "--data", log, "--model", Path("odd.xml"), "--out", "odd"))
    written = TorqueModel(read_chain(mujoco.MjModel.from_xml_path("odd/identified.xml")))
    truth = model.torque(states, planted)
    assert np.abs(written.torque(states, written.truth()) - truth).max() < 0.05
    assert np.abs(model.torque(states, model.truth()) - truth).max() > 2.0
    robot, known = arm_of_table("ur10e"), known_robot()
    states = played(known.motion, 2)
    torque = robot.model.torque(states, robot.model.truth())
    torque += np.random.default_rng(904).normal(size=torque.shape) * SIGMA
    current = torque / np.array(arm_table("ur10e").torque_constants)
    columns = {"time_s": np.arange(len(torque)) / RATE, "q_rad": states.q, "current_a": current}
    np.savez(Path("log.npz"), **{f"{run}/{name}": column for run in "ab" for name, column in columns.items()})
    done(polish_sim("identify", "--data", "log.npz", "--run", "a", "--arm", "ur10e", "--out", "found"))
    assert len(metrics_of("found")["nrms_heldout_rigid"]) == 6
    model = mujoco.MjModel.from_xml_path("found/identified.xml")
    assert model.body_mass.sum() == pytest.approx(robot.model.chain.parameters[:, 0].sum(), rel=0.5)
    assert model.njnt == 6
    np.savez(Path("bare.npz"), time_s=columns["time_s"], q_rad=states.q)
    refused(polish_sim("identify", "--data", "bare.npz", "--arm", "ur10e", "--out", "none"), "torque_nm")
    assert not Path("none").exists()


def test_a_payload_is_found_from_a_second_log(polish_sim):
    known = known_robot()
    loaded = known.model.truth()
    center = np.array([0.02, -0.01, 0.08]) - known.model.chain.origins[-1]
    loaded[50:60] += link_parameters(1.5, center, np.zeros((3, 3)))
    empty = write_log(Path("empty.csv"), known.model, played(known.motion, 1), SIGMA)
    other = write_log(Path("loaded.csv"), known.model, played(known.motion, 1), SIGMA, loaded, seed=1)
    done(polish_sim("identify", "--data", empty, "--payload-data", other, "--out", "found"))
    found = {row["name"]: row for row in _rows("found/payload.csv")}
    for name, true in (("mass", 1.5), ("center_x", 0.02), ("center_y", -0.01), ("center_z", 0.08)):
        assert float(found[name]["value"]) == pytest.approx(true, abs=4.5 * float(found[name]["std"]))
    assert float(found["mass"]["std"]) < 0.01
