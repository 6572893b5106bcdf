"""Bases, arms and tools planted and recovered: from arcs, points, held poses and touches."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.calibration import matched_points
from polish_sim.calibration.arm import CATALOGUE, ArmEstimate, TrackedArm, fit_arm
from polish_sim.dual import calibrate
from polish_sim.dual.arms import lone_arms
from polish_sim.dual.calibration import tool
from polish_sim.dual.calibration.arm import held_out_rms
from polish_sim.dual.calibration.circle import base_from_circles, fit_circle
from polish_sim.errors import CalibrationError
from polish_sim.motion import forward, link_frames
from polish_sim.motion.kinematics import NOMINAL, table_slopes
from polish_sim.spatial import apply, from_pose, inverse, place_of, to_pose, transform

T_TRACKER_BASE = from_pose([2.5, -0.8, -0.4, 0.1, -0.2, 2.0])
TARGET, SIGMA = np.array([-0.03, 0.02, 0.05]), 3e-5
SECTORS = ((-60.0, 60.0), (-120.0, 0.0))
CLOUD = np.random.default_rng(8).uniform(-0.6, 0.6, (12, 3))
ON_LINE = np.arange(5.0)[:, None] * [1.0, 1.0, 0.0]
POINT = np.array([0.01, -0.02, 0.1])
TIP, TOUCHED = np.array([0.03, -0.02, 0.21]), np.array([-0.4, 0.1, 0.3])
TOUCH_M = 5e-5  # standard deviation of a touch [m]
R_FLANGE_TOOL = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
SPUN = Rotation.from_euler("z", np.linspace(0.0, 3.0, 8)[:, None])
MOVES = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.1]])


def arc(joint, count=200, offsets=None, sector=None):
    """Target seen by the tracker while one joint turns, angles rising; what encoders say plays no role."""
    q = np.tile(np.zeros(6) if offsets is None else offsets, (count, 1))
    q[:, joint] += np.radians(np.linspace(*(sector or SECTORS[joint]), count))
    return place_of(T_TRACKER_BASE @ forward(q), TARGET)


def step_from(true, T):
    """Displacement [m] and rotation [rad] from a frame to another, outer axes."""
    turn = Rotation.from_matrix(T[:3, :3] @ true[:3, :3].T).as_rotvec()
    return np.concatenate([T[:3, 3] - true[:3, 3], turn])


@pytest.mark.parametrize("most", [0.0, 0.2])
def test_exact_arcs_give_the_base_wherever_the_other_joints_stand(most):
    """Encoder offsets of the joints beyond: the target runs other circles about the same axes."""
    offsets = np.array([0.0, 0.0, *np.random.default_rng(3).uniform(-most, most, 4)])
    found = base_from_circles(fit_circle(arc(0, offsets=offsets)), fit_circle(arc(1, offsets=offsets)))
    np.testing.assert_allclose(found.T, T_TRACKER_BASE, atol=2e-12)
    assert found.gap < 1e-12


@cache
def swept(joint):
    rng = np.random.default_rng(joint)
    return [fit_circle(arc(joint) + SIGMA * rng.standard_normal((200, 3)), SIGMA) for _ in range(100)]


@pytest.mark.parametrize(("apart", "origin", "tilt"), [(5e-4, 2.1e-5, 1.1e-3), (0.0, 1.7e-5, 1e-3)])
def test_the_base_is_as_good_as_asked_and_as_stated(apart, origin, tilt):
    """Of axes that miss each other and of those that meet, with noise, 100 times."""
    aside = (replace(circle, center=circle.center + apart * T_TRACKER_BASE[:3, 0]) for circle in swept(1))
    found = [base_from_circles(*circles) for circles in zip(swept(0), aside, strict=True)]
    assert {base.meets for base in found} == {apart == 0.0}
    assert np.mean([base.gap for base in found]) == pytest.approx(apart, abs=6e-5)
    errors, covariance = np.array([step_from(T_TRACKER_BASE, base.T) for base in found]), found[0].covariance
    # Mahalanobis distances average to the number of unknowns.
    distance = np.einsum("na,ab,nb->n", errors, np.linalg.inv(covariance), errors)
    assert np.mean(distance) == pytest.approx(6.0, abs=0.8)
    assert np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, axis=1))) <= origin
    z_axes = np.array([base.T[:3, 2] for base in found])
    sine = np.linalg.norm(np.cross(z_axes, T_TRACKER_BASE[:3, 2]), axis=1)
    assert np.degrees(np.sqrt(np.mean(sine**2))) <= tilt


def test_exact_points_give_the_frame():
    for some in (CLOUD, CLOUD[:3]):
        found = matched_points.kabsch(apply(T_TRACKER_BASE, some), some)
        np.testing.assert_allclose(found, T_TRACKER_BASE, atol=1e-12)


def test_covariance_of_a_base_in_another_is_that_of_the_errors():
    rng = np.random.default_rng(10)
    T_b = from_pose([1.0, 1.5, -0.3, 0.0, 0.1, -1.0])
    root = [1e-5 * rng.standard_normal((6, 6)) for _ in range(2)]
    _, stated = matched_points.relative_frame(T_TRACKER_BASE, root[0] @ root[0].T, T_b, root[1] @ root[1].T)
    truth, errors = inverse(T_TRACKER_BASE) @ T_b, []
    for _ in range(2000):
        a = matched_points.moved_frame(T_TRACKER_BASE, root[0] @ rng.standard_normal(6))
        b = matched_points.moved_frame(T_b, root[1] @ rng.standard_normal(6))
        errors.append(step_from(truth, inverse(a) @ b))
    np.testing.assert_allclose(np.cov(np.array(errors).T), stated, atol=0.08 * stated.max())


def test_slopes_of_the_table_are_those_of_differences():
    rng, step = np.random.default_rng(2), 1e-6
    q = rng.uniform(calibrate.LOW, calibrate.HIGH, (40, 6))
    table = NOMINAL + 0.01 * rng.standard_normal((4, 6))

    def tips(table):
        return place_of(link_frames(q, table)[:, 6], POINT)

    slopes = table_slopes(link_frames(q, table), tips(table))
    for k, row in enumerate(step * np.eye(24).reshape(24, 4, 6)):
        slope = (tips(table + row) - tips(table - row)) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, :, k], slope, atol=1e-9)


def test_gears_that_wind_up_and_err_are_found_along_with_the_table():
    rng = np.random.default_rng(31)
    sizes = np.repeat([[3e-5] * 3 + [1.5e-4] * 4, [2e-4] * 3 + [2e-4] * 4], 3, axis=0)
    table, T = NOMINAL + 2e-4 * rng.standard_normal((4, 6)), from_pose([2.0, 1.0, -0.5, 0.1, 0.2, 1.0])
    gears = sizes * rng.uniform(0.5, 1.5, (6, 7))
    planted = ArmEstimate(table, T, POINT, np.zeros((0, 3)), np.zeros((6, 6)), gears)
    most = np.array([80.0, 80.0, 40.0, 8.0, 8.0, 8.0])
    q, others = (rng.uniform(calibrate.LOW, calibrate.HIGH, (count, 6)) for count in (80, 100))
    weight, other_weight = (rng.uniform(-most, most, (count, 6)) for count in (80, 100))
    found = fit_arm(TrackedArm(q, planted.target_at(q, weight), weight), 0.0)
    there = planted.target_at(others, other_weight)
    np.testing.assert_allclose(found.target_at(others, other_weight), there, atol=1e-8)
    rigid = fit_arm(TrackedArm(q, planted.target_at(q, weight)), 1e-4)
    assert np.abs(rigid.target_at(others) - there).max() > 1e-3
    # Loads a little beyond the second knee say next to nothing: the gear is taken to continue as before it.
    light = np.clip(weight, -1.01 * np.array(CATALOGUE.knee_2_nm), 1.01 * np.array(CATALOGUE.knee_2_nm))
    seen = planted.target_at(q, light) + 3e-5 * rng.standard_normal((80, 3))
    beyond = fit_arm(TrackedArm(q, seen, light), 3e-5).gears
    assert np.all(np.abs(beyond[:, 2] - beyond[:, 1]) < np.repeat([2e-5, 12e-5], 3))


def test_arms_as_their_table_says_are_not_made_worse_and_those_with_gears_are_found_with_them():
    exact = calibrate.ArmTrial().tolerance._replace(length=1e-9, angle=1e-9)
    figures = calibrate.run_arm_calibration(calibrate.ArmTrial(tolerance=exact)).figures
    assert figures["relative_error_m"] == pytest.approx(figures["relative_error_nominal_m"], rel=1e-3)
    # Wind-up by pose is no error of a table.
    trial = calibrate.ArmTrial(seed=1, gears=lone_arms(1, calibrate.Q_NEAR).gears)
    done = calibrate.run_arm_calibration(trial)
    figures = done.figures
    assert figures["relative_error_m"] < 1.3e-4
    assert figures["relative_error_m"] < 0.15 * figures["relative_error_nominal_m"]
    rigid = {robot: one._replace(weight=None) for robot, one in done.measured.items()}
    assert held_out_rms(rigid, figures["residual_rms_m"], trial.tolerance) > 3.0 * figures["heldout_rms_m"]


def test_bases_of_arms_with_gears_err_by_more_than_independent_noise_says_and_within_the_bound():
    shares, sigmas = [], []
    for seed in range(6):
        flanges = lone_arms(seed, calibrate.Q_NEAR).standing(np.random.default_rng([seed, 18]))
        figures = calibrate.run_base_calibration(calibrate.BaseTrial(seed=seed, flanges=flanges)).figures
        shares.append(figures["bound_share"])
        sigmas.append(figures["relative_origin_error_m"] / figures["relative_origin_std_m"])
    assert max(shares) < 1.0
    assert np.sqrt(np.mean(np.square(sigmas))) > 1.3


def touches(R, errors=0.0):
    return transform(R, TOUCHED - R @ TIP + errors)


def planned(count=10, cone=45.0):
    return tool.plan_touch_orientations(count, np.radians(cone))


@pytest.mark.parametrize("count", [4, 10])
def test_exact_touches_give_the_tip_to_a_picometre(count):
    for R in (planned(count), Rotation.random(count, random_state=count).as_matrix(), coning(count, -1.0)):
        assert tool.orientation_spread(R)[0][0] > 0.3
        found = tool.fit_tool_point(touches(R))
        np.testing.assert_allclose(found.point, TIP, atol=1e-12)
        np.testing.assert_allclose(found.touched, TOUCHED, atol=1e-12)


def test_over_many_draws_the_error_is_the_cramer_rao_bound_and_the_stated_covariance():
    """The mean square of 1500 draws gives the rms to 1.1%."""
    rng, R = np.random.default_rng(1), planned()
    found = [tool.fit_tool_point(touches(R, TOUCH_M * rng.standard_normal((10, 3)))) for _ in range(1500)]
    errors = np.array([np.concatenate([one.point - TIP, one.touched - TOUCHED]) for one in found])
    rms = float(np.sqrt(np.mean(np.sum(errors[:, :3] ** 2, axis=1))))
    assert 0.98 < rms / tool.point_error_bound(R, TOUCH_M) <= 1.02
    assert rms <= 3.3e-5
    stated = tool.fit_tool_point(touches(R), TOUCH_M).covariance
    scale = np.sqrt(np.diag(stated))
    np.testing.assert_allclose((np.cov(errors.T) - stated) / np.outer(scale, scale), 0.0, atol=0.08)
    assert np.mean([one.noise for one in found]) == pytest.approx(TOUCH_M, rel=0.03)


@pytest.mark.parametrize("cone", [30.0, 45.0, 62.0, 90.0])
def test_the_planner_reaches_the_best_a_cone_allows(cone):
    for count in range(4, 21):
        best = TOUCH_M * np.sqrt((2.0 + 1.0 / np.sin(np.radians(cone)) ** 2) / count)
        assert tool.point_error_bound(planned(count, cone), TOUCH_M) == pytest.approx(best, rel=1e-9)
        # From 62 deg on that is within 5% of the best there is.
        assert cone < 62.0 or best <= 1.05 * TOUCH_M * np.sqrt(3.0 / count)


def coning(count, sense):
    """Tilted by 45 deg towards azimuth 2 pi k / n about a line in the flange's plane, then spun by it."""
    azimuth = 2.0 * np.pi * np.arange(count) / count
    tilt = np.pi / 4.0 * np.column_stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(count)])
    turned = Rotation.from_rotvec(tilt) * Rotation.from_euler("z", sense * azimuth[:, None])
    return np.asarray(turned.as_matrix())


