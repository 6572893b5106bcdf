"""Plant a robot, move it, identify it: simulated, and from its log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from polish_sim.config import RobotConfig
from polish_sim.errors import IdentificationError
from polish_sim.identification.arm import LoggedRobot, build_arm, play_states
from polish_sim.identification.identify import Identification, identify_from_log, run_identification
from polish_sim.identification.log_file import read_robot_log, spline_states
from polish_sim.identification.regressor import FULL, States
from polish_sim.identification.settings import SCENARIO, STEP_S, IdentifySettings
from polish_sim.scenario_file import override
from tests.identification.known import SIGMA, joined, known_robot, played, write_log

IDEAL = RobotConfig(arm="ideal")
HELD_BY_LINKS = ["robot.arm=ur5e", "robot.real.servo_side=link", "robot.real.kinematics=exact"]


@pytest.fixture(scope="module")
def identified() -> Identification:
    return run_identification(IdentifySettings(periods=1, iterations=15, robot=IDEAL, payload=1.0, seed=1))


def test_a_motion_that_was_not_fitted_is_predicted_far_better_than_by_the_drawing(
    identified: Identification,
) -> None:
    figures = identified.figures
    assert figures["nrms_heldout_mean"] <= 0.0013
    assert figures["nrms_heldout_drawing_mean"] > 5.0 * figures["nrms_heldout_mean"]
    assert figures["nrms_heldout_consistent_mean"] <= 1.05 * figures["nrms_heldout_mean"]
    assert figures["physically_consistent"]
    assert figures["clearance_min_m"] >= 0.02


def test_errors_are_near_the_bound(identified: Identification) -> None:
    assert identified.figures["error_over_crb"] < 1.6
    assert identified.figures["interval_coverage"] > 0.8


def test_a_block_the_arm_carries_is_found_within_its_intervals(identified: Identification) -> None:
    assert identified.weighed is not None
    figures = identified.weighed.figures
    assert figures["payload_error_over_std"] < 2.0
    assert abs(figures["payload_mass_error_kg"]) < 0.01
    assert figures["payload_center_error_m"] < 0.003
    assert figures["payload_consistent"]


@pytest.mark.parametrize(("settings", "off"), [([], 1e-3), (HELD_BY_LINKS, 1e-2)])
def test_the_arm_at_rest_shows_its_weight_and_nothing_else(settings: list[str], off: float) -> None:
    arm = build_arm(FULL, override(SCENARIO, ["robot.arm=ideal", *settings]))
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
    log = read_robot_log(write_log(folder / "log.csv", KNOWN.model, states, SIGMA, PLANTED))
    return identify_from_log(ROBOT, log, spline_states(log))


def test_a_planted_robot_is_recovered_from_its_log(tmp_path: Path) -> None:
    found = _identified(tmp_path, MOTION)
    off = (found.found.theta - KNOWN.base.combination @ PLANTED) / found.found.std
    # The rms of fifty-eight errors in their own standard deviations, plus what splines smooth away.
    assert float(np.sqrt(np.mean(off**2))) < 1.4
    # What is left of the part that was held out is its noise.
    assert max(found.figures["residual_over_noise_heldout"]) < 1.1


def test_a_joint_that_rests_at_the_end_of_the_log_is_named(tmp_path: Path) -> None:
    end = played(KNOWN.with_still(slice(2, 3)), 1)
    with pytest.raises(IdentificationError, match="no usable torque of elbow_joint"):
        _identified(tmp_path, joined(MOTION, end))
