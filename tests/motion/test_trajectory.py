"""A path as a callable of arc length and a motion over time, against a helix and a circle."""

from collections import namedtuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.motion import trajectory
from polish_sim.motion.rules.chain import build_chain, repeated_points
from polish_sim.motion.rules.fir import fir_schedule
from polish_sim.motion.rules.schedule import Schedule, Smoothed, turning
from polish_sim.motion.trajectory import build_path_table, with_feed_share

RADIUS, PITCH = 0.1, 0.02  # of the helix [m], [m/rad]
SPEED = float(np.hypot(RADIUS, PITCH))  # arc length per turn angle [m/rad]
PACE = trajectory.Pace(0.01, 0.05, 1.25)
ROUND = 0.02  # radius of the circle [m]
Sampled = namedtuple("Sampled", "positions velocities quaternions spins places speeds")


def sample(table, s):
    """Position, tangent, quaternion and turning at a place, and its row."""
    found = np.zeros(3), np.zeros(3), np.zeros(4), np.zeros(3)
    return *found, trajectory.sample_path(table, s, *found)


def helix(angle):
    return np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), PITCH * angle], axis=1)


@pytest.fixture(scope="module")
def table():
    """Two turns of a helix, the tool's frame turning with it about z: its quaternions jump in sign."""
    angle = np.linspace(0.0, 4.0 * np.pi, 800)
    frames = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    return trajectory.build_path_table(helix(angle), frames, s=SPEED * angle, curvature=10.0 + angle)


def test_positions_tangents_and_frames_are_the_helixs_and_stay_beyond_its_ends(table):
    assert table.length == pytest.approx(4.0 * np.pi * SPEED)
    assert table.spacing <= 0.0005
    for angle in np.random.default_rng(0).uniform(0.3, 4.0 * np.pi - 0.3, 200):
        position, tangent, quaternion, turning, _ = sample(table, SPEED * angle)
        np.testing.assert_allclose(position, helix(np.array([angle]))[0], atol=1e-8)
        direction = np.array([-RADIUS * np.sin(angle), RADIUS * np.cos(angle), PITCH]) / SPEED
        np.testing.assert_allclose(tangent, direction, atol=1e-5)
        frame = Rotation.from_quat(quaternion, scalar_first=True)
        assert (frame * Rotation.from_rotvec([0.0, 0.0, -angle])).magnitude() < 1e-6
        np.testing.assert_allclose(turning, [0.0, 0.0, 1.0 / SPEED], rtol=1e-4, atol=1e-9)
    for outside, inside in ((-1.0, 0.0), (table.length + 1.0, table.length)):
        for left, right in zip(sample(table, outside), sample(table, inside), strict=True):
            np.testing.assert_array_equal(left, right)
    end = helix(np.array([4.0 * np.pi]))[0]
    np.testing.assert_allclose(sample(table, table.length)[0], end, atol=1e-12)


def test_a_single_pose_is_a_path_of_no_length_and_a_motion_of_no_duration():
    point, frame = np.array([[0.1, 0.2, 0.3]]), Rotation.random(random_state=0).as_matrix()[None]
    table = trajectory.build_path_table(point, frame)
    assert table.length == 0.0
    position, _, quaternion, turning, _ = sample(table, 0.5)
    np.testing.assert_allclose(position, point[0], atol=1e-15)
    np.testing.assert_allclose(turning, 0.0, atol=1e-12)
    R = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(R, frame[0], atol=1e-12)
    motion = trajectory.time_path(table, PACE)
    assert motion.duration == 0.0
    run = play(motion, np.array([0.0, 1.0]))
    np.testing.assert_allclose(run.positions, np.tile(point, (2, 1)))
    np.testing.assert_allclose(run.velocities, 0.0)