def base_of(first, second):
    base_from_circles(fit_circle(first), fit_circle(second))


def tip_of(R):
    tool.fit_tool_point(touches(R))


def axes_of(*moves):
    tool.orientation_from_three_points(np.array(moves), TOUCH_M)


@pytest.mark.parametrize(
    ("fit", "measured", "said"),
    [
        (base_of, (arc(0), arc(0)), "nearly parallel"), (base_of, (np.ones((9, 3)), arc(1)), "in one place"),
        (base_of, (arc(0)[:, [1, 0, 2]], arc(1)[:, [1, 0, 2]]), "left-handed"),
        (base_of, (arc(0), arc(1)[::-1]), "arc of axis 2 runs against"),
        (base_of, (arc(0), arc(3, sector=(-120.0, 0.0))), "axis 2 has a radius"),
        (base_of, (np.outer(np.arange(9.0), [1.0, 2.0, 3.0]), arc(1)), "on a line"),
        (base_of, (arc(0, sector=(0.0, 20.0)), arc(1)), "arc of 20 deg is too short"),
        (matched_points.check_spread, (ON_LINE,), "lie on a line"),
        (tip_of, (planned(4)[:3],), "3 touches cannot separate"), (tip_of, (coning(8, 1.0),), "the same way"),
        (tip_of, (SPUN.as_matrix(),), r"\(0.00, 0.00, 1.00\) .*the same way"),
        (tip_of, (np.tile(np.eye(3), (6, 1, 1)),), "stands nearly the same in all 6 touches"),
        (axes_of, ([0.0, 0.0, 0.0], [0.001, 0.0, 0.0], [0.0, 0.0, 0.1]), "too short"),
        (axes_of, ([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.005]), "nearly parallel"),
    ],
)  # fmt: skip
def test_measurements_that_cannot_tell_are_refused_with_the_reason(fit, measured, said):
    with pytest.raises(CalibrationError, match=said):
        fit(*measured)


