"""Corner kernels slowed for axis and joints: dense samples of the composed motion stay inside, and come near."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.motion import forward
from polish_sim.motion.certified.bends import fill_plain
from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.kernel import PIECES, Kernel, Side, copy_scaled, side_of
from polish_sim.motion.certified.proof import ProofWork, Sides, Slowdown, fourth_spin, joint_shares, prove_kernel
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, arm_or_none, build_arm, chain_in_base
from polish_sim.motion.rules.schedule import Samples, Schedule, sample_schedule, turning
from polish_sim.motion.segment_rates import chain_segment, sampled_joints

T_FLANGE_TOOL = np.eye(4)
T_FLANGE_TOOL[:3, 3] = [0.01, -0.02, 0.2]
RATIO = 0.05 / np.radians(10.0)


class Corner(NamedTuple):
    chain: Chain
    arm: Arm
    spans: tuple[float, float]


def random_kernel(rng: np.random.Generator, size: float) -> Kernel:
    """Progress b from rest under random jerks, scaled to a size; a is b backwards in time."""
    durations = rng.uniform(0.002, 0.02, PIECES // 2)
    durations = np.concatenate([durations, durations[::-1]])
    gone = np.zeros((PIECES, 4))
    place = speed = acceleration = 0.0
    for p in range(PIECES):
        jerk, t = rng.uniform(-0.3, 1.0) if p else 1.0, durations[p]
        gone[p] = [place, speed, acceleration / 2, jerk / 6]
        place, speed, acceleration = (
            place + speed * t + acceleration * t**2 / 2 + jerk * t**3 / 6,
            speed + acceleration * t + jerk * t**2 / 2,
            acceleration + jerk * t,
        )
    gone *= size / place
    remaining = np.zeros((PIECES, 4))
    for p in range(PIECES):
        backwards = np.polynomial.Polynomial(gone[PIECES - 1 - p])(np.polynomial.Polynomial([durations[p], -1.0]))
        remaining[p, : len(backwards.coef)] = backwards.coef
    return Kernel(durations, remaining, gone)


def scaled(kernel: Kernel, scale: float, slowdown: float) -> Kernel:
    out = Kernel()
    copy_scaled(kernel, scale**3, scale * slowdown, out)
    return out


def random_corner(rng: np.random.Generator, q5: float | None = None) -> Corner:
    """Two segments of 0.5-20 mm that turn and roll the tool, meeting where a random configuration holds it."""
    q = rng.uniform([-3, -2.0, 0.7, -3, 0.4, -3], [3, -0.8, 2.2, 0, 2.0, 3])
    q[4] = q[4] if q5 is None else q5
    T = forward(q) @ T_FLANGE_TOOL
    lengths = np.exp(rng.uniform(np.log(5e-4), np.log(0.02), 2)) * (rng.random(2) > 0.1)
    turns = rng.uniform(0.001, 0.1, 2) * (rng.random(2) > 0.2) + (lengths == 0.0) * 0.02
    ways = rng.normal(size=(2, 3))
    ways *= (lengths / np.linalg.norm(ways, axis=1))[:, None]
    normals = np.cross(T[:3, 2], rng.normal(size=(2, 3)))
    normals *= (turns / np.linalg.norm(normals, axis=1))[:, None]
    rolls = [Rotation.from_rotvec([0.0, 0.0, a]).as_matrix() for a in rng.uniform(-0.02, 0.02, 2)]
    R = T[:3, :3]
    before = Rotation.from_rotvec(-normals[0]).as_matrix() @ R @ rolls[0]
    after = Rotation.from_rotvec(normals[1]).as_matrix() @ R @ rolls[1]
    chain = build_chain(T[:3, 3] + np.array([-ways[0], 0.0 * ways[0], ways[1]]), np.stack([before, R, after]))
    spans = tuple(max(chain.lengths[k], chain.angles[k] * RATIO, abs(chain.rolls[k]) * RATIO) for k in range(2))
    return Corner(chain, build_arm(np.eye(4), T_FLANGE_TOOL, q), spans)


def sides_of(corner: Corner) -> Sides:
    return Sides(chain_segment(corner.chain, 0), chain_segment(corner.chain, 1), corner.spans)


def axis_of(corner: Corner) -> Side:
    """How the tool axis turns before and after the corner."""
    cosine = float(corner.chain.turn_axes[0] @ corner.chain.turn_axes[1])
    return side_of(*(corner.chain.angles / corner.spans), cosine, Peaks(1.0, 1.0, 1.0), 1.0, True)


def proof_of(corner: Corner, kernel: Kernel, limits: SmoothingLimits, arm: Arm | None) -> Slowdown:
    sides, q = sides_of(corner), corner.arm.q_start
    return prove_kernel(axis_of(corner), sides, kernel, limits.values(), arm_or_none(arm), q, ProofWork())


def sampled(corner: Corner, kernel: Kernel, per_piece: int) -> tuple[np.ndarray, Samples]:
    """The kernel's motion at times within its pieces."""
    starts = np.concatenate([[0.0], np.cumsum(kernel.durations)])
    old, new = -kernel.remaining / corner.spans[0], kernel.gone / corner.spans[1]
    old[:, 0] += 1.0
    schedule = Schedule(
        np.repeat([0, 1], PIECES),
        np.tile(starts[:-1], 2),
        np.tile(kernel.durations, 2),
        np.concatenate([old, new]),
        float(starts[-1]),
    )
    times = np.concatenate([np.linspace(a + 1e-9, b - 1e-9, per_piece) for a, b in pairwise(starts)])
    return times, sample_schedule(corner.chain, schedule, times)


