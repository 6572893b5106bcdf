"""A simulated run's log compared with its own replay differs by nothing; what is planted is found."""

import json

import numpy as np
import pytest

from polish_sim.compare import figures as measured
from polish_sim.compare import replay
from polish_sim.compare.replay import CarriedPayload, compare_joints
from polish_sim.errors import InputError
from polish_sim.exchange.robot_log import RobotRecording, read_robot_recording
from polish_sim.identification.estimate import torque_error
from polish_sim.motion.kinematics import use_arm
from polish_sim.scenario_file import override
from tests.cli.conftest import _undrawn, assert_refused, done, polish_sim
from tests.exchange.test_robot_log import synthetic_log, write_bag, write_csv

__all__ = ["_undrawn", "polish_sim"]
UR10E = replay.warm(override(replay.SCENARIO, ["robot.arm=ur10e"]).robot)
NAMES = {
    "time_s": "timestamp", "q_rad": "actual_q_{i}", "qd_rad_s": "actual_qd_{i}",
    "q_desired_rad": "target_q_{i}", "torque_nm": "actual_current_as_torque_{i}",
}  # fmt: skip


@pytest.fixture(autouse=True)
def _back_to_the_first():
    yield
    use_arm("ur5e")


def sines(seconds, rate=250.0):
    """A slow motion of all joints that begins in motion."""
    t = np.arange(round(seconds * rate)) / rate
    w = 2.0 * np.pi * np.array([0.2, 0.25, 0.3, 0.35, 0.4, 0.45])
    q = np.array([0.3, -1.6, 1.2, -1.0, -1.2, 0.2]) + 0.35 * np.sin(np.outer(t, w))
    return RobotRecording(t, {"q_rad": q, "q_desired_rad": q}, True)


@pytest.fixture(scope="module")
def logged():
    """What a recorder would have of a simulated run with a payload."""
    log = sines(4.0)
    played = replay.replay(UR10E, log, CarriedPayload(2.0, (0.0, 0.0, 0.05)))
    use_arm("ur5e")
    return {
        "time_s": 100.0 + log.time,
        "q_desired_rad": log.values["q_desired_rad"],
        "q_rad": played.q,
        "qd_rad_s": played.qd,
        "torque_nm": played.torque,
        "wrench": np.zeros((len(log.time), 6)),
    }


def test_a_simulated_log_is_its_own_replay_if_its_payload_is_named(logged, tmp_path):
    log = read_robot_recording(write_csv(tmp_path / "log.csv", logged, ",", NAMES), ("q_rad",))
    assert compare_joints(UR10E, log, CarriedPayload()).figures["nrms"][1] > 0.02
    found = compare_joints(UR10E, log, CarriedPayload(2.0, (0.0, 0.0, 0.05)))
    assert max(found.figures["nrms"]) < 1e-3
    assert max(found.figures["motion_rms_rad"]) < 1e-6
    assert abs(found.figures["delay_s"]) < 1e-5
    ripples = (found.figures[f"{name}ripple_nm"] for name in ("", "simulated_"))
    np.testing.assert_allclose(*ripples, rtol=0.05, atol=1e-3)


def test_a_bag_is_replayed_by_its_measured_motion(logged, tmp_path):
    """It holds no commands: what the servos lag behind and the low-pass are left."""
    pytest.importorskip("rosbags")
    log = read_robot_recording(write_bag(tmp_path / "bag", logged, "mcap"))
    found = compare_joints(UR10E, log, CarriedPayload(2.0, (0.0, 0.0, 0.05)))
    # The servos are 2 ms behind their commands, which the log does not hold, and again behind the replay's.
    assert max(found.figures["motion_rms_rad"]) < 0.002 * np.abs(logged["qd_rad_s"]).max()
    assert max(found.figures["nrms"]) < 0.1


def test_rigid_torques_hold_a_payload_at_its_lever_and_a_log_of_two_samples_is_too_short_for_a_replay():
    short = RobotRecording(np.array([0.0, 0.002]), {"q_rad": np.zeros((2, 6))}, True)
    with pytest.raises(InputError, match=r"0\.002 s long: too short to be replayed"):
        replay.commands_of(short)
    still = np.zeros((1, 6))
    loads = CarriedPayload(5.0, (0.0, 0.0, 0.1)), CarriedPayload()
    with_load, without = (replay.rigid_torques(UR10E, still, still, still, load) for load in loads)
    lever = 1.18425  # all joints at zero: the flange is level with the shoulder, its z axis across the arm
    assert abs((with_load - without)[0, 1]) == pytest.approx(5.0 * 9.81 * lever, rel=2e-3)


def test_planted_ripple_friction_by_speed_and_load_delay_and_error_are_found():
    t = np.arange(0.0, 25.0, 0.01)
    q, qd = 2.0 * np.sin(0.3 * t), 0.6 * np.cos(0.3 * t)
    noise = np.random.default_rng(500).normal(0.0, 0.3, len(t))
    for cycles in (101.0, 202.0):
        line = measured.ripple(t, q, qd, 0.7 * np.sin(cycles * q + 0.3) + noise)
        assert line.cycles == pytest.approx(cycles, abs=0.3)
        assert line.amplitude == pytest.approx(0.7, rel=0.1)
    t = np.arange(0.0, 60.0, 0.01)
    qd, rigid = 0.8 * np.cos(0.5 * t), 40.0 * np.sin(0.31 * t)
    share = np.where(rigid * qd > 0.0, 0.09, 0.04)
    torque = rigid + np.sign(qd) * (5.0 + 8.0 * np.abs(qd) + share * np.abs(rigid))
    np.testing.assert_allclose(measured.fit_friction(qd, torque, rigid)[0], (5.0, 8.0, 0.09, 0.04), atol=1e-9)
    curve = measured.friction_curve(qd, torque, rigid)
    assert 5.0 < curve[0] < curve[8] < 5.0 + 8.0 * 0.8 + 0.09 * 40.0
    t = np.arange(0.0, 20.0, 0.004)
    a = np.sin(2.0 * t)[:, None] * np.ones(6)
    late = np.sin(2.0 * (t - 0.0123))[:, None] * np.ones(6)
    assert measured.delay(t, late, a) == pytest.approx(0.0123, abs=2e-4)
    np.testing.assert_allclose(torque_error(a + 0.02, a), 0.01, rtol=1e-3)