@pytest.mark.parametrize("wrong", [[], *([k] for k in range(10)), [2, 7]])
def test_touches_two_millimetres_off_are_named_and_left_out_and_no_others(wrong):
    errors = TOUCH_M * np.random.default_rng(sum(wrong[:1])).standard_normal((10, 3))
    errors[wrong] += 2e-3 * np.array([0.6, -0.64, 0.48])
    found = tool.fit_tool_frame(tool.ToolMeasurements(touches(planned(), errors), np.empty((0, 4, 4)))).tip
    assert np.flatnonzero(~found.used).tolist() == wrong
    assert np.linalg.norm(found.point - TIP) < 1e-4


def test_exact_moves_give_the_axes_also_by_flange_poses_that_turned_a_little():
    turns = Rotation.from_rotvec([[0.5, 0.2, 1.0], [0.51, 0.2, 1.0], [0.5, 0.22, 1.01]]).as_matrix()
    tips = (MOVES @ R_FLANGE_TOOL.T) @ turns[0].T + [0.4, 0.2, 0.1]
    T_base_flange = transform(turns, tips - turns @ TIP)
    seen, slanted = tool.tip_positions_flange(T_base_flange, TIP), [[1.0, 0, 0], [0, 1, 0], [-0.4, 0, 0.8]]
    np.testing.assert_allclose(seen, MOVES @ R_FLANGE_TOOL.T, atol=1e-12)
    for points in (seen, np.array(slanted) @ seen):
        R = tool.orientation_from_three_points(points, TOUCH_M).R_flange_tool
        np.testing.assert_allclose(R, R_FLANGE_TOOL, atol=1e-12)


