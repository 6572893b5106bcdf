"""The simulated arm is identified from its own motion, small: one period, a short search."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.identification.arm import STEP_S, build_arm, play_states
from polish_sim.identification.identify import Identification, run_identification
from polish_sim.identification.regressor import FULL, States
from polish_sim.identification.settings import IdentifySettings


@pytest.fixture(scope="module")
def identified() -> Identification:
    return run_identification(
        IdentifySettings(periods=1, iterations=15, poses=6, method="stepwise", payload=1.0, seed=1)
    )


def test_a_motion_that_was_not_fitted_is_predicted_far_better_than_by_the_drawing(identified: Identification) -> None:
    figures = identified.figures
    assert figures["nrms_heldout_mean"] <= 0.0013
    assert figures["nrms_heldout_drawing_mean"] > 5.0 * figures["nrms_heldout_mean"]
    assert figures["nrms_heldout_consistent_mean"] <= 1.05 * figures["nrms_heldout_mean"]
    assert figures["physically_consistent"]


def test_errors_are_near_the_bound_and_the_steps_near_the_joint_fit(identified: Identification) -> None:
    assert identified.figures["error_over_crb"] < 1.6
    assert identified.figures["interval_coverage"] > 0.8
    assert identified.figures["stepwise_over_joint"] == pytest.approx(1.0, abs=0.01)
    assert identified.figures["first_step_parameters"] == 22


def test_a_block_the_arm_carries_is_found_within_its_intervals(identified: Identification) -> None:
    assert identified.weighed is not None
    figures = identified.weighed.figures
    assert figures["payload_error_over_std"] < 2.0
    assert abs(figures["payload_mass_error_kg"]) < 0.01
    assert figures["payload_center_error_m"] < 0.003
    assert figures["payload_consistent"]


def test_the_exciting_motion_keeps_clear_of_everything(identified: Identification) -> None:
    assert identified.figures["clearance_min_m"] >= 0.02


def test_the_first_axes_move_first_and_their_step_is_carried_into_the_second() -> None:
    figures = run_identification(IdentifySettings(periods=1, iterations=5, method="stepwise-axes", seed=2)).figures
    assert figures["first_step_parameters"] == 25
    assert figures["stepwise_over_joint"] == pytest.approx(1.0, abs=0.01)
    assert figures["error_over_crb"] < 1.6


def test_the_arm_at_rest_shows_its_weight_and_nothing_else() -> None:
    arm = build_arm(FULL)
    pose = np.array([0.3, -1.2, 1.0, -0.8, 0.7, 0.2])
    q = np.tile(pose, (round(0.05 / STEP_S), 1))
    log = play_states(arm, States(q, 0.0 * q, 0.0 * q))
    weight = arm.truth.torque(States(pose[None], np.zeros((1, 6)), np.zeros((1, 6))), arm.truth.truth())
    np.testing.assert_allclose(log.torque[-1], weight[0], atol=1e-3)
