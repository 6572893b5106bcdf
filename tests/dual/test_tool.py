"""Plant a tool, touch a point and move along its axes, recover tip and axes; read the touches from a file."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.dual.arms import lone_arms
from polish_sim.dual.calibrate import Q_NEAR, TcpTrial, run_tcp_calibration
from polish_sim.dual.calibration import tool, tool_checks
from polish_sim.errors import CalibrationError
from polish_sim.spatial import transform

TIP, POINT = np.array([0.03, -0.02, 0.21]), np.array([-0.4, 0.1, 0.3])
SIGMA = 5e-5


def touches(R: Array, errors: Array | float = 0.0) -> Array:
    return transform(R, POINT - R @ TIP + errors)


def planned(count: int = 10, cone: float = 45.0) -> Array:
    return tool_checks.plan_touch_orientations(count, np.radians(cone))


@pytest.mark.parametrize("count", [4, 10])
def test_exact_touches_give_the_tip_to_a_picometre(count):
    for R in (planned(count), Rotation.random(count, random_state=count).as_matrix()):
        found = tool.fit_tool_point(touches(R))
        np.testing.assert_allclose(found.point, TIP, atol=1e-12)
        np.testing.assert_allclose(found.touched, POINT, atol=1e-12)


def test_over_many_draws_the_error_is_the_cramer_rao_bound_and_the_stated_covariance():
    """The mean square of 1500 draws gives the rms to 1.1%."""
    rng, R = np.random.default_rng(1), planned()
    found = [tool.fit_tool_point(touches(R, SIGMA * rng.standard_normal((10, 3)))) for _ in range(1500)]
    errors = np.array([np.concatenate([one.point - TIP, one.touched - POINT]) for one in found])
    rms = float(np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, axis=1))))
    assert 0.98 < rms / tool_checks.point_error_bound(R, SIGMA) <= 1.02
    assert rms <= 3.3e-5
    stated = tool.fit_tool_point(touches(R), SIGMA).covariance
    scale = np.sqrt(np.diag(stated))
    np.testing.assert_allclose((np.cov(errors.T) - stated) / np.outer(scale, scale), 0.0, atol=0.08)
    assert np.mean([one.noise for one in found]) == pytest.approx(SIGMA, rel=0.03)


@pytest.mark.parametrize("cone", [30.0, 45.0, 62.0, 90.0])
def test_the_planner_reaches_the_best_a_cone_allows(cone):
    for count in range(4, 21):
        best = SIGMA * np.sqrt((2.0 + 1.0 / np.sin(np.radians(cone)) ** 2) / count)
        assert tool_checks.point_error_bound(planned(count, cone), SIGMA) == pytest.approx(best, rel=1e-9)
        # From 62 deg on that is within 5% of the best there is.
        assert cone < 62.0 or best <= 1.05 * SIGMA * np.sqrt(3.0 / count)


def spin(count: int) -> Array:
    return Rotation.from_euler("z", np.linspace(0.0, 3.0, count)[:, None]).as_matrix()


def coning(count: int, sense: float) -> Array:
    """Tilted by 45 deg towards azimuth 2 pi k / n about a line in the flange's plane, then spun by it."""
    azimuth = 2.0 * np.pi * np.arange(count) / count
    tilt = np.pi / 4.0 * np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(count)])
    turned = Rotation.from_rotvec(tilt) * Rotation.from_euler("z", sense * azimuth[:, None])
    return np.asarray(turned.as_matrix())


@pytest.mark.parametrize(
    ("R", "said"),
    [
        (planned(3 + 1)[:3], "3 touches cannot separate"),
        (spin(8), r"\(0.00, 0.00, 1.00\) .*the same way"),
        (coning(8, 1.0), "points the same way"),
        (np.tile(np.eye(3), (6, 1, 1)), "stands nearly the same in all 6 touches"),
    ],
)
def test_orientations_that_cannot_tell_are_refused(R, said):
    with pytest.raises(CalibrationError, match=said):
        tool.fit_tool_point(touches(R))
    # Spun the other way the cone shows it.
    assert tool_checks.orientation_spread(coning(8, -1.0))[0][0] > 0.3
    np.testing.assert_allclose(tool.fit_tool_point(touches(coning(8, -1.0))).point, TIP, atol=1e-12)