@pytest.mark.parametrize("tilt", [0.0, 0.04])
def test_noise_of_a_twentieth_millimetre_is_a_twentyfifth_degree_per_axis_and_so_stated(tilt):
    rng, moves = np.random.default_rng(1), MOVES + np.array([[0.0], [0.0], [1.0]]) * [tilt, 0.0, 0.0]
    points = moves @ R_FLANGE_TOOL.T + TOUCH_M * rng.standard_normal((1500, 3, 3))
    errors = Rotation.from_matrix([R_FLANGE_TOOL.T @ tool._axes_of(three) for three in points]).as_rotvec()
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    found = tool.orientation_from_three_points(points[-1], TOUCH_M)
    np.testing.assert_array_equal(found.R_flange_tool, tool._axes_of(points[-1]))
    np.testing.assert_allclose(rms, np.sqrt(np.diag(found.covariance)), rtol=0.05)
    np.testing.assert_allclose(np.cov(errors.T), found.covariance, atol=0.06 * found.covariance.max())
    if tilt == 0.0:
        assert np.degrees(rms.max()) <= 0.045


def test_metres_and_rotation_vectors_as_a_ur_shows_them(tmp_path):
    file, head = tmp_path / "ur.csv", "X_m, y_m, z_m, rx_rad, ry_rad, rz_rad"
    np.savetxt(file, [*map(to_pose, touches(planned()))], "%.10f", ", ", header=head, comments="")
    found = tool.fit_tool_frame(tool.read_tool_measurements(file))
    np.testing.assert_allclose(found.tip.point, TIP, atol=1e-8)
    assert found.orientation is None


@pytest.mark.parametrize("seed", range(2))
def test_a_tip_touched_with_an_arm_that_winds_up_is_as_good_as_its_residuals_say(seed):
    read = lone_arms(seed, calibrate.Q_NEAR).reading("follower", np.random.default_rng([seed, 18]))
    figures = calibrate.run_tcp_calibration(calibrate.TcpTrial(seed=seed, read=read)).figures
    assert figures["residual_rms_m"] > 1e-4
    assert figures["position_error_m"] < 3.0 * figures["position_std_m"]
    assert figures["bound_share"] < 1.0
