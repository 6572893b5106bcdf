"""How a part is moved: along lines, arcs and about axes against closed forms, through poses with smooth derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.dual.master import PartWay, about_axis, along_arc, through_poses
from polish_sim.spatial import apply, from_pose, inverse, transform

START = from_pose([-0.5, 0.1, 0.3, 0.3, -0.2, 0.5])
TIMES = np.linspace(0.0, 4.0, 81)
STILL = about_axis(np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.0)
VELOCITY = np.array([0.02, -0.01, 0.005])


def test_a_line_is_at_constant_speed_and_keeps_the_orientation() -> None:
    poses = PartWay(along_arc(VELOCITY, 0.0), STILL)(START, TIMES)
    np.testing.assert_allclose(poses[:, :3, 3], START[:3, 3] + TIMES[:, None] * VELOCITY, atol=1e-15)
    np.testing.assert_allclose(poses[:, :3, :3], np.broadcast_to(START[:3, :3], (81, 3, 3)), atol=1e-15)


@pytest.mark.parametrize("bend", [0.7, -0.4, 1e-9])
def test_an_arc_stays_on_its_circle_to_the_left_or_right(bend: float) -> None:
    shift = along_arc(VELOCITY, bend)(TIMES)
    speed = np.linalg.norm(VELOCITY[:2])
    left = np.array([-VELOCITY[1], VELOCITY[0]]) / speed
    middle = speed / bend * left
    np.testing.assert_allclose(
        np.linalg.norm(shift[:, :2] - middle, axis=1), abs(speed / bend), rtol=1e-9
    )  # fmt: skip
    np.testing.assert_allclose(shift[:, 2], VELOCITY[2] * TIMES, atol=1e-15)
    steps = np.linalg.norm(np.diff(shift[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(steps, speed * 0.05 * np.sinc(0.5 * bend * 0.05 / np.pi), rtol=1e-12)
    np.testing.assert_allclose((shift[1] - shift[0])[:2] / 0.05, VELOCITY[:2], atol=5e-4)


def test_a_turn_leaves_every_point_of_its_axis_where_it_is() -> None:
    axis, center = np.array([0.6, 0.0, 0.8]), np.array([0.03, -0.02, 0.04])
    poses = PartWay(along_arc(np.zeros(3), 0.0), about_axis(axis, center, 0.5))(START, TIMES)
    for place in (center, center + 0.1 * axis):
        there = np.array([apply(T, place[None])[0] for T in poses])
        np.testing.assert_allclose(there, np.broadcast_to(there[0], there.shape), atol=1e-15)
    turned = Rotation.from_matrix((inverse(START) @ poses)[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(turned, 0.5 * TIMES[:, None] * axis, atol=1e-12)


def wave(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """A motion that is known everywhere, shape (n, 4, 4)."""
    places = np.stack([0.1 * np.sin(times), 0.05 * np.cos(0.8 * times), 0.02 * times], axis=1)
    turns = Rotation.from_rotvec(np.stack([0.3 * np.sin(times), 0.0 * times, 0.5 * times], axis=1))
    return transform(START[:3, :3] @ turns.as_matrix(), places)


def test_a_motion_through_poses_meets_them_and_what_lies_between_to_fourth_order() -> None:
    off = []
    for count in (21, 41):
        rows = np.linspace(0.0, 4.0, count)
        way = through_poses(rows, wave(rows))
        np.testing.assert_allclose(way(wave(rows)[0], rows), wave(rows), atol=1e-9)
        inner = np.linspace(1.0, 3.0, 333)
        off.append(float(np.abs(way(wave(rows)[0], inner) - wave(inner)).max()))
    assert off[0] < 2e-5
    assert off[1] < 0.1 * off[0]


def test_a_motion_through_poses_has_no_step_in_speed_or_acceleration_and_stays_at_its_end() -> None:
    rows = np.linspace(0.0, 4.0, 9)
    way = through_poses(rows, wave(rows))
    h = 1e-3
    around = rows[4] + h * np.arange(-3, 4)
    poses = way(START, around)
    for values in (poses[:, :3, 3], poses[:, :3, 0]):
        change = np.diff(values, n=3, axis=0) / h**2
        # A step of the acceleration would show here in full.
        assert np.abs(change).max() < 0.01
    np.testing.assert_array_equal(way(START, np.array([4.0, 5.0]))[0], way(START, np.array([4.0, 5.0]))[1])
    assert way.lasts == 4.0
