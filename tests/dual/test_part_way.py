"""How the master moves the part, and the follower's strokes above it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.config import Scenario
from polish_sim.dual.carrier import RAMP_PEAK
from polish_sim.dual.master import PartWay, about_axis, along_arc
from polish_sim.dual.strokes import air_limits, pair_strokes
from polish_sim.experiments import default_scenario
from polish_sim.experiments.part_setup import PlacedTool
from polish_sim.motion.trajectory import TimedPath
from polish_sim.planning import ToolPath
from polish_sim.scenario_file import override
from polish_sim.spatial import apply, from_pose, inverse
from tests.planning.shapes import path_through

START = from_pose([-0.5, 0.1, 0.3, 0.3, -0.2, 0.5])
TIMES = np.linspace(0.0, 4.0, 81)
VELOCITY = np.array([0.02, -0.01, 0.005])


@pytest.mark.parametrize("bend", [0.7, -0.4, 1e-9])
def test_an_arc_stays_on_its_circle_to_the_left_or_right(bend):
    shift = along_arc(VELOCITY, bend)(TIMES)
    speed = np.linalg.norm(VELOCITY[:2])
    left = np.array([-VELOCITY[1], VELOCITY[0]]) / speed
    middle = speed / bend * left
    np.testing.assert_allclose(np.linalg.norm(shift[:, :2] - middle, axis=1), abs(speed / bend), rtol=1e-9)
    np.testing.assert_allclose(shift[:, 2], VELOCITY[2] * TIMES, atol=1e-15)
    steps = np.linalg.norm(np.diff(shift[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(steps, speed * 0.05 * np.sinc(0.5 * bend * 0.05 / np.pi), rtol=1e-12)
    np.testing.assert_allclose((shift[1] - shift[0])[:2] / 0.05, VELOCITY[:2], atol=5e-4)


def test_a_way_that_turns_back_is_the_way_until_then_and_no_steeper_than_from_rest():
    leg, times = 5.0, np.linspace(0.0, 60.0, 60_001)
    turned = along_arc(VELOCITY, 0.2, leg)(times)
    straight = times <= leg
    np.testing.assert_array_equal(turned[straight], along_arc(VELOCITY, 0.2)(times[straight]))
    line = along_arc(VELOCITY, 0.0, leg)(times)[:, 0] / VELOCITY[0]
    assert line.min() >= -1.0 / RAMP_PEAK - 1e-9
    assert line.max() <= leg + 1.0 / RAMP_PEAK + 1e-9
    rate = np.diff(line) / 1e-3
    change = np.diff(rate) / 1e-3
    assert np.abs(rate).max() <= 1.0 + 1e-9
    assert np.abs(rate[::100]).min() < 0.1 < np.mean(np.abs(rate) > 0.999)
    assert np.abs(change).max() <= RAMP_PEAK + 1e-4
    # The acceleration has no step: two and more derivatives are continuous.
    assert np.abs(np.diff(change)).max() < 0.01 * RAMP_PEAK


def test_a_turn_leaves_every_point_of_its_axis_where_it_is():
    axis, center = np.array([0.6, 0.0, 0.8]), np.array([0.03, -0.02, 0.04])
    poses = PartWay(along_arc(np.zeros(3), 0.0), about_axis(axis, center, 0.5))(START, TIMES)
    for place in (center, center + 0.1 * axis):
        there = np.array([apply(T, place[None])[0] for T in poses])
        np.testing.assert_allclose(there, np.broadcast_to(there[0], there.shape), atol=1e-15)
    turned = Rotation.from_matrix((inverse(START) @ poses)[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(turned, 0.5 * TIMES[:, None] * axis, atol=1e-12)


FEED = 0.05


def scenario(*changes: str) -> Scenario:
    return override(default_scenario("dual"), [f"process.feed_m_s={FEED}", "dual.standoff_m=0.005", *changes])


def square() -> ToolPath:
    """Three sides of 100 mm, a point every millimetre."""
    way = np.linspace(0.0, 3.0, 301)
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
    points = np.stack([np.interp(way, np.arange(4.0), column) for column in corners.T], axis=1)
    return path_through(points)


def motion_of(path: ToolPath, *changes: str) -> TimedPath:
    placed = PlacedTool(np.eye(4), np.tile(np.diag([1.0, -1.0, -1.0]), (len(path.s), 1, 1)), None)
    (stroke,) = pair_strokes(scenario(*changes), path, placed)
    return stroke.motion


def test_above_the_part_corners_are_slowed_for_and_passed_within_the_tolerance():
    motion, corner = motion_of(square()), np.array([0.1, 0.0, 0.0])
    change = np.linalg.norm(np.gradient(motion.velocities, motion.spacing, axis=0), axis=1)
    assert change.max() <= 1.02 * air_limits(FEED).tip_acceleration
    missed = np.linalg.norm(motion.positions - corner, axis=1).min()
    assert 0.0 < missed <= 1.01 * scenario().smoothing.tolerance_m
    assert motion.speeds.max() == pytest.approx(FEED, rel=1e-3)


@pytest.mark.parametrize("standoff", [0.0, 0.005])
def test_what_is_not_come_to_before_the_feed_ends_is_not_planned(standoff):
    changes = ("process.max_feed_s=1", f"dual.standoff_m={standoff}")
    motion = motion_of(square(), *changes)
    assert 1.0 * FEED + 0.02 < motion.places[-1] < 2.0 * FEED + 0.003
    # As far as it is fed it is the motion along all of the path.
    whole = motion_of(square(), f"dual.standoff_m={standoff}")
    rows = round(1.0 / whole.spacing)
    times = np.arange(rows) * whole.spacing
    cut = np.interp(times, np.arange(len(motion.places)) * motion.spacing, motion.places)
    np.testing.assert_allclose(cut, whole.places[:rows], atol=2e-4)
