"""Raster: lines side by side, rounded turns, and a turn along the border."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.planning.patterns.raster import _short_axis
from polish_sim.planning.patterns.raster_walk import fillet
from polish_sim.planning.planner import plan_path
from tests.planning.shapes import plan_of, prism, region_of, shipped_plan

STEP = 0.008
WHOLE = ["freeform", "saddle", "sphere_100", "plate", "cylinder"]


def headings(path):
    """Unit steps along the path in contact."""
    steps = np.diff(path.positions_work[path.process], axis=0)
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


@pytest.mark.parametrize("name", WHOLE)
def test_a_part_without_holes_is_one_stroke(name):
    figures = shipped_plan(name, "raster").figures
    assert figures["retracts"] == 1
    assert figures["self_crossings"] == 0
    assert figures["coverage_stepover"] >= 0.995
    assert figures["max_distance_to_surface_m"] < 1e-9


@pytest.mark.parametrize("name", ["wheel_hub_rim", "plate_two_holes"])
def test_around_holes_it_lifts_a_few_times(name):
    figures = shipped_plan(name, "raster").figures
    assert figures["retracts"] <= 4
    assert figures["self_crossings"] == 0
    assert figures["coverage_stepover"] >= 0.99


def test_lines_on_a_plate_are_parallel_and_one_step_over_apart():
    plan = PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(0.0, 1.0, 0.0))
    path = plan_path(region_of("plate"), plan)
    points = path.positions_work[path.process]
    across = np.flatnonzero(np.diff(np.sign(points[:, 1])) != 0)
    places = np.sort(points[across, 0])
    assert len(places) > 20
    # The outermost two on either side are the border turn and its distance to the first line.
    assert np.diff(places)[1:-1] == pytest.approx(STEP, rel=1e-3)


def test_no_turn_is_tighter_than_a_third_of_a_step_over():
    """U-turns have a radius of half a step-over; slanted ends and corners are rounded a little tighter."""
    for name in ("plate", "cylinder"):
        path = shipped_plan(name, "raster").path
        points = path.positions_work[path.process]
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        even = np.stack([np.interp(np.arange(0.0, s[-1], 1e-3), s, points[:, k]) for k in range(3)], axis=1)
        way = np.diff(even, axis=0)
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        angle = np.arccos(np.clip((way[1:] * way[:-1]).sum(axis=1), -1.0, 1.0))
        sharp = np.flatnonzero(angle > 1e-3 / (0.4 * STEP))
        # Only the four corners of the border turn, which follow the part's own.
        edges = 0.5 * np.ptp(points[:, :2], axis=0) - 1.5 * STEP
        assert (np.abs(even[sharp + 1, :2]) > edges).all(axis=1).all()


def test_lines_run_the_way_they_are_told():
    plan = PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(1.0, 1.0, 0.3))
    way = headings(plan_path(region_of("sphere_100"), plan))
    flat = way[:, :2] / np.linalg.norm(way[:, :2], axis=1, keepdims=True)
    share = (np.abs(flat @ [0.5**0.5, 0.5**0.5]) > np.cos(np.radians(12.0))).mean()
    assert share > 0.55


def test_lines_along_the_way_the_region_looks_are_refused():
    with pytest.raises(PlanError, match="lines cannot run along"):
        plan_path(region_of("plate"), PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(0.0, 0.0, 1.0)))


def test_the_long_axis_is_the_part_s_and_turns_with_it():
    region = region_of("cylinder")
    assert np.abs(_short_axis(region)) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    for name in ("cylinder", "plate", "sphere_100", "freeform"):
        region = region_of(name)
        turned = Turned(region.surface.vertices @ turn.T, turn @ region.up)
        assert _short_axis(turned) == pytest.approx(turn @ _short_axis(region), abs=1e-6), name


class Turned:
    """What the axis is found from, turned."""

    def __init__(self, vertices, up):
        self.surface, self.up = self, up
        self.vertices = vertices


def test_a_raster_begins_on_the_side_asked_for():
    begins = []
    for x in (-0.08, 0.08):
        plan = PlanConfig(pattern="raster", stepover_m=STEP, start=(x, 0.05, 0.04), raster_direction=(0.0, 1.0, 0.0))
        path = plan_path(region_of("cylinder"), plan)
        begins.append(path.positions_work[path.process][0, 0])
    assert begins[0] < -0.05
    assert begins[1] > 0.05


def test_a_fillet_is_the_arc_that_touches_both_arms():
    start, corner, end = np.array([1.0, 0.0, 0.0]), np.zeros(3), np.array([0.0, 1.0, 0.0])
    arc = fillet(start, corner, end)
    assert np.linalg.norm(arc - [1.0, 1.0, 0.0], axis=1) == pytest.approx(np.ones(len(arc)), abs=1e-12)


def test_a_plate_with_a_notch_is_covered(tmp_path):
    notched = prism(lambda x, y: (np.abs(x) > 20) | (y < 10), 160.0)
    plan = PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(1.0, 0.0, 0.0))
    figures = plan_of(notched, tmp_path / "notched.stl", plan).figures
    assert figures["self_crossings"] == 0
    assert figures["retracts"] <= 2
    assert figures["coverage_stepover"] > 0.99
