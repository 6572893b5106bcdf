"""Arms that are not as their table says: planted, found, and what is left of the error."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.dual.calibrate_bases import HIGH, LOW, ArmTrial, run_arm_calibration
from polish_sim.dual.calibration.arm import TrackedArm, fit_arm, fit_placement
from polish_sim.errors import CalibrationError
from polish_sim.motion import link_frames
from polish_sim.motion.kinematics import NOMINAL, table_slopes
from polish_sim.spatial import from_pose

RNG = np.random.default_rng(2)
Q = RNG.uniform(LOW, HIGH, (40, 6))
POINT = np.array([0.01, -0.02, 0.1])


def test_slopes_of_the_table_are_those_of_differences() -> None:
    table, step = NOMINAL + 0.01 * RNG.standard_normal((4, 6)), 1e-6

    def tips(table: np.ndarray) -> np.ndarray:
        T = link_frames(Q, table)[:, 6]
        return T[:, :3, :3] @ POINT + T[:, :3, 3]

    slopes = table_slopes(link_frames(Q, table), tips(table))
    for k, row in enumerate(step * np.eye(24).reshape(24, 4, 6)):
        np.testing.assert_allclose(slopes[:, :, k], (tips(table + row) - tips(table - row)) / (2.0 * step), atol=1e-9)


def test_exact_measurements_give_an_arm_that_predicts_exactly() -> None:
    table, T = NOMINAL + 5e-4 * RNG.standard_normal((4, 6)), from_pose([2.0, 1.0, -0.5, 0.1, 0.2, 1.0])

    def seen(q: np.ndarray) -> np.ndarray:
        frames = T @ link_frames(q, table)[:, 6]
        return frames[:, :3, :3] @ POINT + frames[:, :3, 3]

    found = fit_arm(TrackedArm(Q, seen(Q)), 0.0)
    others = RNG.uniform(LOW, HIGH, (100, 6))
    np.testing.assert_allclose(found.target_at(others), seen(others), atol=1e-8)
    assert np.abs(fit_placement(TrackedArm(Q, seen(Q))).residuals).max() > 1e-4


@pytest.mark.parametrize("seed", range(3))
def test_half_a_millimetre_in_the_table_comes_back_below_a_seventh(seed: int) -> None:
    figures = run_arm_calibration(ArmTrial(seed=seed)).figures
    assert figures["relative_error_nominal_m"] > 5e-4
    assert figures["relative_error_m"] <= 1.5e-4


def test_arms_as_their_table_says_are_not_made_worse() -> None:
    figures = run_arm_calibration(ArmTrial(tolerance=ArmTrial().tolerance._replace(length=1e-9, angle=1e-9))).figures
    assert figures["relative_error_m"] == pytest.approx(figures["relative_error_nominal_m"], rel=1e-3)


def test_too_few_poses_are_refused() -> None:
    with pytest.raises(CalibrationError, match="19 poses cannot tell"):
        fit_placement(TrackedArm(Q[:19], np.zeros((19, 3))))
