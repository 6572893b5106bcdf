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
from polish_sim.planning.planner import plan_path
from tests.planning.shapes import region_of, shipped_plan

STEP = 0.008


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


def test_lines_along_the_way_the_region_looks_are_refused():
    with pytest.raises(PlanError, match="lines cannot run along"):
        plan_path(
            region_of("plate"),
            PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(0.0, 0.0, 1.0)),
        )


def test_the_long_axis_is_the_part_s():
    assert np.abs(_short_axis(region_of("cylinder"))) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)


def test_the_top_of_a_turned_box_is_as_wide_as_its_short_side():
    turn = Rotation.random(random_state=1)
    box = trimesh.creation.box((0.2, 0.12, 0.05))
    up = ",".join(str(value) for value in turn.apply([0.0, 0.0, 1.0]))
    mesh = part_from_arrays(turn.apply(box.vertices), box.faces, up=up)
    seen = footprint(select_region(fit_surface(mesh), mesh, "top"))
    assert seen.widths.min() == pytest.approx(0.12, abs=1e-12)
    narrowest = seen.frame @ seen.ways[int(seen.widths.argmin())]
    assert abs(narrowest @ turn.apply([0.0, 1.0, 0.0])) == pytest.approx(1.0)
