"""Two arms on one hub: the chain of their joints closes, a wrong one shows as it is, an arm out of reach is named."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.dual.chain import ClosedChain, follow_joints, limit_margin
from polish_sim.errors import ReachError
from polish_sim.motion import forward
from polish_sim.spatial import from_pose, rotation_to_axis, transform

CHAIN = ClosedChain(
    from_pose([-1.15, 0.0, 0.0, 0.0, 0.0, np.pi]),
    from_pose([0.0, 0.0, 0.1, 0.0, 0.0, 0.0]),
    from_pose([0.0, 0.0, 0.05, 0.0, 0.0, 0.3]),
    from_pose([0.0, 0.0, 0.18, 0.02, -0.01, 0.4]),
)
Q_MASTER, Q_FOLLOWER = np.array([0.2, -1.7, 1.9, -1.7, -1.5, 0.0]), np.array([-0.2, -1.6, 1.8, -1.8, -1.6, 0.0])


def motion(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The hub moves along the master's y with constant orientation; the tool goes once round its face."""
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    points = 0.08 * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)
    places = np.array([-0.55, -0.1, 0.45]) + np.outer(np.linspace(0.0, 0.1, count), [0.0, 1.0, 0.0])
    # The hub's face looks towards the follower, along -x of the master.
    R_master_work = rotation_to_axis(np.array([[-1.0, 0.0, 0.0]]), np.array([0.0, 1.0, 0.0]))[0]
    spin = Rotation.from_euler("z", 1.5).as_matrix()
    R_work_tool = np.tile(np.diag([1.0, -1.0, -1.0]) @ spin, (count, 1, 1))
    return transform(np.tile(R_master_work, (count, 1, 1)), places), transform(R_work_tool, points)


def test_the_chain_of_the_followed_joints_closes_to_a_nanometre() -> None:
    T_master_work, T_work_tool = motion(60)
    q_master = follow_joints(CHAIN.master_flange(T_master_work), Q_MASTER, "master")
    q_follower = follow_joints(CHAIN.follower_flange(T_master_work, T_work_tool), Q_FOLLOWER, "follower")
    assert np.abs(CHAIN.residual(forward(q_master), forward(q_follower), T_work_tool)).max() <= 1e-9
    assert np.abs(np.diff(q_master, axis=0)).max() < 0.1
    assert np.abs(np.diff(q_follower, axis=0)).max() < 0.25
    assert min(limit_margin(q_master), limit_margin(q_follower)) > 0.0


def test_a_wrong_chain_shows_as_it_is() -> None:
    T_master_work, T_work_tool = motion(5)
    first, second = CHAIN.master_flange(T_master_work), CHAIN.follower_flange(T_master_work, T_work_tool)
    moved = CHAIN._replace(T_flange_tool=CHAIN.T_flange_tool @ from_pose([0.0, 0.0, 1e-3, 0.0, 2e-3, 0.0]))
    np.testing.assert_allclose(CHAIN.residual(first, second, T_work_tool), 0.0, atol=1e-12)
    off = moved.residual(first, second, T_work_tool)
    np.testing.assert_allclose(off, np.tile([0, 0, 1e-3, 0, 2e-3, 0], (5, 1)), atol=1e-12)


def test_turning_the_world_changes_nothing() -> None:
    T_master_work, T_work_tool = motion(5)
    turn = transform(Rotation.from_euler("z", 0.5).as_matrix(), np.zeros(3))
    turned = CHAIN._replace(T_master_follower=turn @ CHAIN.T_master_follower)
    np.testing.assert_allclose(
        turned.follower_flange(turn @ T_master_work, T_work_tool),
        CHAIN.follower_flange(T_master_work, T_work_tool),
        atol=1e-12,
    )


def test_a_hub_out_of_reach_names_the_arm() -> None:
    T_master_work, T_work_tool = motion(5)
    away = transform(np.eye(3), np.array([0.0, 0.0, 2.0])) @ T_master_work
    with pytest.raises(ReachError, match="the master cannot bring its flange to point 1 of 5"):
        follow_joints(CHAIN.master_flange(away), Q_MASTER, "master")
    far = CHAIN._replace(T_master_follower=from_pose([-3.0, 0.0, 0.0, 0.0, 0.0, np.pi]))
    with pytest.raises(ReachError, match="the follower cannot"):
        follow_joints(far.follower_flange(T_master_work, T_work_tool), Q_FOLLOWER, "follower")
