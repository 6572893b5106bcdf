"""Speeds proven for a whole segment: dense samples of the joints stay inside, and little is given away."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.motion import forward, link_frames
from polish_sim.motion.certified.segment_limits import SegmentWork, segment_limits
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, arm_or_none, build_arm, chain_in_base
from polish_sim.motion.segment_rates import BEYOND, REACHED, SINGULAR, Segment, chain_rates, chain_segment

T_FLANGE_TOOL = np.eye(4)
T_FLANGE_TOOL[:3, 3] = [0.01, -0.02, 0.2]
TIGHT = SmoothingLimits(joint_speed=(0.1,) * 6, joint_acceleration=(0.5,) * 6, joint_jerk=(10.0,) * 6)
RATIO = 0.05 / np.radians(10.0)


def random_segments(count: int, seed: int, q5_least: float = 0.3) -> Iterator[tuple[Chain, Arm, float]]:
    """One-segment chains of 0.02-50 mm anywhere in the arm's reach, the tool turning up to 20 deg and rolling a bit."""
    rng = np.random.default_rng(seed)
    while count:
        q = rng.uniform([-3, -2.2, 0.5, -3, q5_least, -3], [3, -0.6, 2.4, 0, 2.0, 3])
        T = forward(q) @ T_FLANGE_TOOL
        direction, normal = rng.normal(size=3), np.cross(T[:3, 2], rng.normal(size=3))
        length, turn = float(np.exp(rng.uniform(np.log(2e-5), np.log(0.05)))), float(rng.uniform(0.0, 0.35))
        if np.linalg.norm(forward(q)[:3, 3]) > 0.8:
            continue
        direction, normal = direction / np.linalg.norm(direction), normal / np.linalg.norm(normal)
        roll = float(rng.uniform(-0.1, 0.1) * turn)
        tips = T[:3, 3] + np.outer([0.0, length], direction)
        R = np.stack([T[:3, :3], Rotation.from_rotvec(turn * normal).as_matrix() @ T[:3, :3]])
        chain = Chain(
            tips, R[:, :, 2], R, np.array([length]), direction[None], np.array([turn]), normal[None], np.array([roll])
        )
        count -= 1
        yield chain, build_arm(np.eye(4), T_FLANGE_TOOL, q), max(length, turn * RATIO)


def shares(chain: Chain, arm: Arm, scale: float, motion: np.ndarray, limits: SmoothingLimits) -> np.ndarray:
    """Largest use of joint speed, acceleration and jerk limits at dense samples of the segment."""
    rates = chain_rates(chain, np.linspace(0.0, 1.0, 301), arm)
    q1, q2, q3 = (np.abs(r[0]).max(0) for r in rates[1:])
    v, a, j = motion / scale
    speed, acceleration, jerk = limits.values().joint
    return np.array([
        (q1 * v / speed).max(),
        ((q2 * v**2 + q1 * a) / acceleration).max(),
        ((q3 * v**3 + 3.0 * q2 * v * a + q1 * j) / jerk).max(),
    ])  # fmt: skip


def proven(chain: Chain, arm: Arm, scale: float, limits: SmoothingLimits) -> tuple[int, np.ndarray, np.ndarray]:
    segment: Segment = chain_segment(chain_in_base(chain, arm), 0)
    motion, q = np.zeros(6), arm.q_start.copy()
    status = segment_limits(segment, scale, limits.values(), arm, q, motion, SegmentWork())
    return status, motion[:3], q


def test_no_joint_passes_its_limit_at_the_proven_speeds() -> None:
    for chain, arm, scale in random_segments(300, 0):
        status, motion, q = proven(chain, arm, scale, TIGHT)
        assert status == REACHED
        assert shares(chain, arm, scale, motion, TIGHT).max() <= 1.0
        np.testing.assert_allclose(q, chain_rates(chain, np.array([0.0, 1.0]), arm).q[0, 1], atol=1e-12)


