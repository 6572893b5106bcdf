"""Connected Fermat spirals: one stroke over any region, covered, never crossing itself."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PlanConfig
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.ground.ground import prepare_ground
from polish_sim.planning.patterns.fermat import connect
from polish_sim.planning.patterns.fermat_pocket import find_contacts, grow_tree
from polish_sim.planning.patterns.nested import all_turns, nested_turns, without_tails
from polish_sim.planning.patterns.run import PatternRequest
from polish_sim.planning.planner import plan_path
from tests.planning.shapes import plan_of, prism, region_of, shipped_plan

STEP = 0.008
PARTS = ["freeform", "saddle", "sphere_100", "wheel_hub_rim", "plate", "plate_two_holes"]


def circle(radius, centre=(0.0, 0.0)):
    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    points = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(400)]) * radius + [*centre, 0.0]
    return Curve(points, np.tile([0.0, 0.0, 1.0], (400, 1)), True)


@pytest.mark.parametrize("name", PARTS)
def test_a_part_with_holes_or_without_is_covered_in_one_stroke(name):
    figures = shipped_plan(name, "fermat").figures
    assert figures["retracts"] == 1
    assert figures["self_crossings"] == 0
    assert figures["coverage_stepover"] >= 0.995
    assert figures["max_distance_to_surface_m"] < 1e-9


@pytest.mark.parametrize("name", ["freeform", "plate", "wheel_hub_rim"])
def test_a_fermat_spiral_is_about_as_long_as_the_area_over_the_step_over(name):
    figures = shipped_plan(name, "fermat").figures
    assert figures["path_length_m"] * STEP == pytest.approx(figures["area_m2"], rel=0.05)


def test_a_fermat_spiral_ends_beside_its_beginning_on_the_border():
    path = shipped_plan("freeform", "fermat").path
    stroke = path.positions_work[path.process]
    radius = np.linalg.norm(stroke[:, :2], axis=1)
    assert radius[0] == pytest.approx(0.1 - 0.5 * STEP, abs=1e-3)
    assert radius[-1] == pytest.approx(0.1 - 1.5 * STEP, abs=1e-3)
    assert 0.4 < radius.argmin() / len(radius) < 0.6


def test_a_fermat_spiral_begins_about_where_asked():
    start = (0.0, -0.1, 0.03)
    path = plan_path(region_of("freeform"), PlanConfig(pattern="fermat", stepover_m=STEP, start=start))
    assert np.linalg.norm(path.positions_work[path.process][0] - start) < 5.0 * STEP


def test_an_arm_and_a_neck_are_one_stroke_each_and_an_uneven_frame_at_most_two(tmp_path):
    shapes = {
        "arm": prism(lambda x, y: (np.abs(x) < 70) & (y < -10) | (x < -10), 160.0),
        "bone": prism(lambda x, y: (np.abs(y) < 20) | (np.abs(x) > 40), 200.0),
        "frame": prism(lambda x, y: np.maximum(np.abs(x), np.abs(y + 10)) > 35, 160.0),
    }
    for name, mesh in shapes.items():
        figures = plan_of(mesh, tmp_path / f"{name}.stl", PlanConfig(pattern="fermat", stepover_m=STEP)).figures
        assert figures["retracts"] <= (2 if name == "frame" else 1), name
        assert figures["self_crossings"] == 0, name
        assert figures["coverage_stepover"] > 0.98, name


def test_every_circle_is_joined_and_passed_once():
    circles = [circle(radius * STEP) for radius in (6.0, 5.0, 4.0, 3.0, 2.0, 1.0)]
    (line,) = connect(circles, STEP)
    total = sum(curve.length for curve in circles)
    assert np.linalg.norm(np.diff(line.positions, axis=0), axis=1).sum() == pytest.approx(total, rel=0.05)
    for curve in circles:
        assert curve.nearest(line.positions).distances.min() < 1e-9


def test_turns_hang_on_the_neighbour_they_run_beside_for_longest():
    curves = [circle(6.0 * STEP), circle(5.0 * STEP), circle(1.5 * STEP, (2.4 * STEP, 0.0))]
    tree = grow_tree(curves, find_contacts(curves, STEP), 0)
    assert tree.children == ((1,), (2,), ())
    assert tree.reached == (0, 1, 2)
    lengths = [curve.length for curve in curves]
    assert tree.lengths == pytest.approx(np.cumsum(lengths[::-1])[::-1])


def test_a_turn_loses_a_tail_that_runs_back_on_itself():
    out = np.column_stack([np.linspace(0.02, 0.04, 40), np.full(40, 2e-4), np.zeros(40)])
    body = circle(0.02).positions[5:-5]
    points = np.concatenate([body, out * [1.0, -1.0, 1.0], out[::-1]])
    tailed = Curve(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), True)
    trimmed = without_tails(tailed, 0.3 * STEP)
    assert np.linalg.norm(trimmed.positions, axis=1).max() < 0.025
    assert trimmed.length == pytest.approx(2.0 * np.pi * 0.02, rel=0.05)
    assert without_tails(circle(0.02), 0.3 * STEP).length == circle(0.02).length


def test_loops_close_the_gaps_turns_leave_in_the_middle():
    plan = PlanConfig(stepover_m=STEP)
    ground = prepare_ground(region_of("plate_two_holes"), plan)
    nested = nested_turns(PatternRequest(ground.region, ground.mesh, plan, lambda share: None))
    turns = list(all_turns(nested.roots))
    assert len(nested.roots) == 3  # one inside the outline, one around each hole
    assert all(any(loop is turn for turn in turns) for loop in nested.loops)
    reached = np.min([turn.curve.nearest(ground.mesh.vertices).distances for turn in turns], axis=0)
    assert ground.mesh.vertex_areas[reached > 0.55 * STEP].sum() < 0.003 * ground.region.area_m2