@pytest.mark.parametrize("wrong", [[], *([k] for k in range(10)), [2, 7]])
def test_touches_two_millimetres_off_are_named_and_left_out_and_no_others(wrong):
    errors = SIGMA * np.random.default_rng(sum(wrong[:1])).standard_normal((10, 3))
    errors[wrong] += 2e-3 * np.array([0.6, -0.64, 0.48])
    found = tool.fit_tool_point_without_outliers(touches(planned(), errors))
    assert np.flatnonzero(~found.used).tolist() == wrong
    assert np.linalg.norm(found.point - TIP) < 1e-4


R_FLANGE_TOOL = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
MOVES = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1]])


def test_exact_moves_give_the_axes_also_by_flange_poses_that_turned_a_little():
    turns = Rotation.from_rotvec([[0.5, 0.2, 1.0], [0.51, 0.2, 1.0], [0.5, 0.22, 1.01]]).as_matrix()
    tips = (MOVES @ R_FLANGE_TOOL.T) @ turns[0].T + [0.4, 0.2, 0.1]
    T_base_flange = transform(turns, tips - turns @ TIP)
    seen, slanted = (
        tool.tip_positions_flange(T_base_flange, TIP),
        np.array([[1.0, 0, 0], [0, 1, 0], [-0.4, 0, 0.8]]),
    )
    np.testing.assert_allclose(seen, MOVES @ R_FLANGE_TOOL.T, atol=1e-12)
    for points in (seen, slanted @ seen):
        R = tool.orientation_from_three_points(points, SIGMA).R_flange_tool
        np.testing.assert_allclose(R, R_FLANGE_TOOL, atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.04])
def test_noise_of_a_twentieth_millimetre_is_a_twentyfifth_degree_per_axis_and_so_stated(tilt):
    rng, moves = np.random.default_rng(1), MOVES + np.array([[0.0], [0.0], [1.0]]) * [tilt, 0.0, 0.0]
    errors = []
    for _ in range(1500):
        points = moves @ R_FLANGE_TOOL.T + SIGMA * rng.standard_normal((3, 3))
        found = tool.orientation_from_three_points(points, SIGMA)
        errors.append(Rotation.from_matrix(R_FLANGE_TOOL.T @ found.R_flange_tool).as_rotvec())
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(rms, np.sqrt(np.diag(found.covariance)), rtol=0.05)
    seen = np.cov(np.array(errors).T)
    np.testing.assert_allclose(seen, found.covariance, atol=0.06 * found.covariance.max())
    if tilt == 0.0:
        assert np.degrees(rms.max()) <= 0.045


@pytest.mark.parametrize(
    ("moves", "said"),
    [
        (np.array([[0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.0, 0.0, 0.1]]), "too short"),
        (np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.005]]), "nearly parallel"),
    ],
)
def test_moves_that_cannot_tell_are_refused(moves, said):
    with pytest.raises(CalibrationError, match=said):
        tool.orientation_from_three_points(moves, SIGMA)


def test_metres_and_rotation_vectors_as_a_ur_shows_them(tmp_path):
    rows = ["X_m, y_m, z_m, rx_rad, ry_rad, rz_rad"]
    for T in touches(planned()):
        values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_rotvec()]
        rows.append(", ".join(f"{value:.10f}" for value in values))
    file = tmp_path / "ur.csv"
    file.write_text("\n".join(rows), encoding="utf-8")
    found = tool.fit_tool_frame(tool.read_tool_measurements(file))
    np.testing.assert_allclose(found.tip.point, TIP, atol=1e-8)
    assert found.orientation is None


@pytest.mark.parametrize("seed", range(2))
def test_a_tip_touched_with_an_arm_that_winds_up_is_as_good_as_its_residuals_say(seed):
    read = lone_arms(seed, Q_NEAR).reading("follower", np.random.default_rng([seed, 18]))
    figures = run_tcp_calibration(TcpTrial(seed=seed, read=read)).figures
    assert figures["residual_rms_m"] > 1e-4
    assert figures["position_error_m"] < 3.0 * figures["position_std_m"]
    assert figures["bound_share"] < 1.0