def test_where_joints_bind_they_are_used_nearly_fully() -> None:
    used = []
    for chain, arm, scale in random_segments(100, 1):
        motion = proven(chain, arm, scale, TIGHT)[1]
        tool = 0.05 * min(scale / chain.lengths[0], scale / (chain.angles[0] * RATIO))
        if motion[0] < 0.9 * tool:
            used.append(shares(chain, arm, scale, motion, TIGHT).max())
    assert len(used) > 10
    assert np.min(used) > 0.9
    assert np.median(used) > 0.99


def test_without_joints_the_tool_alone_binds() -> None:
    chain, arm, scale = next(random_segments(1, 2))
    motion = np.zeros(6)
    segment = chain_segment(chain_in_base(chain, arm), 0)
    segment_limits(segment, scale, TIGHT.values(), arm_or_none(None), arm.q_start.copy(), motion, SegmentWork())
    tip, axis = chain.lengths[0] / scale, chain.angles[0] / scale
    assert motion[0] == pytest.approx(min(0.05 / tip, TIGHT.axis_speed / axis), rel=1e-8)
    assert motion[2] == pytest.approx(min(10.0 / tip, TIGHT.axis_jerk / axis), rel=1e-8)


@pytest.mark.parametrize("q5", [1e-1, 1e-2, 1e-3])
def test_near_the_wrist_s_singularity_speeds_fall_and_stay_proven(q5: float) -> None:
    for chain, arm, _ in random_segments(30, 3):
        q = arm.q_start.copy()
        q[4] = q5
        T = forward(q) @ T_FLANGE_TOOL
        moved = chain._replace(
            tips=T[:3, 3] + np.outer([0.0, 0.1 * q5 * chain.lengths[0]], chain.directions[0]),
            lengths=0.1 * q5 * chain.lengths,
            rotations=np.repeat(T[None, :3, :3], 2, axis=0),
            angles=np.zeros(1),
            rolls=np.zeros(1),
        )
        arm = build_arm(arm.T_base_work, T_FLANGE_TOOL, q)
        status, motion, _ = proven(moved, arm, float(moved.lengths[0]), SmoothingLimits())
        assert status == REACHED
        share = shares(moved, arm, float(moved.lengths[0]), motion, SmoothingLimits())
        assert share.max() <= 1.0


def test_a_segment_through_a_singularity_is_refused() -> None:
    """A tool point on wrist 2's axis, turned about that axis: wrist 2 goes from 0.05 rad through zero."""
    chain, arm, _ = next(random_segments(1, 4))
    q = arm.q_start.copy()
    q[4] = 0.05
    T_flange_tool = np.eye(4)
    T_flange_tool[2, 3] = -0.0996
    T = forward(q) @ T_flange_tool
    through = chain._replace(
        tips=np.repeat(T[None, :3, 3], 2, axis=0),
        rotations=np.repeat(T[None, :3, :3], 2, axis=0),
        lengths=np.zeros(1),
        angles=np.array([0.1]),
        turn_axes=-link_frames(q)[None, 4, :3, 2],
        rolls=np.zeros(1),
    )
    arm = build_arm(np.eye(4), T_flange_tool, q)
    assert proven(through, arm, 0.03, TIGHT)[0] == SINGULAR
    assert proven(through._replace(turn_axes=-through.turn_axes), arm, 0.03, TIGHT)[0] == REACHED


def test_a_joint_may_not_leave_its_range_inside_a_segment() -> None:
    """Wrist 3 swings past 360 deg and back: 0.3 rad of roll from 6.0 on, 0.28 rad are left."""
    chain, arm, _ = next(random_segments(1, 6))
    q = arm.q_start.copy()
    q[5] = 6.0
    T = forward(q) @ T_FLANGE_TOOL
    rolled = chain._replace(
        tips=np.repeat(T[None, :3, 3], 2, axis=0),
        rotations=np.repeat(T[None, :3, :3], 2, axis=0),
        lengths=np.zeros(1),
        angles=np.zeros(1),
        rolls=np.array([0.3]),
    )
    plain = build_arm(np.eye(4), T_FLANGE_TOOL, q)
    assert proven(rolled, plain, 0.1, TIGHT)[0] == BEYOND
    assert proven(rolled._replace(rolls=np.array([0.25])), plain, 0.1, TIGHT)[0] == REACHED