def test_a_joint_that_moves_one_way_shows_no_friction_and_a_step_has_labels_and_its_peak():
    log = sines(4.0)
    log.values["q_rad"][:, 2] = 1.2 - 0.1 * log.time
    log.values["torque_nm"] = np.zeros_like(log.values["q_rad"])
    found = compare_joints(UR10E, log, CarriedPayload()).figures
    assert np.isnan(found["simulated_coulomb_nm"]).tolist() == [joint == 2 for joint in range(6)]
    assert "moves one way only" in replay.joint_table("", found).caption
    t = np.arange(-1.0, 4.0, 0.001)
    spikes = np.where(np.arange(len(t)) % 97 == 5, 2.5, 0.0)  # noise before contact
    step = measured.from_contact(t, np.where(t < 0.0, spikes, 20.0 + 200.0 * np.exp(-t / 0.02)), 20.0)
    assert step.time[1000] == pytest.approx(0.0, abs=2e-3)
    rows = replay.step_table("", measured.compare_steps(step, step)).rows
    assert ["peak", "N", "220", "220"] in rows
    assert not any("_" in row[0] for row in rows)
    (axes,) = replay.plot_steps([("", step, step)], "").axes
    assert axes.get_ylim()[1] > 220.0


def test_a_step_is_measured_by_its_closed_form():
    """20 N (1 - exp(-t / 0.2 s) cos): the last time it leaves 10 N is where the envelope is 10 N."""
    t = np.arange(-1.0, 4.0, 0.001)
    step = measured.from_contact(t, np.where(t < 0.0, 0.0, 20.0 * (1.0 - np.exp(-t / 0.2))), 20.0)
    found = measured.measure_step(step)
    contact = 0.2 * np.log(20.0 / 18.0)
    assert found["settling_s"] == pytest.approx(0.2 * np.log(2.0) - contact, abs=0.003)
    assert found["mean_error_n"] == pytest.approx(18.0 * 0.2 / 3.0, rel=0.01)
    assert found["lost_s"] == 0.0
    same = measured.compare_steps(step, step)
    assert same["force_rms_n"] == 0.0
    assert same["simulated_settling_s"] == same["settling_s"]


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Slow sines of all joints, with torques, and a sensor that drifts."""
    made = synthetic_log(3.0)
    made["wrench"] = np.full((len(made["time_s"]), 6), 2.0)
    made["q_rad"] = 0.3 * made["q_rad"] + [0.3, -1.4, 1.2, -1.0, -1.2, 0.2]
    return write_csv(tmp_path_factory.mktemp("log") / "log.csv", made | {"qd_rad_s": 0.3 * made["qd_rad_s"]})


@pytest.mark.pictures
def test_the_command_writes_figures_picture_and_page(log, polish_sim, tmp_path):
    call = done(polish_sim("compare", log, "--arm", "ur10e", "--payload", 2, "--out", "out"), "ur10e")
    assert "pressed" not in call.err
    figures = json.loads((tmp_path / "out/compare.json").read_text())
    assert figures.keys() >= {"nrms", "delay_s", "ripple_cycles"}
    assert len(figures["nrms"]) == 6
    files = {path.name for path in (tmp_path / "out").iterdir()}
    assert files >= {"compare.png", "report.html", "config.toml"}


@pytest.mark.parametrize("column", ["actual_TCP_force", "wrench_measured_tool"])  # a robot's, our own
def test_a_log_of_a_tool_that_pressed_is_replayed_without_the_force(logged, polish_sim, tmp_path, column):
    wrench = np.zeros((len(logged["time_s"]), 6))
    wrench[:300, 2] = 20.0
    names = NAMES | {"wrench": column + "_{i}"}
    polished = write_csv(tmp_path / "pressed.csv", logged | {"wrench": wrench}, ",", names)
    err = done(polish_sim("compare", polished, "--arm", "ur10e", "--out", "pressed")).err
    assert "above 5 N for 30% of the time, 20 N at most: its tool pressed on something" in err


@pytest.mark.parametrize(
    ("words", "what"),
    [
        ("--set sensor.model=axia80", "robot.KEY"), ("--payload-center 1,2", "X,Y,Z"),
        ("--arm ur20", "ur10e"), ("--payload-center 0,0,nan", "at most 1000"),
        ("--payload-center 0,0,2000", "at most 1000"), ("--asked 20", "--beside"),
        ("--beside nowhere", "nowhere"), ("--beside . --overwrite --out .", "--out '.' is read itself"),
        ("--to 0.0001", "fewer than two"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_one_message(log, polish_sim, words, what):
    assert_refused(polish_sim("compare", log, "--out", "out", *words.split()), what)
