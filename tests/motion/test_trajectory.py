"""A path as a callable of arc length, against a helix whose every derivative is known."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.motion import trajectory

RADIUS, PITCH = 0.1, 0.02  # of the helix [m], [m/rad]
SPEED = float(np.hypot(RADIUS, PITCH))  # arc length per turn angle [m/rad]


class Sample(NamedTuple):
    """A place on a path."""

    position: np.ndarray
    tangent: np.ndarray
    quaternion: np.ndarray
    turning: np.ndarray
    row: int


def sample(table: trajectory.PathTable, s: float) -> Sample:
    position, tangent, quaternion, turning = np.zeros(3), np.zeros(3), np.zeros(4), np.zeros(3)
    row = trajectory.sample_path(table, s, position, tangent, quaternion, turning)
    return Sample(position, tangent, quaternion, turning, row)


def helix(angle: np.ndarray) -> np.ndarray:
    return np.stack([RADIUS * np.cos(angle), RADIUS * np.sin(angle), PITCH * angle], axis=1)


@pytest.fixture(scope="module")
def table() -> trajectory.PathTable:
    """Two turns of a helix, the tool's frame turning with it about z: its quaternions jump in sign."""
    angle = np.linspace(0.0, 4.0 * np.pi, 800)
    frames = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    return trajectory.build_path_table(helix(angle), frames, s=SPEED * angle, curvature=10.0 + angle)


def test_positions_tangents_and_frames_are_the_helixs(table):
    assert table.length == pytest.approx(4.0 * np.pi * SPEED)
    assert table.spacing <= 0.0005
    for angle in np.random.default_rng(0).uniform(0.3, 4.0 * np.pi - 0.3, 200):
        found = sample(table, SPEED * angle)
        np.testing.assert_allclose(found.position, helix(np.array([angle]))[0], atol=1e-8)
        direction = np.array([-RADIUS * np.sin(angle), RADIUS * np.cos(angle), PITCH]) / SPEED
        np.testing.assert_allclose(found.tangent, direction, atol=1e-5)
        frame = Rotation.from_quat(found.quaternion, scalar_first=True)
        assert (frame * Rotation.from_rotvec([0.0, 0.0, -angle])).magnitude() < 1e-6
        np.testing.assert_allclose(found.turning, [0.0, 0.0, 1.0 / SPEED], rtol=1e-4, atol=1e-9)


def test_beyond_its_ends_it_stays_at_them(table):
    for outside, inside in ((-1.0, 0.0), (table.length + 1.0, table.length)):
        for left, right in zip(sample(table, outside), sample(table, inside), strict=True):
            np.testing.assert_array_equal(left, right)
    end = helix(np.array([4.0 * np.pi]))[0]
    np.testing.assert_allclose(sample(table, table.length).position, end, atol=1e-12)


def test_a_single_pose_is_a_path_of_no_length():
    point, frame = np.array([[0.1, 0.2, 0.3]]), Rotation.random(random_state=0).as_matrix()[None]
    table = trajectory.build_path_table(point, frame)
    assert table.length == 0.0
    found = sample(table, 0.5)
    np.testing.assert_allclose(found.position, point[0], atol=1e-15)
    np.testing.assert_allclose(found.turning, 0.0, atol=1e-12)
    R = Rotation.from_quat(found.quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(R, frame[0], atol=1e-12)


def test_a_pressed_path_is_asked_for_by_the_arc_length_of_the_surface():
    """The part bends like a cylinder; pressed in by 4 mm the points move on a shorter radius."""
    angle = np.linspace(0.0, 1.0, 200)
    on_part = np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)])
    table = trajectory.build_path_table(0.096 * on_part, np.tile(np.eye(3), (200, 1, 1)), s=0.1 * angle)
    assert table.length == pytest.approx(0.1)
    np.testing.assert_allclose(np.linalg.norm(sample(table, 0.05).tangent), 0.96, atol=1e-6)


def test_turns_and_curvature_belong_to_their_place_and_repeated_points_are_dropped():
    x = np.repeat(np.linspace(0.0, 0.1, 11), [1, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1])
    number = np.round(100.0 * x).astype(np.int64)
    points, frames = np.column_stack([x, 0 * x, 0 * x]), np.tile(np.eye(3), (12, 1, 1))
    table = trajectory.build_path_table(points, frames, curvature=100.0 * x, pass_index=number)
    row = sample(table, 0.0425).row
    assert table.pass_index[row] == 4
    assert table.curvature[row] == pytest.approx(100.0 * row * table.spacing)
    assert table.pass_index[-1] == 10


LINE = np.outer(np.linspace(0.0, 0.2, 41), [1.0, 0.0, 0.0])


def test_values_are_linear_between_the_points_they_were_given_at():
    s, table = np.array([0.3, 0.35, 0.5]), trajectory.build_path_table(LINE, np.tile(np.eye(3), (41, 1, 1)))
    assert trajectory.sample_column(table, table.feed_share, 0.123) == 1.0  # exactly, where none is given
    values = trajectory.at_rows(table, s, np.array([1.0, 2.0, 0.5]))
    for place, share in ((0.0, 1.0), (0.025, 1.5), (0.05, 2.0), (0.125, 1.25), (0.2, 0.5), (0.4, 0.5)):
        assert trajectory.sample_column(table, values, place) == pytest.approx(share)


def test_before_a_slow_place_the_feed_falls_in_time():
    """From feed 1 to 0.2 at 12 per metre: the square falls by 24 per metre, over 40 mm before the place."""
    s = np.linspace(0.0, 0.2, 401)
    straight = trajectory.build_path_table(LINE, np.tile(np.eye(3), (41, 1, 1)))
    table = trajectory.with_feed_share(straight, s, np.where(s < 0.1, 1.0, 0.2))
    nodes = np.arange(len(table.positions)) * table.spacing
    feed = trajectory.slowed_before(table.feed_share, np.full_like(table.feed_share, 24.0 * table.spacing))
    assert np.diff(feed**2).min() >= -24.0 * table.spacing - 1e-12
    before = nodes < 0.1
    wanted = np.sqrt(np.minimum(1.0, 0.04 + 24.0 * np.maximum(0.1 - nodes[before], 0.0)))
    assert feed[before] == pytest.approx(wanted, abs=0.02)
    assert feed[~before] == pytest.approx(np.full((~before).sum(), 0.2))
