"""Where patterns run: spiral, contour, connected Fermat spirals, raster (paper 1, section 1.3, fig. 6)."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from polish_sim.arrays import turns_along
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import fit_surface, part_from_arrays, select_region
from polish_sim.planning import plan_path
from polish_sim.planning.curve import Curve
from polish_sim.planning.ground import footprint
from polish_sim.planning.patterns.nested import without_tails
from polish_sim.planning.patterns.pitch import match_turns, spread_shares
from polish_sim.planning.patterns.raster import _short_axis
from tests.planning.shapes import UP, circle, level, region_of, shipped_plan

STEP = 0.008


@pytest.mark.parametrize(
    ("pattern", "order", "direction", "side"),
    [
        ("spiral", "inward", "conventional", 1.0), ("spiral", "outward", "climb", -1.0),
        ("contour", "inward", "climb", -1.0), ("contour", "outward", "conventional", 1.0),
    ],
)  # fmt: skip
def test_what_is_not_done_yet_lies_on_the_left_or_on_the_right(pattern, order, direction, side):
    """Inwards on a cap that is the middle, outwards the border."""
    plan = PlanConfig(pattern=pattern, stepover_m=STEP, order=order, direction=direction)
    path = plan_path(region_of("sphere_100"), plan)
    points = path.positions_work[path.process]
    inwards = order == "inward"
    radius = np.linalg.norm(points[:, :2], axis=1)
    assert (radius[0] > radius[-1]) == inwards
    to_what_is_left = (-1.0 if inwards else 1.0) * points * [1.0, 1.0, 0.0]
    left = np.cross(UP, np.gradient(points, axis=0))
    assert (side * (left * to_what_is_left).sum(axis=1) > 0.0).mean() > 0.95
    if pattern == "contour":
        passes = path.pass_index[path.process]
        for loop in (points[passes == number] for number in np.unique(passes)):
            again = (loop == loop[0]).all(axis=1)
            assert again.sum() == 2
            radius = np.linalg.norm(loop[: np.flatnonzero(again)[1] + 1, :2], axis=1)
            assert np.ptp(radius) < 0.02 * STEP + 0.02 * radius.mean()


def test_the_spiral_becomes_archimedean_turn_by_turn():
    """Spacing of neighbouring rounds away from the step: one step-over but for 4% of it."""
    radii = 0.3 - STEP * np.arange(20)
    curves = [level(circle(r, count=2000), closed=True) for r in radii]
    matches = [match_turns(a, b, 0.0, 0.0, STEP) for a, b in pairwise(curves)]
    shares = spread_shares([c.length for c in curves], matches, 0.03, False, STEP)
    phase = np.linspace(0.1, 0.9, 50)
    heights = np.array([i + s.at(phase * s.length) for i, s in enumerate(shares)])
    assert heights[0] == pytest.approx(np.zeros(50), abs=1e-9)
    assert np.diff(heights, axis=0) == pytest.approx(np.ones((19, 50)), abs=0.041)
    slopes = np.ptp(heights, axis=1) / 0.8
    assert np.diff(slopes).min() > -1e-9
    assert slopes[14] == pytest.approx(1.0, abs=0.05)


def test_a_fermat_spiral_ends_beside_its_beginning_and_its_turns_have_no_tails():
    path = shipped_plan("freeform", "fermat").path
    radius = np.linalg.norm(path.positions_work[path.process][:, :2], axis=1)
    assert radius[0] == pytest.approx(0.1 - 0.5 * STEP, abs=1e-3)
    assert radius[-1] == pytest.approx(0.1 - 1.5 * STEP, abs=1e-3)
    assert 0.4 < radius.argmin() / len(radius) < 0.6
    out = np.column_stack([np.linspace(0.02, 0.04, 40), np.full(40, 2e-4), np.zeros(40)])
    body = circle(0.02)[5:-5]
    points = np.concatenate([body, out * [1.0, -1.0, 1.0], out[::-1]])
    tailed = level(points, closed=True)
    trimmed = without_tails(tailed, 0.3 * STEP)
    assert np.linalg.norm(trimmed.positions, axis=1).max() < 0.025
    assert trimmed.length == pytest.approx(2.0 * np.pi * 0.02, rel=0.05)
    ring = level(circle(0.02), closed=True)
    assert without_tails(ring, 0.3 * STEP).length == ring.length


def test_the_first_turn_runs_half_a_step_over_inside_and_none_is_tighter_than_a_third():
    plan = shipped_plan("saddle")
    outer = plan.region.boundary_loops[0]
    border = Curve(outer[:-1], np.tile(UP, (len(outer) - 1, 1)), True)
    first = plan.path.positions_work[plan.path.process & (plan.path.pass_index == plan.path.pass_index.min())]
    distance = border.nearest(first[: int(0.85 * len(first))]).distances
    # Corners reach out a little; towards its end the turn begins to drift inwards.
    assert np.median(distance) == pytest.approx(0.5 * STEP, rel=0.02)
    assert np.percentile(distance, [5.0, 95.0]) == pytest.approx([0.5 * STEP] * 2, abs=0.06 * STEP)
    # U-turns have a radius of half a step-over; slanted ends and corners are rounded a little tighter.
    for name in ("plate", "cylinder"):
        path = shipped_plan(name, "raster").path
        points = path.positions_work[path.process]
        curve = level(points)
        even = curve.points(np.arange(0.0, curve.length, 1e-3))
        sharp = np.flatnonzero(turns_along(np.diff(even, axis=0)) > 1e-3 / (0.4 * STEP))
        # Only the four corners of the border turn, which follow the part's own.
        edges = 0.5 * np.ptp(points[:, :2], axis=0) - 1.5 * STEP
        assert (np.abs(even[sharp + 1, :2]) > edges).all(axis=1).all()


def test_lines_on_a_plate_are_parallel_and_a_step_over_apart_along_the_part_s_long_axis():
    plan = PlanConfig(pattern="raster", stepover_m=STEP, raster_direction=(0.0, 1.0, 0.0))
    path = plan_path(region_of("plate"), plan)
    points = path.positions_work[path.process]
    across = np.flatnonzero(np.diff(np.sign(points[:, 1])) != 0)
    places = np.sort(points[across, 0])
    assert len(places) > 20
    # The outermost two on either side are the border turn and its distance to the first line.
    assert np.diff(places)[1:-1] == pytest.approx(STEP, rel=1e-3)
    with pytest.raises(PlanError, match="lines cannot run along"):  # the way the region looks
        plan_path(region_of("plate"), replace(plan, raster_direction=(0.0, 0.0, 1.0)))
    assert np.abs(_short_axis(region_of("cylinder"))) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    turn = Rotation.random(random_state=1)
    box = trimesh.creation.box((0.2, 0.12, 0.05))
    up = ",".join(str(value) for value in turn.apply([0.0, 0.0, 1.0]))
    mesh = part_from_arrays(turn.apply(box.vertices), box.faces, up=up)
    seen = footprint(select_region(fit_surface(mesh), mesh, "top"))
    assert seen.widths.min() == pytest.approx(0.12, abs=1e-12)
    narrowest = seen.frame @ seen.ways[int(seen.widths.argmin())]
    assert abs(narrowest @ turn.apply([0.0, 1.0, 0.0])) == pytest.approx(1.0)
