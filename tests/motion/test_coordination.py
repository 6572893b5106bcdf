"""Two arms on one hub: the chain closes, the rim is round, the time law rests at both ends."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.dual.coordination import (
    Chain2,
    chain_residual,
    choose_spin,
    follower_flange,
    limit_margin,
    master_flange,
    plan_coordinated,
    rest_to_rest,
    spun,
)
from polish_sim.dual.rim import fit_closed_spline
from polish_sim.errors import ReachError, SmoothingError
from polish_sim.spatial import from_pose, rotation_to_axis, transform

RADIUS = 0.2
CHAIN = Chain2(
    from_pose([-1.15, 0.0, 0.0, 0.0, 0.0, np.pi]),
    from_pose([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]),
    from_pose([0.0, 0.0, 0.05, 0.0, 0.0, 0.3]),
    from_pose([0.0, 0.0, 0.18, 0.02, -0.01, 0.4]),
)
Q_MASTER, Q_FOLLOWER = np.array([0.2, -1.7, 1.9, -1.7, -1.5, 0.0]), np.array([-0.2, -1.6, 1.8, -1.8, -1.6, 0.0])


def rim(radius: float, count: int = 12) -> np.ndarray:
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def test_twelve_points_of_a_rim_give_a_circle_to_a_third_of_a_micrometre() -> None:
    spline = fit_closed_spline(rim(RADIUS))
    u = np.linspace(0.0, spline.length, 4001)
    assert np.abs(np.linalg.norm(spline(u), axis=1) - RADIUS).max() <= 3.2e-7
    chord_middle = 0.5 * (rim(RADIUS)[0] + rim(RADIUS)[1])
    assert RADIUS - np.linalg.norm(chord_middle) == pytest.approx(6.8e-3, abs=1e-4)


@pytest.mark.parametrize("derivative", range(5))
def test_the_rim_is_smooth_to_its_fourth_derivative_also_where_it_closes(derivative: int) -> None:
    spline = fit_closed_spline(rim(RADIUS) + np.random.default_rng(1).normal(0.0, 0.01, (12, 3)))
    knots = np.unique(spline.curve.t[5:-5])
    before, behind = spline(knots - 1e-9, derivative), spline(knots + 1e-9, derivative)
    scale = np.abs(spline(np.linspace(0.0, spline.length, 500), derivative)).max()
    np.testing.assert_allclose(before, behind, atol=1e-5 * scale)


def test_points_of_no_rim_are_refused() -> None:
    with pytest.raises(SmoothingError, match="needs 6 points"):
        fit_closed_spline(rim(RADIUS, 5))
    points = rim(RADIUS)
    points[4] = points[3]
    with pytest.raises(SmoothingError, match="points 4 and 5 are in one place"):
        fit_closed_spline(points)


def test_the_time_law_rests_at_both_ends() -> None:
    law = rest_to_rest(np.array([0.0, 0.5, 1.0]))
    np.testing.assert_allclose(law.share, [0.0, 0.5, 1.0], atol=1e-15)
    np.testing.assert_allclose(law.speed, [0.0, 15.0 / 8.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(law.acceleration, 0.0, atol=1e-15)
    x = np.linspace(0.01, 0.99, 50)
    np.testing.assert_allclose(
        (rest_to_rest(x + 1e-6).share - rest_to_rest(x - 1e-6).share) / 2e-6, rest_to_rest(x).speed, atol=1e-8
    )
    np.testing.assert_allclose(
        (rest_to_rest(x + 1e-6).speed - rest_to_rest(x - 1e-6).speed) / 2e-6, rest_to_rest(x).acceleration, atol=1e-7
    )


def motion(count: int = 60, radius: float = 0.08) -> tuple[np.ndarray, np.ndarray]:
    """The hub moves along the master's y with constant orientation; the tool goes once round its face."""
    share = rest_to_rest(np.linspace(0.0, 1.0, count)).share
    spline = fit_closed_spline(rim(radius))
    places = np.array([-0.55, -0.1, 0.45]) + np.outer(np.linspace(0.0, 0.1, count), [0.0, 1.0, 0.0])
    # The hub's face looks towards the follower, along -x of the master.
    R_master_work = rotation_to_axis(np.array([[-1.0, 0.0, 0.0]]), np.array([0.0, 1.0, 0.0]))[0]
    R_work_tool = np.tile(np.diag([1.0, -1.0, -1.0]), (count, 1, 1))
    points = spline(spline.length * share)
    return transform(np.tile(R_master_work, (count, 1, 1)), places), transform(R_work_tool, points)


