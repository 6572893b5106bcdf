"""A motion over time follows its path at the speed wanted, from rest to rest, its acceleration continuous."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.motion import trajectory
from polish_sim.motion.rules.chain import build_chain
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import Schedule, Smoothed, turning
from polish_sim.motion.trajectory import PathTable, build_path_table, with_feed_share

PACE = trajectory.Pace(0.01, 0.05, 1.25)
RADIUS = 0.02


class Sampled(NamedTuple):
    positions: Array
    velocities: Array
    quaternions: Array
    spins: Array
    places: Array
    speeds: Array


def circle() -> PathTable:
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    points = RADIUS * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    return build_path_table(points, Rotation.from_euler("z", angle[:, None]).as_matrix())


def play(motion: trajectory.TimedPath, clock: Array) -> Sampled:
    out, place = (
        Sampled(*(np.empty((len(clock), *shape)) for shape in ((3,), (3,), (4,), (3,), (), ()))),
        np.empty(2),
    )
    for i, t in enumerate(clock):
        trajectory.sample_motion(motion, float(t), *(rows[i] for rows in out[:4]), place)
        out.places[i], out.speeds[i] = place
    return out


@pytest.mark.parametrize("length", [1e-5, 4e-4, 0.1])
def test_short_and_long_ways_keep_the_limits_and_arrive(length):
    table = build_path_table(np.array([[0.0, 0, 0], [length, 0, 0]]), np.tile(np.eye(3), (2, 1, 1)))
    motion = trajectory.time_path(table, PACE)
    dt = motion.duration / 4000.0
    run = play(motion, np.arange(4001) * dt)
    assert run.places[-1] == pytest.approx(length, rel=1e-9)
    assert run.speeds.max() <= PACE.speed * (1 + 1e-9)
    rows = np.diff(motion.speeds) / motion.spacing
    assert np.abs(rows).max() <= PACE.acceleration * (1 + 1e-9)
    assert np.abs(np.diff(rows)).max() <= PACE.jerk * motion.spacing * (1 + 1e-6)


def test_a_single_pose_is_a_motion_of_no_duration():
    motion = trajectory.time_path(build_path_table(np.ones((1, 3)), np.eye(3)[None]), PACE)
    assert motion.duration == 0.0
    run = play(motion, np.array([0.0, 1.0]))
    np.testing.assert_allclose(run.positions, 1.0)
    np.testing.assert_allclose(run.velocities, 0.0)


def test_velocity_and_spin_are_the_rates_of_position_and_orientation():
    table = circle()
    motion = trajectory.time_path(table, PACE)
    assert motion.duration == pytest.approx(table.length / 0.01 + 0.01 / 0.05 + 0.05 / 1.25)  # and one ramp
    assert motion.playing_time == pytest.approx(motion.duration)
    t = np.linspace(0.3, 12.0, 500)
    step = 1e-4
    before, now, after = play(motion, t - step), play(motion, t), play(motion, t + step)
    np.testing.assert_allclose((after.positions - before.positions) / (2 * step), now.velocities, atol=2e-7)
    np.testing.assert_allclose(now.spins, [[0.0, 0.0, 0.01 / RADIUS]] * len(t), atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(now.velocities, axis=1), 0.01, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(now.positions, axis=1), RADIUS, atol=1e-8)


def test_a_feed_that_changes_along_the_path_is_kept_and_slowed_for_in_time():
    s, feed = np.array([0.0, 0.05, 0.06, 0.12]), np.array([2.0, 2.0, 0.5, 0.5])
    motion = trajectory.time_path(with_feed_share(circle(), s, feed), PACE)
    clock = np.arange(len(motion.places)) * motion.spacing
    fed = motion.rates * motion.speeds
    assert np.all(
        fed <= 0.01 * np.interp(motion.places, s, feed) * 1.05
    )  # the feed's corners lie between rows
    assert fed[len(clock) // 8] == pytest.approx(0.02)
    slowing = -np.diff(fed**2) / (2.0 * np.maximum(np.diff(motion.places), 1e-12))
    assert slowing[20:-60].max() < 3.0 * PACE.acceleration
    assert motion.playing_time == pytest.approx(np.trapezoid(1.0 / motion.rates, clock), rel=1e-3)
    for t in np.linspace(0.0, motion.duration, 777):
        assert trajectory.sample_rate(motion, float(t)) == pytest.approx(np.interp(t, clock, motion.rates))


# A schedule sampled densely is the schedule: poses, rates, and how far along the path it has come.
TIPS = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0, 0], [0.03, 0.02, 0], [0.05, 0.02, 0.01]])
ROTATIONS = Rotation.from_rotvec(0.1 * np.outer([0, 1, 1, 3, 4], [1.0, 0.5, 0.2])).as_matrix()
CHAIN = build_chain(TIPS, ROTATIONS)  # point 2 repeats point 1
SCHEDULE = fir_schedule(np.array([0.0, 0.5, 1.1]), np.tile([0.5, 0.1, 0.05], (3, 1)))
MARKS = np.array([0.0, 0.02, 0.045, 0.07])


def test_between_its_rows_it_is_where_the_schedule_is():
    motion = trajectory.time_schedule(Smoothed(CHAIN, SCHEDULE), MARKS)
    clock = np.linspace(0.0, SCHEDULE.end, 400)
    exact = Smoothed(CHAIN, SCHEDULE).sample(clock)
    run = play(motion, clock)
    np.testing.assert_allclose(run.positions, exact.tips[:, 0], atol=2e-8)
    np.testing.assert_allclose(run.velocities, exact.tips[:, 1], atol=3e-5)
    np.testing.assert_allclose(run.spins, exact.spins[:, 0], atol=2e-3)
    R = Rotation.from_quat(run.quaternions, scalar_first=True).as_matrix()
    np.testing.assert_allclose(R, exact.rotations, atol=3e-5)


def test_the_place_runs_from_the_first_mark_to_the_last_and_its_rate_is_its_derivative():
    s = np.array([0.0, 0.02, 0.02, 0.045, 0.07])
    np.testing.assert_array_equal(trajectory.marks_on(CHAIN, TIPS, ROTATIONS, s), MARKS)
    motion = trajectory.time_schedule(Smoothed(CHAIN, SCHEDULE), MARKS)
    assert motion.places[0] == 0.0
    assert motion.places[-1] == pytest.approx(0.07, abs=1e-12)
    assert np.all(np.diff(motion.places) >= 0.0)
    rate = np.gradient(motion.places, motion.spacing)
    np.testing.assert_allclose(motion.speeds[1:-1], rate[1:-1], atol=2e-4)
    clock = np.arange(len(motion.places)) * motion.spacing
    places = Smoothed(CHAIN, SCHEDULE).places_at(MARKS, clock)[0]
    np.testing.assert_allclose(places, motion.places, atol=1e-12)


# Pose and rates on a schedule of up to four segments at once, against finite differences of the pose alone.
STEP = 1e-5
TURNING = build_chain(
    np.random.default_rng(0).normal(size=(7, 3)),
    Rotation.random(7, random_state=1).as_matrix(),
)
FOUR_AT_ONCE = fir_schedule(0.3 * np.arange(6), np.tile([0.6, 0.3, 0.1], (6, 1)))


def test_every_derivative_is_the_slope_of_the_one_before_and_the_spin_that_of_the_frame():
    drawn = np.random.default_rng(2).uniform(0.0, FOUR_AT_ONCE.end, 200)
    breaks = np.concatenate([FOUR_AT_ONCE.starts, FOUR_AT_ONCE.starts + FOUR_AT_ONCE.durations])
    times = drawn[np.abs(drawn[:, None] - breaks).min(axis=1) > 1e-3]
    here, after, before = (Smoothed(TURNING, FOUR_AT_ONCE).sample(times + h) for h in (0.0, STEP, -STEP))
    for k in range(3):
        for found, late, early in zip(here[:2], after[:2], before[:2], strict=True):
            np.testing.assert_allclose(found[:, k + 1], (late[:, k] - early[:, k]) / (2 * STEP), atol=1e-6)
    spins = (after.spins - before.spins)[:, :2] / (2 * STEP)
    np.testing.assert_allclose(here.spins[:, 1:], spins, atol=1e-5)
    turned = Rotation.from_matrix(after.rotations @ np.swapaxes(before.rotations, 1, 2)).as_rotvec()
    np.testing.assert_allclose(here.spins[:, 0], turned / (2 * STEP), atol=1e-7)
    np.testing.assert_array_equal(here.axes[:, 0], here.rotations[:, :, 2])


def test_without_roll_and_overlap_the_axis_turns_at_the_tool_s_own_rate():
    alone = Schedule(np.array([0]), np.zeros(1), np.ones(1), np.array([[0.0, 0.0, 3.0, -2.0]]), 1.0)
    flat = TURNING._replace(rolls=np.zeros(6))
    here = Smoothed(flat, alone).sample(np.linspace(0.0, 1.0, 20)[1:-1])
    np.testing.assert_allclose(turning(here.axes), here.spins, atol=1e-12)


def test_it_rests_at_the_ends_and_passes_through_what_is_done():
    here = Smoothed(TURNING, FOUR_AT_ONCE).sample(
        np.array([-1.0, FOUR_AT_ONCE.end + 1e-9, FOUR_AT_ONCE.end + 1.0])
    )
    np.testing.assert_allclose(here.tips[:, 0], TURNING.tips[[0, -1, -1]], atol=1e-15)
    np.testing.assert_allclose(here.rotations, TURNING.rotations[[0, -1, -1]], atol=1e-15)
    np.testing.assert_array_equal(here.tips[:, 1:], 0.0)
    np.testing.assert_array_equal(here.spins, 0.0)
