"""Strokes of two robots above the part: corners are slowed for, gentle bends are not, what is never fed is left out."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from polish_sim.config import Scenario
from polish_sim.dual.strokes import air_limits, pair_strokes
from polish_sim.experiments import default_scenario
from polish_sim.experiments.part_setup import PlacedTool
from polish_sim.motion.timed_path import TimedPath
from polish_sim.planning import ToolPath
from polish_sim.planning.toolpath import PROCESS, arc_length
from polish_sim.scenario_file import override

FEED = 0.05


def scenario(*changes: str) -> Scenario:
    return override(default_scenario("dual"), [f"process.feed_m_s={FEED}", "dual.standoff_m=0.005", *changes])


def flat(points: NDArray[np.float64]) -> ToolPath:
    n = len(points)
    up, none = np.tile([0.0, 0.0, 1.0], (n, 1)), np.zeros(n, dtype=np.int64)
    segment = np.full(n, PROCESS, dtype=np.int8)
    return ToolPath(points, up, arc_length(points), none, segment, np.zeros(n))


def square() -> ToolPath:
    """Three sides of 100 mm, a point every millimetre."""
    side = np.linspace(0.0, 0.1, 101)
    ways = [np.stack([side, 0.0 * side]), np.stack([0.1 + 0.0 * side, side]), np.stack([0.1 - side, 0.1 + 0.0 * side])]
    points = np.concatenate([ways[0].T, ways[1].T[1:], ways[2].T[1:]])
    return flat(np.column_stack([points, np.zeros(len(points))]))


def motion_of(path: ToolPath, *changes: str) -> TimedPath:
    placed = PlacedTool(np.eye(4), np.tile(np.diag([1.0, -1.0, -1.0]), (len(path.s), 1, 1)), None)
    (stroke,) = pair_strokes(scenario(*changes), path, placed)
    return stroke.motion


def test_above_the_part_corners_are_slowed_for_and_passed_within_the_tolerance() -> None:
    motion, corner = motion_of(square()), np.array([0.1, 0.0, 0.0])
    change = np.linalg.norm(np.gradient(motion.velocities, motion.spacing, axis=0), axis=1)
    assert change.max() <= 1.02 * air_limits(FEED).tip_acceleration
    missed = np.linalg.norm(motion.positions - corner, axis=1).min()
    assert 0.0 < missed <= 1.01 * scenario().smoothing.tolerance_m
    assert motion.speeds.max() == pytest.approx(FEED, rel=1e-3)


def test_bends_gentle_enough_are_passed_at_the_feed_on_the_way_points() -> None:
    angle = np.linspace(0.0, np.pi, 200)
    motion = motion_of(flat(0.08 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)))
    # From rest in 0.54 s and to rest, as a feed without bends.
    assert motion.duration == pytest.approx(0.08 * np.pi / FEED + 0.54, abs=1e-3)


@pytest.mark.parametrize("standoff", [0.0, 0.005])
def test_what_is_not_come_to_before_the_feed_ends_is_not_planned(standoff: float) -> None:
    changes = ("process.max_feed_s=1", f"dual.standoff_m={standoff}")
    motion = motion_of(square(), *changes)
    assert 1.0 * FEED + 0.02 < motion.places[-1] < 2.0 * FEED + 0.003
    # As far as it is fed it is the motion along all of the path.
    whole = motion_of(square(), f"dual.standoff_m={standoff}")
    rows = round(1.0 / whole.spacing)
    times = np.arange(rows) * whole.spacing
    cut = np.interp(times, np.arange(len(motion.places)) * motion.spacing, motion.places)
    np.testing.assert_allclose(cut, whole.places[:rows], atol=2e-4)
