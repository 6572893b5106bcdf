"""Joint derivatives along segments and in time: closed forms of a planar arm, finite differences, the branch
kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.errors import ReachError
from polish_sim.motion import forward
from polish_sim.motion.kinematics import inverse_on_branch
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, build_arm
from polish_sim.motion.segment_rates import chain_rates, chebyshev_nodes, joint_motion

T_FLANGE_TOOL = np.eye(4)
T_FLANGE_TOOL[:3, :3] = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
T_FLANGE_TOOL[:3, 3] = [0.01, -0.02, 0.2]
HOME = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.2])


def one_segment(q: np.ndarray, step: np.ndarray, turn: float = 0.0, roll: float = 0.0) -> tuple[Chain, Arm]:
    """A segment that starts where the joints put the tool, seen from a work frame turned and moved in the
    base."""
    T_base_work = np.eye(4)
    T_base_work[:3, :3] = Rotation.from_rotvec([0.2, -0.1, 0.7]).as_matrix()
    T_base_work[:3, 3] = [0.4, 0.1, 0.05]
    T = np.linalg.inv(T_base_work) @ forward(q) @ T_FLANGE_TOOL
    axis = T[:3, 2]
    normal = np.cross(axis, [0.3, 0.2, 0.9])
    normal /= np.linalg.norm(normal)
    length = float(np.linalg.norm(step))
    direction = T_base_work[:3, :3].T @ step / (length or 1.0)
    chain = Chain(
        tips=np.array([T[:3, 3], T[:3, 3] + length * direction]),
        axes=np.array([axis, Rotation.from_rotvec(turn * normal).apply(axis)]),
        rotations=np.repeat(T[None, :3, :3], 2, axis=0),
        lengths=np.array([length]),
        directions=direction[None],
        angles=np.array([turn]),
        turn_axes=normal[None],
        rolls=np.array([roll]),
    )
    return chain, build_arm(T_base_work, T_FLANGE_TOOL, q)


def test_the_branch_s_solution_is_the_configuration_itself() -> None:
    rng = np.random.default_rng(0)
    out = np.empty(6)
    for q in rng.uniform(-2.0 * np.pi, 2.0 * np.pi, (2000, 6)):
        if min(abs(np.sin(q[2])), abs(np.sin(q[4]))) > 0.01:
            assert inverse_on_branch(forward(q), q + 1e-4 * rng.normal(size=6), out)
            np.testing.assert_allclose(forward(out), forward(q), atol=1e-12)
    np.testing.assert_allclose(out, q, atol=1e-9)


def test_out_of_reach_leaves_the_answer_alone() -> None:
    T, out = forward(HOME), np.full(6, 7.0)
    T[0, 3] += 2.0
    assert not inverse_on_branch(T, HOME, out)
    assert (out == 7.0).all()


@pytest.mark.parametrize(("turn", "roll"), [(0.0, 0.0), (0.3, 0.0), (0.4, -0.5)])
def test_each_derivative_is_that_of_the_one_before(turn: float, roll: float) -> None:
    chain, arm = one_segment(HOME, np.array([0.03, 0.05, -0.02]), turn, roll)
    u = np.linspace(0.0, 1.0, 2001)
    columns = [column[0] for column in chain_rates(chain, u, arm)]
    for lower, higher in pairwise(columns):
        slope = (lower[2:] - lower[:-2]) / (u[2:] - u[:-2])[:, None]
        np.testing.assert_allclose(higher[1:-1], slope, atol=2e-6 * np.abs(higher).max())


def test_the_elbow_of_a_planar_arm_follows_its_closed_form() -> None:
    """In the arm's plane, orientation kept: cos q3 is quadratic in u, and its derivatives give those of
    q3."""
    a2, a3 = 0.425, 0.3922
    along = np.array([np.cos(HOME[0]), np.sin(HOME[0]), 0.0])
    step = 0.08 * along + np.array([0.0, 0.0, 0.05])
    chain, arm = one_segment(HOME, step)
    rates = chain_rates(chain, chebyshev_nodes(9), arm)
    wrist = np.array([
        -a2 * np.cos(HOME[1]) - a3 * np.cos(HOME[1] + HOME[2]),
        -a2 * np.sin(HOME[1]) - a3 * np.sin(HOME[1] + HOME[2]),
    ])  # fmt: skip
    v = np.array([0.08, 0.05])
    for i, u in enumerate(chebyshev_nodes(9)):
        q3, q1, q2, qq3 = (column[0, i, 2] for column in rates)
        c, s = np.cos(q3), np.sin(q3)
        assert -s * q1 == pytest.approx((wrist + u * v) @ v / (a2 * a3), rel=1e-9)
        assert -s * q2 - c * q1**2 == pytest.approx(v @ v / (a2 * a3), rel=1e-9)
        assert -s * qq3 - 3.0 * c * q1 * q2 + s * q1**3 == pytest.approx(0.0, abs=1e-12)


def test_a_turn_of_the_tool_about_the_last_axis_moves_the_last_joint_only() -> None:
    chain, arm = one_segment(HOME, np.zeros(3), 0.0, 0.6)
    plain = build_arm(arm.T_base_work, np.diag([1.0, 1.0, 1.0, 1.0]), HOME)
    T = np.linalg.inv(arm.T_base_work) @ forward(HOME)
    chain = chain._replace(tips=T[None, :3, 3].repeat(2, 0), rotations=T[None, :3, :3].repeat(2, 0))
    rates = chain_rates(chain, chebyshev_nodes(5), plain)
    np.testing.assert_allclose(rates.first[0], np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.6], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(rates.second[0], 0.0, atol=1e-12)


def test_in_time_the_chain_rule_holds() -> None:
    """Along a segment at u = t^3: the tool's derivatives in time give the joints' own."""
    chain, arm = one_segment(HOME, np.array([0.03, 0.05, -0.02]))
    t = np.linspace(0.2, 0.9, 7)
    u, rates = t**3, chain_rates(chain, t**3, arm)
    step = chain.lengths[0] * chain.directions[0]
    speeds = np.stack([3.0 * t**2, 6.0 * t, np.full(7, 6.0)])
    linear = speeds[:, :, None] * step
    tips = chain.tips[0] + u[:, None] * step
    rotations = np.repeat(chain.rotations[:1], 7, axis=0)
    found = joint_motion(tips, rotations, linear, np.zeros((3, 7, 3)), arm)
    a, b, c = speeds[:, :, None]
    f1, f2, f3 = rates.first[0], rates.second[0], rates.third[0]
    np.testing.assert_allclose(found.q, rates.q[0], atol=1e-14)
    np.testing.assert_allclose(found.first, f1 * a, atol=1e-10)
    np.testing.assert_allclose(found.second, f2 * a**2 + f1 * b, atol=1e-9)
    np.testing.assert_allclose(found.third, f3 * a**3 + 3.0 * f2 * a * b + f1 * c, atol=1e-8)


def test_the_joints_lead_to_the_tool_s_pose() -> None:
    chain, arm = one_segment(HOME, np.array([0.03, 0.05, -0.02]), 0.4, -0.5)
    q = chain_rates(chain, np.array([0.0, 1.0]), arm).q[0]
    end = (np.linalg.inv(arm.T_base_work) @ forward(q) @ T_FLANGE_TOOL)[1]
    np.testing.assert_allclose(end[:3, 3], chain.tips[1], atol=1e-12)
    np.testing.assert_allclose(end[:3, 2], chain.axes[1], atol=1e-12)


def test_a_way_out_of_reach_is_named() -> None:
    chain, arm = one_segment(HOME, np.array([2.0, 0.0, 0.0]))
    with pytest.raises(ReachError, match="segment 1"):
        chain_rates(chain, chebyshev_nodes(9), arm)


def test_a_joint_that_leaves_its_range_is_named() -> None:
    q = HOME + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * np.pi - 0.5])
    chain, arm = one_segment(q, np.zeros(3), 0.0, 0.6)
    with pytest.raises(ReachError, match="leaves its range in segment 1"):
        chain_rates(chain, chebyshev_nodes(9), arm)
