"""Corner kernels sized and slowed for axis and joints: dense samples of the composed motion stay inside."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.motion import forward
from polish_sim.motion.certified.corner_factor import CornerFactor, corner_factor, new_corner_work
from polish_sim.motion.joint_motion import joint_motion
from polish_sim.motion.segment_rates import chain_segment
from polish_sim.motion.smoothing.arm import Arm, arm_or_none, build_arm, chain_in_base
from polish_sim.motion.smoothing.build import build_chain
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.limits import SmoothingLimits
from polish_sim.motion.smoothing.sampling import sample_schedule, turning
from polish_sim.motion.smoothing.schedule import Schedule

T_FLANGE_TOOL = np.eye(4)
T_FLANGE_TOOL[:3, 3] = [0.01, -0.02, 0.2]
RATIO = 0.05 / np.radians(10.0)
PIECES = 4


class Kernel(NamedTuple):
    durations: np.ndarray
    remaining: np.ndarray
    gone: np.ndarray


class Corner(NamedTuple):
    chain: Chain
    arm: Arm
    spans: tuple[float, float]


def random_kernel(rng: np.random.Generator, size: float) -> Kernel:
    """Progress b from rest under random jerks, scaled to a size; a is b backwards in time."""
    durations = rng.uniform(0.005, 0.05, PIECES // 2)
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


def scaled(kernel: Kernel, size: float, slowdown: float) -> Kernel:
    stretch = np.cbrt(size) * slowdown
    powers = size / stretch ** np.arange(4)
    return Kernel(kernel.durations * stretch, kernel.remaining * powers, kernel.gone * powers)


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


def factor_of(corner: Corner, kernel: Kernel, limits: SmoothingLimits, arm: Arm | None) -> CornerFactor:
    chain = corner.chain
    return corner_factor(
        chain_segment(chain, 0), chain_segment(chain, 1), corner.spans, *kernel, limits.values(), arm_or_none(arm),
        corner.arm.q_start, new_corner_work(PIECES),
    )  # fmt: skip


def used(corner: Corner, kernel: Kernel, limits: SmoothingLimits) -> np.ndarray:
    """Largest shares of limits at dense samples: axis speed, acceleration, jerk, then the same of the joints."""
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
    times = np.concatenate([np.linspace(a + 1e-9, b - 1e-9, 40) for a, b in pairwise(starts)])
    samples = sample_schedule(corner.chain, schedule, times)
    axis = np.linalg.norm(turning(samples.axes), axis=2).max(axis=0)
    axis_limits = (limits.axis_speed, limits.axis_acceleration, limits.axis_jerk)
    linear = np.ascontiguousarray(samples.tips[:, 1:].swapaxes(0, 1))
    motion = joint_motion(
        samples.tips[:, 0], samples.rotations, linear, np.ascontiguousarray(samples.spins.swapaxes(0, 1)), corner.arm
    )
    joint = [np.abs(rate) / limit for rate, limit in zip(motion[1:], limits.values().joint, strict=True)]
    return np.concatenate([axis / axis_limits, [share.max() for share in joint]])


JOINTS_BIND = SmoothingLimits(
    axis_speed=1e3, axis_acceleration=1e6, axis_jerk=1e9,
    joint_speed=(0.01,) * 6, joint_acceleration=(0.1,) * 6, joint_jerk=(2.0,) * 6,
)  # fmt: skip
AXIS_BINDS = SmoothingLimits(axis_speed=0.01, axis_acceleration=0.1, axis_jerk=2.0)


def test_slowed_kernels_of_every_size_keep_the_joints_limits_and_nearly_reach_them() -> None:
    rng, reached = np.random.default_rng(0), []
    for _ in range(100):
        corner = random_corner(rng)
        kernel = random_kernel(rng, float(np.exp(rng.uniform(np.log(1e-5), np.log(1e-3)))))
        factor = factor_of(corner, kernel, JOINTS_BIND, corner.arm)
        assert factor.size == 1.0
        for share in (1.0, 0.3, 0.02):
            shares = used(corner, scaled(kernel, share, factor.slowdown), JOINTS_BIND)
            assert shares.max() <= 1.0
            if share == 1.0 and factor.slowdown > 1.0:
                reached.append(shares.max())
    assert len(reached) > 50
    assert np.median(reached) > 0.8


def test_slowed_kernels_keep_the_axis_limits_and_nearly_reach_them() -> None:
    rng, reached = np.random.default_rng(1), []
    for _ in range(100):
        corner = random_corner(rng)
        kernel = random_kernel(rng, float(np.exp(rng.uniform(np.log(1e-5), np.log(1e-3)))))
        factor = factor_of(corner, kernel, AXIS_BINDS, None)
        for share in (1.0, 0.3):
            shares = used(corner, scaled(kernel, share, factor.slowdown), AXIS_BINDS)[:3]
            assert shares.max() <= 1.0
            if share == 1.0 and factor.slowdown > 1.0:
                reached.append(shares.max())
    assert len(reached) > 30
    assert np.median(reached) > 0.95


@pytest.mark.parametrize("q5", [0.1, 0.01])
def test_next_to_a_singularity_kernels_are_shrunk_and_slowed_until_they_hold(q5: float) -> None:
    rng, shrunk = np.random.default_rng(2), 0
    for _ in range(50):
        corner = random_corner(rng, q5)
        kernel = random_kernel(rng, 1e-3)
        factor = factor_of(corner, kernel, SmoothingLimits(), corner.arm)
        shrunk += factor.size < 1.0
        if factor.size > 0.0:
            assert used(corner, scaled(kernel, factor.size, factor.slowdown), SmoothingLimits()).max() <= 1.0
    assert shrunk > 10


def test_a_straight_path_at_constant_speed_is_not_slowed() -> None:
    corner = random_corner(np.random.default_rng(5))
    ways = np.array([[-0.001, 0.0, 0.0], [0.0, 0.0, 0.0], [0.001, 0.0, 0.0]])
    chain = build_chain(corner.chain.tips[1] + ways, np.repeat(corner.chain.rotations[1:2], 3, axis=0))
    t = np.full(PIECES, 0.005)
    gone = np.zeros((PIECES, 4))
    gone[0, 3] = 1.0
    gone[1] = [t[0] ** 3, 3 * t[0] ** 2, 3 * t[0], -1.0]
    gone[2:, 1] = 6 * t[0] ** 2
    gone[2:, 0] = [6 * t[0] ** 3, 12 * t[0] ** 3]
    remaining = np.zeros((PIECES, 4))
    for p in range(PIECES):
        flipped = np.polynomial.Polynomial(gone[PIECES - 1 - p])(np.polynomial.Polynomial([t[p], -1.0])).coef
        remaining[p, : len(flipped)] = flipped
    corner = Corner(chain_in_base(chain, corner.arm), corner.arm, (0.001, 0.001))
    assert factor_of(corner, Kernel(t, remaining, gone), SmoothingLimits(), corner.arm).slowdown == 1.0
