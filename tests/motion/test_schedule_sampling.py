"""Pose and rates on a schedule, against finite differences of the pose alone."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import Schedule, sample_schedule, turning

SEGMENTS = 6
STEP = 1e-5
CHAIN = build_chain(
    np.random.default_rng(0).normal(size=(SEGMENTS + 1, 3)),
    Rotation.random(SEGMENTS + 1, random_state=1).as_matrix(),
)
SCHEDULE = fir_schedule(
    0.3 * np.arange(SEGMENTS), np.tile([0.6, 0.3, 0.1], (SEGMENTS, 1))
)  # up to four at once


def test_every_derivative_is_the_slope_of_the_one_before_and_the_spin_that_of_the_frame() -> None:
    drawn = np.random.default_rng(2).uniform(0.0, SCHEDULE.end, 200)
    breaks = np.concatenate([SCHEDULE.starts, SCHEDULE.starts + SCHEDULE.durations])
    times = drawn[np.abs(drawn[:, None] - breaks).min(axis=1) > 1e-3]
    here, after, before = (sample_schedule(CHAIN, SCHEDULE, times + h) for h in (0.0, STEP, -STEP))
    for k in range(3):
        for found, late, early in zip(here[:2], after[:2], before[:2], strict=True):
            np.testing.assert_allclose(found[:, k + 1], (late[:, k] - early[:, k]) / (2 * STEP), atol=1e-6)
    spins = (after.spins - before.spins)[:, :2] / (2 * STEP)
    np.testing.assert_allclose(here.spins[:, 1:], spins, atol=1e-5)
    turned = Rotation.from_matrix(after.rotations @ np.swapaxes(before.rotations, 1, 2)).as_rotvec()
    np.testing.assert_allclose(here.spins[:, 0], turned / (2 * STEP), atol=1e-7)
    np.testing.assert_array_equal(here.axes[:, 0], here.rotations[:, :, 2])


def test_without_roll_and_overlap_the_axis_turns_at_the_tool_s_own_rate() -> None:
    alone = Schedule(np.array([0]), np.zeros(1), np.ones(1), np.array([[0.0, 0.0, 3.0, -2.0]]), 1.0)
    flat = CHAIN._replace(rolls=np.zeros(SEGMENTS))
    here = sample_schedule(flat, alone, np.linspace(0.0, 1.0, 20)[1:-1])
    np.testing.assert_allclose(turning(here.axes), here.spins, atol=1e-12)


def test_it_rests_at_the_ends_and_passes_through_what_is_done() -> None:
    here = sample_schedule(CHAIN, SCHEDULE, np.array([-1.0, SCHEDULE.end + 1e-9, SCHEDULE.end + 1.0]))
    np.testing.assert_allclose(here.tips[:, 0], CHAIN.tips[[0, -1, -1]], atol=1e-15)
    np.testing.assert_allclose(here.rotations, CHAIN.rotations[[0, -1, -1]], atol=1e-15)
    np.testing.assert_array_equal(here.tips[:, 1:], 0.0)
    np.testing.assert_array_equal(here.spins, 0.0)
