"""Plant a tool's axes, move along them, recover them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.dual.calibration.tool import orientation_from_moves, orientation_from_three_points, tip_positions_flange
from polish_sim.errors import CalibrationError
from polish_sim.spatial import transform

R_FLANGE_TOOL = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
TIP, SIGMA = np.array([0.03, -0.02, 0.21]), 5e-5
MOVES = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1]])


def test_exact_moves_give_the_axes() -> None:
    for moves in (MOVES, np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [-0.04, 0.0, 0.08]])):
        R = orientation_from_three_points(moves @ R_FLANGE_TOOL.T, SIGMA).R_flange_tool
        np.testing.assert_allclose(R, R_FLANGE_TOOL, atol=1e-12)
    many = np.concatenate([MOVES, [[0.0, 0.1, 0.0], [0.05, 0.05, 0.0]]])
    np.testing.assert_allclose(
        orientation_from_moves(many @ R_FLANGE_TOOL.T, many, SIGMA).R_flange_tool, R_FLANGE_TOOL, atol=1e-12
    )


def test_positions_come_from_flange_poses_that_also_turned_a_little() -> None:
    turns = Rotation.from_rotvec([[0.5, 0.2, 1.0], [0.51, 0.2, 1.0], [0.5, 0.22, 1.01]]).as_matrix()
    tips = (MOVES @ R_FLANGE_TOOL.T) @ turns[0].T + [0.4, 0.2, 0.1]
    T_base_flange = transform(turns, tips - turns @ TIP)
    np.testing.assert_allclose(tip_positions_flange(T_base_flange, TIP), MOVES @ R_FLANGE_TOOL.T, atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.04])
def test_noise_of_a_twentieth_millimetre_is_a_twentyfifth_degree_per_axis_and_so_stated(tilt: float) -> None:
    rng, moves = np.random.default_rng(1), MOVES + np.array([[0.0], [0.0], [1.0]]) * [tilt, 0.0, 0.0]
    errors = []
    for _ in range(3000):
        points = moves @ R_FLANGE_TOOL.T + SIGMA * rng.standard_normal((3, 3))
        found = orientation_from_three_points(points, SIGMA)
        errors.append(Rotation.from_matrix(R_FLANGE_TOOL.T @ found.R_flange_tool).as_rotvec())
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(rms, np.sqrt(np.diag(found.covariance)), rtol=0.05)
    np.testing.assert_allclose(np.cov(np.array(errors).T), found.covariance, atol=0.06 * found.covariance.max())
    if tilt == 0.0:
        assert np.degrees(rms.max()) <= 0.045


def test_more_moves_tell_more_and_their_covariance_is_right() -> None:
    rng = np.random.default_rng(2)
    many = np.concatenate([MOVES, [[0.0, 0.1, 0.0], [-0.1, 0.0, 0.0], [0.0, -0.1, 0.0]]])
    errors = []
    for _ in range(2000):
        found = orientation_from_moves(many @ R_FLANGE_TOOL.T + SIGMA * rng.standard_normal((6, 3)), many, SIGMA)
        errors.append(Rotation.from_matrix(R_FLANGE_TOOL.T @ found.R_flange_tool).as_rotvec())
    np.testing.assert_allclose(np.cov(np.array(errors).T), found.covariance, atol=0.08 * found.covariance.max())
    three = orientation_from_three_points(MOVES @ R_FLANGE_TOOL.T, SIGMA)
    assert np.trace(found.covariance) < np.trace(three.covariance)


@pytest.mark.parametrize(
    ("moves", "said"),
    [
        (np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.0, 0.0, 0.1]]), "too short to tell a direction"),
        (np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.005]]), "nearly parallel"),
    ],
)
def test_moves_that_cannot_tell_are_refused(moves: np.ndarray, said: str) -> None:
    with pytest.raises(CalibrationError, match=said):
        orientation_from_three_points(moves, SIGMA)
