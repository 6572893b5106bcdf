"""Joint derivatives along segments and in time against finite differences, and the branch kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.errors import ReachError
from polish_sim.motion import forward
from polish_sim.motion.kinematics import inverse_on_branch
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import Arm, build_arm
from polish_sim.motion.segment_rates import chain_rates, chebyshev_nodes, joint_motion
from polish_sim.spatial import from_pose, inverse

T_FLANGE_TOOL = from_pose([0.01, -0.02, 0.2, 0.1, 0.2, 0.3])
T_BASE_WORK = from_pose([0.4, 0.1, 0.05, 0.2, -0.1, 0.7])
HOME = np.array([0.3, -1.4, 1.8, -1.9, -1.5, 0.2])


def one_segment(q: np.ndarray, step: np.ndarray, turn: float = 0.0, roll: float = 0.0) -> tuple[Chain, Arm]:
    """A segment that starts where the joints put the tool, seen from a work frame turned and moved in the
    base."""
    T = inverse(T_BASE_WORK) @ forward(q) @ T_FLANGE_TOOL
    normal = np.cross(T[:3, 2], [0.3, 0.2, 0.9])
    turned = Rotation.from_rotvec(turn * normal / np.linalg.norm(normal)).as_matrix()
    end = turned @ T[:3, :3] @ Rotation.from_rotvec([0.0, 0.0, roll]).as_matrix()
    tips = np.array([T[:3, 3], T[:3, 3] + T_BASE_WORK[:3, :3].T @ step])
    return build_chain(tips, np.stack([T[:3, :3], end])), build_arm(T_BASE_WORK, T_FLANGE_TOOL, q)


def test_the_branch_s_solution_is_the_configuration_itself_and_out_of_reach_there_is_none() -> None:
    rng = np.random.default_rng(0)
    out = np.empty(6)
    for q in rng.uniform(-2.0 * np.pi, 2.0 * np.pi, (500, 6)):
        if min(abs(np.sin(q[2])), abs(np.sin(q[4]))) > 0.01:
            assert inverse_on_branch(forward(q), q + 1e-4 * rng.normal(size=6), out)
            np.testing.assert_allclose(forward(out), forward(q), atol=1e-12)
            np.testing.assert_allclose(out, q, atol=1e-9)
    T, before = forward(HOME), out.copy()
    T[0, 3] += 2.0
    assert not inverse_on_branch(T, HOME, out)
    np.testing.assert_array_equal(out, before)


@pytest.mark.parametrize(("turn", "roll"), [(0.0, 0.0), (0.3, 0.0), (0.4, -0.5)])
def test_each_derivative_is_that_of_the_one_before_to_the_tools_end(turn: float, roll: float) -> None:
    chain, arm = one_segment(HOME, np.array([0.03, 0.05, -0.02]), turn, roll)
    u = np.linspace(0.0, 1.0, 2001)
    columns = [column[0] for column in chain_rates(chain, u, arm)]
    for lower, higher in pairwise(columns):
        slope = (lower[2:] - lower[:-2]) / (u[2:] - u[:-2])[:, None]
        np.testing.assert_allclose(higher[1:-1], slope, atol=2e-6 * np.abs(higher).max())
    end = inverse(T_BASE_WORK) @ forward(columns[0][-1]) @ T_FLANGE_TOOL
    np.testing.assert_allclose(end[:3, 3], chain.tips[1], atol=1e-12)
    np.testing.assert_allclose(end[:3, :3], chain.rotations[1], atol=1e-12)


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


def test_a_way_out_of_reach_and_a_joint_that_leaves_its_range_are_named() -> None:
    chain, arm = one_segment(HOME, np.array([2.0, 0.0, 0.0]))
    with pytest.raises(ReachError, match="segment 1"):
        chain_rates(chain, chebyshev_nodes(9), arm)
    chain, arm = one_segment(HOME + [0.0, 0.0, 0.0, 0.0, 0.0, 2.0 * np.pi - 0.5], np.zeros(3), roll=0.6)
    with pytest.raises(ReachError, match="leaves its range in segment 1"):
        chain_rates(chain, chebyshev_nodes(9), arm)