def test_the_chain_of_the_planned_joints_closes_to_a_nanometre() -> None:
    T_master_work, T_work_tool = motion()
    spin = choose_spin(CHAIN, T_master_work, T_work_tool, Q_FOLLOWER)
    plan = plan_coordinated(CHAIN, T_master_work, T_work_tool, (Q_MASTER, Q_FOLLOWER), spin)
    assert plan.residual <= 1e-9
    assert np.abs(np.diff(plan.q_master, axis=0)).max() < 0.1
    assert np.abs(np.diff(plan.q_follower, axis=0)).max() < 0.2


def test_the_chosen_spin_is_no_worse_than_others() -> None:
    T_master_work, T_work_tool = motion(40)
    chosen = choose_spin(CHAIN, T_master_work, T_work_tool, Q_FOLLOWER)

    def least(spin: float) -> float:
        try:
            near = (Q_MASTER, Q_FOLLOWER)
            return plan_coordinated(CHAIN, T_master_work, T_work_tool, near, spin).least_singular
        except ReachError:
            return 0.0

    assert least(chosen) >= max(least(spin) for spin in np.linspace(0.0, 5.5, 7)) - 0.02


def test_a_wrist_near_its_limit_is_turned_back() -> None:
    T_master_work, T_work_tool = motion(40)
    near = Q_FOLLOWER + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.9 * np.pi])
    spin = choose_spin(CHAIN, T_master_work, T_work_tool, near)

    def margin(spin: float) -> float:
        return limit_margin(plan_coordinated(CHAIN, T_master_work, T_work_tool, (Q_MASTER, near), spin).q_follower)

    # What is left is the elbow, which no spin moves.
    elbow = plan_coordinated(CHAIN, T_master_work, T_work_tool, (Q_MASTER, near), spin).q_follower[:, 2]
    assert margin(spin) == pytest.approx(np.pi - np.abs(elbow).max())
    assert min(margin(turn) for turn in np.linspace(0.0, 6.0, 9)) < 0.3 * np.pi


def test_the_tool_axis_is_the_same_whatever_the_spin() -> None:
    T = motion(5)[1]
    np.testing.assert_allclose(spun(T, 1.3)[:, :3, 2:], T[:, :3, 2:], atol=1e-15)


def test_a_wrong_chain_shows_as_it_is() -> None:
    T_master_work, T_work_tool = motion(5)
    first, second = master_flange(CHAIN, T_master_work), follower_flange(CHAIN, T_master_work, T_work_tool)
    moved = CHAIN._replace(T_flange_tool=CHAIN.T_flange_tool @ from_pose([0.0, 0.0, 1e-3, 0.0, 2e-3, 0.0]))
    np.testing.assert_allclose(chain_residual(CHAIN, first, second, T_work_tool), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        chain_residual(moved, first, second, T_work_tool), np.tile([0, 0, 1e-3, 0, 2e-3, 0], (5, 1)), atol=1e-12
    )


def test_turning_the_world_changes_nothing() -> None:
    T_master_work, T_work_tool = motion(5)
    turn = transform(Rotation.from_euler("z", 0.5).as_matrix(), np.zeros(3))
    turned = CHAIN._replace(T_master_follower=turn @ CHAIN.T_master_follower)
    np.testing.assert_allclose(
        follower_flange(turned, turn @ T_master_work, T_work_tool),
        follower_flange(CHAIN, T_master_work, T_work_tool),
        atol=1e-12,
    )


def test_a_hub_out_of_reach_names_the_arm() -> None:
    T_master_work, T_work_tool = motion(5)
    away = transform(np.eye(3), np.array([0.0, 0.0, 2.0])) @ T_master_work
    with pytest.raises(ReachError, match="the master cannot bring its flange to point 1 of 5"):
        plan_coordinated(CHAIN, away, T_work_tool, (Q_MASTER, Q_FOLLOWER))
    far = CHAIN._replace(T_master_follower=from_pose([-3.0, 0.0, 0.0, 0.0, 0.0, np.pi]))
    with pytest.raises(ReachError, match="the follower cannot"):
        choose_spin(far, T_master_work, T_work_tool, Q_FOLLOWER)