def used(corner: Corner, kernel: Kernel, limits: SmoothingLimits) -> np.ndarray:
    """Largest shares of limits at dense samples: axis speed, acceleration, jerk, then the same of the joints."""
    samples = sampled(corner, kernel, 40)[1]
    axis = np.linalg.norm(turning(samples.axes), axis=2).max(axis=0)
    axis_limits = (limits.axis_speed, limits.axis_acceleration, limits.axis_jerk)
    motion = sampled_joints(samples, corner.arm)
    joint = [np.abs(rate) / limit for rate, limit in zip(motion[1:], limits.values().joint, strict=True)]
    return np.concatenate([axis / axis_limits, [share.max() for share in joint]])


JOINTS_BIND = SmoothingLimits(
    axis_speed=1e3, axis_acceleration=1e6, axis_jerk=1e9,
    joint_speed=(0.01,) * 6, joint_acceleration=(0.1,) * 6, joint_jerk=(2.0,) * 6,
)  # fmt: skip
AXIS_BINDS = SmoothingLimits(axis_speed=0.01, axis_acceleration=0.1, axis_jerk=2.0)


def random_size(rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(1e-5), np.log(3e-3))))


def test_the_joints_shares_of_a_kernel_are_proven_and_nearly_exact() -> None:
    rng, tool, reached = np.random.default_rng(3), ProofWork(), []
    for _ in range(150):
        corner = random_corner(rng)
        kernel = random_kernel(rng, random_size(rng))
        joint, q = JOINTS_BIND.values().joint, corner.arm.q_start
        shares = np.array(joint_shares(sides_of(corner), kernel, joint, corner.arm, q, tool))
        if np.isinf(shares).any():  # next to the border of the arm's reach
            continue
        true = used(corner, kernel, JOINTS_BIND)[3:]
        assert (true <= shares).all()
        reached.append(true / shares)
    assert len(reached) > 140
    assert np.median(reached, axis=0).min() > 0.97


def test_the_third_derivative_of_the_tool_s_turning_is_below_its_bound() -> None:
    rng, nearest = np.random.default_rng(4), 0.0
    for _ in range(60):
        corner = random_corner(rng)
        kernel = random_kernel(rng, random_size(rng))
        times, samples = sampled(corner, kernel, 21)
        for p in range(PIECES):
            rows = slice(21 * p, 21 * (p + 1))
            # Differences of a smooth function in the middle of two samples.
            third = np.diff(samples.spins[rows, 2], axis=0) / np.diff(times[rows])[:, None]
            bound, found = fourth_spin(sides_of(corner), kernel, p), float(np.linalg.norm(third, axis=1).max())
            assert found <= bound * (1.0 + 1e-3) + 1e-6
            nearest = max(nearest, found / max(bound, 1e-9))
    assert nearest > 0.7


def test_slowed_kernels_keep_the_joints_limits_and_nearly_reach_them() -> None:
    rng, reached = np.random.default_rng(5), []
    for _ in range(60):
        corner = random_corner(rng)
        kernel = random_kernel(rng, random_size(rng))
        proof = proof_of(corner, kernel, JOINTS_BIND, corner.arm)
        share = used(corner, scaled(kernel, 1.0, proof.factor), JOINTS_BIND).max()
        assert share <= 1.0
        if proof.factor > 1.0:
            reached.append(share)
    assert np.median(reached) > 0.97


def test_slowed_kernels_keep_the_axis_limits_and_nearly_reach_them() -> None:
    rng, reached = np.random.default_rng(1), []
    for _ in range(100):
        corner = random_corner(rng)
        kernel = random_kernel(rng, random_size(rng))
        proof = proof_of(corner, kernel, AXIS_BINDS, None)
        share = used(corner, scaled(kernel, 1.0, proof.factor), AXIS_BINDS)[:3].max()
        assert share <= 1.0
        if proof.factor > 1.0:
            reached.append(share)
    assert len(reached) > 30
    assert np.median(reached) > 0.95


@pytest.mark.parametrize("q5", [0.1, 0.01])
def test_next_to_a_singularity_a_kernel_is_slowed_until_it_holds_or_refused(q5: float) -> None:
    rng, refused = np.random.default_rng(2), 0
    for _ in range(50):
        corner = random_corner(rng, q5)
        kernel = random_kernel(rng, 1e-3)
        proof = proof_of(corner, kernel, SmoothingLimits(), corner.arm)
        refused += np.isinf(proof.factor)
        if np.isfinite(proof.factor):
            assert used(corner, scaled(kernel, 1.0, proof.factor), SmoothingLimits()).max() <= 1.0
    assert refused < 50
    assert q5 > 0.05 or refused > 0


def test_a_straight_path_at_constant_speed_is_not_slowed() -> None:
    corner = random_corner(np.random.default_rng(5))
    ways = np.array([[-0.001, 0.0, 0.0], [0.0, 0.0, 0.0], [0.001, 0.0, 0.0]])
    chain = build_chain(corner.chain.tips[1] + ways, np.repeat(corner.chain.rotations[1:2], 3, axis=0))
    kernel = Kernel()
    fill_plain(0.5e-3, 0.03, kernel)
    corner = Corner(chain_in_base(chain, corner.arm), corner.arm, (0.001, 0.001))
    assert proof_of(corner, kernel, SmoothingLimits(), corner.arm).factor == 1.0