def test_turns_curvature_and_values_belong_to_their_place_by_the_arc_length_given():
    line = np.linspace([0.0, 0.0, 0.0], [0.2, 0.0, 0.0], 41)
    x = np.repeat(np.linspace(0.0, 0.1, 11), [1, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1])
    number = np.round(100.0 * x).astype(np.int64)
    points, frames = np.column_stack([x, 0 * x, 0 * x]), np.tile(np.eye(3), (12, 1, 1))
    table = trajectory.build_path_table(points, frames, curvature=100.0 * x, pass_index=number)
    row = sample(table, 0.0425)[-1]
    assert table.pass_index[row] == 4
    assert table.curvature[row] == pytest.approx(100.0 * row * table.spacing)
    assert table.pass_index[-1] == 10
    # The part bends like a cylinder; pressed in by 4 mm the points move on a shorter radius.
    angle = np.linspace(0.0, 1.0, 200)
    on_part = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    table = trajectory.build_path_table(0.096 * on_part, np.tile(np.eye(3), (200, 1, 1)), s=0.1 * angle)
    assert table.length == pytest.approx(0.1)
    np.testing.assert_allclose(np.linalg.norm(sample(table, 0.05)[1]), 0.96, atol=1e-6)
    s, table = np.array([0.3, 0.35, 0.5]), trajectory.build_path_table(line, np.tile(np.eye(3), (41, 1, 1)))
    assert trajectory.sample_column(table, table.feed_share, 0.123) == 1.0  # exactly, where none is given
    values = trajectory.at_rows(table, s, np.array([1.0, 2.0, 0.5]))
    for place, share in ((0.0, 1.0), (0.025, 1.5), (0.05, 2.0), (0.125, 1.25), (0.2, 0.5), (0.4, 0.5)):
        assert trajectory.sample_column(table, values, place) == pytest.approx(share)


def circle():
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    points = ROUND * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    return build_path_table(points, Rotation.from_euler("z", angle[:, None]).as_matrix())


def play(motion, clock):
    """What a motion does at some moments, shapes (n, 3), (n, 3), (n, 4), (n, 3), (n,), (n,)."""
    out, place = [np.empty((len(clock), width)) for width in (3, 3, 4, 3, 2)], np.empty(2)
    for i, t in enumerate(clock):
        trajectory.sample_motion(motion, float(t), *(rows[i] for rows in out[:4]), place)
        out[4][i] = place
    return Sampled(*out[:4], *out[4].T)


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


def test_velocity_and_spin_are_rates_and_a_feed_that_changes_is_kept_and_slowed_for_in_time():
    table = circle()
    motion = trajectory.time_path(table, PACE)
    assert motion.duration == pytest.approx(table.length / 0.01 + 0.01 / 0.05 + 0.05 / 1.25)  # and one ramp
    assert motion.playing_time == pytest.approx(motion.duration)
    t = np.linspace(0.3, 12.0, 500)
    step = 1e-4
    before, now, after = play(motion, t - step), play(motion, t), play(motion, t + step)
    np.testing.assert_allclose((after.positions - before.positions) / (2 * step), now.velocities, atol=2e-7)
    np.testing.assert_allclose(now.spins, [[0.0, 0.0, 0.01 / ROUND]] * len(t), atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(now.velocities, axis=1), 0.01, rtol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(now.positions, axis=1), ROUND, atol=1e-8)
    s, feed = np.array([0.0, 0.05, 0.06, 0.12]), np.array([2.0, 2.0, 0.5, 0.5])
    motion = trajectory.time_path(with_feed_share(circle(), s, feed), PACE)
    clock = np.arange(len(motion.places)) * motion.spacing
    fed, most = motion.rates * motion.speeds, 0.01 * np.interp(motion.places, s, feed)
    assert np.all(fed <= most * 1.05)  # the feed's corners lie between rows
    assert fed[len(clock) // 8] == pytest.approx(0.02)
    slowing = -np.diff(fed**2) / (2.0 * np.maximum(np.diff(motion.places), 1e-12))
    assert slowing[20:-60].max() < 3.0 * PACE.acceleration
    assert motion.playing_time == pytest.approx(np.trapezoid(1.0 / motion.rates, clock), rel=1e-3)
    for t in np.linspace(0.0, motion.duration, 777):
        assert trajectory.sample_rate(motion, float(t)) == pytest.approx(np.interp(t, clock, motion.rates))


def test_a_sampled_schedule_is_the_schedule_and_its_place_runs_from_the_first_mark_to_the_last():
    """Poses, rates, and how far along the path it has come; point 2 repeats point 1."""
    tips = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.02, 0, 0], [0.03, 0.02, 0], [0.05, 0.02, 0.01]])
    rotations = Rotation.from_rotvec(0.1 * np.outer([0, 1, 1, 3, 4], [1.0, 0.5, 0.2])).as_matrix()
    schedule = fir_schedule(np.array([0.0, 0.5, 1.1]), np.tile([0.5, 0.1, 0.05], (3, 1)))
    smoothed, marks = Smoothed(build_chain(tips, rotations), schedule), np.array([0.0, 0.02, 0.045, 0.07])
    motion = trajectory.time_schedule(smoothed, marks)
    clock = np.linspace(0.0, schedule.end, 400)
    exact = smoothed.sample(clock)
    run = play(motion, clock)
    np.testing.assert_allclose(run.positions, exact.tips[:, 0], atol=2e-8)
    np.testing.assert_allclose(run.velocities, exact.tips[:, 1], atol=3e-5)
    np.testing.assert_allclose(run.spins, exact.spins[:, 0], atol=2e-3)
    R = Rotation.from_quat(run.quaternions, scalar_first=True).as_matrix()
    np.testing.assert_allclose(R, exact.rotations, atol=3e-5)
    s = np.array([0.0, 0.02, 0.02, 0.045, 0.07])
    np.testing.assert_array_equal(s[~repeated_points(tips, rotations)], marks)
    assert motion.places[0] == 0.0
    assert motion.places[-1] == pytest.approx(0.07, abs=1e-12)
    assert np.all(np.diff(motion.places) >= 0.0)
    rate = np.gradient(motion.places, motion.spacing)
    np.testing.assert_allclose(motion.speeds[1:-1], rate[1:-1], atol=2e-4)
    clock = np.arange(len(motion.places)) * motion.spacing
    places = smoothed.places_at(marks, clock)[0]
    np.testing.assert_allclose(places, motion.places, atol=1e-12)


