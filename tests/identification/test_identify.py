"""Plant a robot, move it, identify it: simulated, and from its log."""

import math
from pathlib import Path

import numpy as np
import pytest

from polish_sim.config import RobotConfig
from polish_sim.errors import ConfigError, IdentificationError
from polish_sim.exchange.robot_log import read_robot_recording
from polish_sim.identification import SCENARIO, STEP_S, IdentifySettings
from polish_sim.identification.arm import LoggedRobot, arm_of_table, build_simulated_arm, play_states
from polish_sim.identification.identify import Identification, identify_from_log, run_identification
from polish_sim.identification.log_file import RobotLog, log_of, spline_states
from polish_sim.identification.payload import weigh_from_logs
from polish_sim.identification.regressor import States
from polish_sim.motion.kinematics import used_arm
from polish_sim.scenario_file import override
from tests.identification.known import SIGMA, known_robot, played, write_log

IDEAL = RobotConfig(arm="ideal")
HELD_BY_LINKS = ["robot.arm=ur5e", "robot.real.servo_side=link", "robot.real.kinematics=exact"]


@pytest.fixture(scope="module")
def identified() -> Identification:
    return run_identification(IdentifySettings(periods=1, iterations=5, robot=IDEAL, payload=1.0, seed=1))


@pytest.mark.parametrize("wrong", [{"periods": 0}, {"periods": 2.5}, {"starts": 0}, {"payload": math.nan}])
def test_settings_out_of_their_range_are_refused_from_python_too(wrong):
    with pytest.raises(ConfigError, match=f"'{next(iter(wrong))}'"):
        IdentifySettings(**wrong)


def test_another_motion_is_predicted_far_better_than_by_the_drawing_and_a_block_is_weighed(identified):
    figures = identified.figures
    assert figures["nrms_heldout_mean"] <= 0.0013
    assert figures["nrms_heldout_drawing_mean"] > 5.0 * figures["nrms_heldout_mean"]
    assert figures["nrms_heldout_consistent_mean"] <= 1.05 * figures["nrms_heldout_mean"]
    assert figures["physically_consistent"]
    assert figures["clearance_min_m"] >= 0.02
    assert figures["error_over_crb"] < 1.6
    assert figures["interval_coverage"] > 0.8
    figures = identified.weighed.figures  # of the block it carries
    assert figures["payload_error_over_std"] < 2.0
    assert abs(figures["payload_mass_error_kg"]) < 0.01
    assert figures["payload_center_error_m"] < 0.003
    assert figures["payload_consistent"]


@pytest.mark.parametrize(("settings", "off"), [([], 1e-3), (HELD_BY_LINKS, 1e-2)])
def test_the_arm_at_rest_shows_its_weight_and_nothing_else(settings, off):
    arm = build_simulated_arm(override(SCENARIO, ["robot.arm=ideal", *settings]).robot)
    pose = np.array([0.3, -1.2, 1.0, -0.8, 0.7, 0.2])
    q = np.tile(pose, (round(0.05 / STEP_S), 1))
    log = play_states(arm, States(q, 0.0 * q, 0.0 * q))
    weight = arm.truth.torque(States(pose[None], np.zeros((1, 6)), np.zeros((1, 6))), arm.truth.truth())
    np.testing.assert_allclose(log.torque[-1], weight[0], atol=off)


KNOWN = known_robot()
ROBOT = LoggedRobot(KNOWN.model, np.zeros((6, 10)))
PLANTED = KNOWN.model.truth() * np.repeat(np.linspace(0.85, 1.2, 14), [10] * 6 + [3] * 8)
MOTION = played(KNOWN.motion, 2)


def _identified(folder: Path, states: States) -> Identification:
    file = write_log(folder / "log.csv", KNOWN.model, states, SIGMA, PLANTED)
    log = log_of(file, read_robot_recording(file, ("q_rad",)))
    return identify_from_log(ROBOT, log, spline_states(log))


def test_a_planted_robot_is_recovered_from_its_log_and_a_joint_that_rests_at_its_end_is_named(tmp_path):
    found = _identified(tmp_path, MOTION)
    off = (found.found.theta - KNOWN.base.combination @ PLANTED) / found.found.std
    # The rms of fifty-eight errors in their own standard deviations, plus what splines smooth away.
    assert float(np.sqrt(np.mean(off**2))) < 1.4
    # What is left of the part that was held out is its noise.
    assert max(found.figures["residual_over_noise_heldout"]) < 1.1
    rests = States(*(part.copy() for part in MOTION))
    end = slice(len(rests.q) // 2, None)
    rests.q[end, 2], rests.qd[end, 2], rests.qdd[end, 2] = rests.q[end, 2][0], 0.0, 0.0
    with pytest.raises(IdentificationError, match="no usable torque of elbow_joint"):
        _identified(tmp_path, rests)


BEFORE = used_arm()
GEARED = arm_of_table("ur10e")
SHARES = np.array([0.05, 0.06, 0.07, 0.04, 0.03, 0.05])
CARRIED = 2.8


def _geared_log(seed: int, carried: float = 0.0) -> tuple[RobotLog, States]:
    """A bare UR10e whose gears rub by load, root of speed and tooth, and torques with noise."""
    chain = GEARED.model.chain
    rubbing = np.array([[20.0, 9.0, 4.0, 0.5, 0.5, 0.3], SHARES, *[[0.2, 0.1, 0.1, 0.06, 0.1, 0.1]] * 4])
    links = chain.parameters.copy()
    links[5, 0] += carried
    planted = np.concatenate([links.ravel(), GEARED.model.truth()[60:-36], rubbing.ravel()])
    noise = np.random.default_rng(seed).normal(size=MOTION.q.shape) * SIGMA
    time = np.arange(len(MOTION.q)) * (20.0 / len(MOTION.q))
    return RobotLog(time, MOTION.q, GEARED.model.torque(MOTION, planted) + noise), MOTION


def test_gears_that_rub_by_load_are_found_and_what_they_carry_is_weighed_within_its_interval():
    assert used_arm() is BEFORE  # a make that is only looked at is not used
    found = identify_from_log(GEARED, *_geared_log(901))
    columns = [found.model.names.index(f"fl{joint}") for joint in range(1, 7)]
    at = np.searchsorted(found.base.columns, columns)
    assert np.all(np.abs(found.found.theta[at] - SHARES) < 3.5 * found.found.std[at])
    assert np.all(found.found.std[at[:3]] < 0.005)
    figures = found.figures
    assert np.all(np.array(figures["nrms_heldout"]) < np.array(figures["nrms_heldout_rigid"]))
    # What is left is the noise: nothing of the gears is.
    assert max(figures["residual_over_noise_heldout"]) < 1.1
    empty, loaded = _geared_log(902), _geared_log(903, CARRIED)
    figures = weigh_from_logs(GEARED, empty, loaded).figures
    assert abs(figures["payload_mass_kg"] - CARRIED) < 3.0 * figures["payload_mass_std_kg"]
