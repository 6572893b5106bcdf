"""Raster: lines side by side, rounded turns, and a turn along the border."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import fit_surface, part_from_arrays, select_region
from polish_sim.planning.ground.ground import footprint
from polish_sim.planning.patterns.raster import _short_axis
from polish_sim.planning.patterns.raster_walk import fillet
from polish_sim.planning.planner import plan_path
from tests.planning.shapes import region_of, shipped_plan

STEP = 0.008


def headings(path):
    """Unit steps along the path in contact."""
    steps = np.diff(path.positions_work[path.process], axis=0)
    return steps / np.linalg.norm(steps, axis=1, keepdims=True)


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
        plan_path(
            region_of("plate"),
            PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(0.0, 0.0, 1.0)),
        )


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


def test_a_fillet_is_the_arc_that_touches_both_arms():
    start, corner, end = np.array([1.0, 0.0, 0.0]), np.zeros(3), np.array([0.0, 1.0, 0.0])
    arc = fillet(start, corner, end)
    assert np.linalg.norm(arc - [1.0, 1.0, 0.0], axis=1) == pytest.approx(np.ones(len(arc)), abs=1e-12)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_top_of_a_box_is_as_wide_as_its_short_side(seed):
    turn = Rotation.random(random_state=seed)
    box = trimesh.creation.box((0.2, 0.12, 0.05))
    up = ",".join(str(value) for value in turn.apply([0.0, 0.0, 1.0]))
    mesh = part_from_arrays(turn.apply(box.vertices), box.faces, up=up)
    seen = footprint(select_region(fit_surface(mesh), mesh, "top"))
    assert seen.widths.min() == pytest.approx(0.12, abs=1e-12)
    narrowest = seen.frame @ seen.ways[int(seen.widths.argmin())]
    assert abs(narrowest @ turn.apply([0.0, 1.0, 0.0])) == pytest.approx(1.0)