def test_every_derivative_is_the_slope_of_the_one_before_and_the_tool_rests_at_the_ends():
    """On a schedule of up to four segments at once, against finite differences of the pose alone."""
    tips, step = np.random.default_rng(0).normal(size=(7, 3)), 1e-5
    chain = build_chain(tips, Rotation.random(7, random_state=1).as_matrix())
    four = fir_schedule(0.3 * np.arange(6), np.tile([0.6, 0.3, 0.1], (6, 1)))
    drawn = np.random.default_rng(2).uniform(0.0, four.end, 200)
    breaks = np.concatenate([four.starts, four.starts + four.durations])
    times = drawn[np.abs(drawn[:, None] - breaks).min(axis=1) > 1e-3]
    here, after, before = (Smoothed(chain, four).sample(times + h) for h in (0.0, step, -step))
    for k in range(3):
        for found, late, early in zip(here[:2], after[:2], before[:2], strict=True):
            np.testing.assert_allclose(found[:, k + 1], (late[:, k] - early[:, k]) / (2 * step), atol=1e-6)
    spins = (after.spins - before.spins)[:, :2] / (2 * step)
    np.testing.assert_allclose(here.spins[:, 1:], spins, atol=1e-5)
    turned = Rotation.from_matrix(after.rotations @ np.swapaxes(before.rotations, 1, 2)).as_rotvec()
    np.testing.assert_allclose(here.spins[:, 0], turned / (2 * step), atol=1e-7)
    np.testing.assert_array_equal(here.axes[:, 0], here.rotations[:, :, 2])
    alone = Schedule(np.array([0]), np.zeros(1), np.ones(1), np.array([[0.0, 0.0, 3.0, -2.0]]), 1.0)
    flat = chain._replace(rolls=np.zeros(6))
    here = Smoothed(flat, alone).sample(np.linspace(0.0, 1.0, 20)[1:-1])
    np.testing.assert_allclose(turning(here.axes), here.spins, atol=1e-12)
    here = Smoothed(chain, four).sample(np.array([-1.0, four.end + 1e-9, four.end + 1.0]))
    np.testing.assert_allclose(here.tips[:, 0], chain.tips[[0, -1, -1]], atol=1e-15)
    np.testing.assert_allclose(here.rotations, chain.rotations[[0, -1, -1]], atol=1e-15)
    np.testing.assert_array_equal(here.tips[:, 1:], 0.0)
    np.testing.assert_array_equal(here.spins, 0.0)
