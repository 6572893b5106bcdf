"""Connected Fermat spirals: one stroke over any region, covered, never crossing itself."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.config import PlanConfig
from polish_sim.planning.ground.ground import prepare_ground
from polish_sim.planning.patterns.fermat import connect
from polish_sim.planning.patterns.fermat_pocket import find_contacts, grow_tree
from polish_sim.planning.patterns.nested import all_turns, nested_turns, without_tails
from polish_sim.planning.patterns.run import PatternRequest
from tests.planning.shapes import circle, level, region_of, shipped_plan

STEP = 0.008


def ring(radius, **keys):
    return level(circle(radius, **keys), closed=True)


def test_a_fermat_spiral_ends_beside_its_beginning_on_the_border():
    path = shipped_plan("freeform", "fermat").path
    stroke = path.positions_work[path.process]
    radius = np.linalg.norm(stroke[:, :2], axis=1)
    assert radius[0] == pytest.approx(0.1 - 0.5 * STEP, abs=1e-3)
    assert radius[-1] == pytest.approx(0.1 - 1.5 * STEP, abs=1e-3)
    assert 0.4 < radius.argmin() / len(radius) < 0.6


def test_every_circle_is_joined_and_passed_once():
    circles = [ring(radius * STEP) for radius in (6.0, 5.0, 4.0, 3.0, 2.0, 1.0)]
    (line,) = connect(circles, STEP)
    total = sum(curve.length for curve in circles)
    assert np.linalg.norm(np.diff(line.positions, axis=0), axis=1).sum() == pytest.approx(total, rel=0.05)
    for curve in circles:
        assert curve.nearest(line.positions).distances.min() < 1e-9


def test_turns_hang_on_the_neighbour_they_run_beside_for_longest():
    curves = [ring(6.0 * STEP), ring(5.0 * STEP), ring(1.5 * STEP, centre=(2.4 * STEP, 0.0))]
    tree = grow_tree(curves, find_contacts(curves, STEP), 0)
    assert tree.children == ((1,), (2,), ())
    assert tree.reached == (0, 1, 2)
    lengths = [curve.length for curve in curves]
    assert tree.lengths == pytest.approx(np.cumsum(lengths[::-1])[::-1])


def test_a_turn_loses_a_tail_that_runs_back_on_itself():
    out = np.column_stack([np.linspace(0.02, 0.04, 40), np.full(40, 2e-4), np.zeros(40)])
    body = circle(0.02)[5:-5]
    points = np.concatenate([body, out * [1.0, -1.0, 1.0], out[::-1]])
    tailed = level(points, closed=True)
    trimmed = without_tails(tailed, 0.3 * STEP)
    assert np.linalg.norm(trimmed.positions, axis=1).max() < 0.025
    assert trimmed.length == pytest.approx(2.0 * np.pi * 0.02, rel=0.05)
    assert without_tails(ring(0.02), 0.3 * STEP).length == ring(0.02).length


def test_loops_close_the_gaps_turns_leave_in_the_middle():
    plan = PlanConfig(stepover_m=STEP)
    ground = prepare_ground(region_of("plate_two_holes"), plan)
    nested = nested_turns(PatternRequest(ground.region, ground.mesh, plan, lambda share: None))
    turns = list(all_turns(nested.roots))
    assert len(nested.roots) == 3  # one inside the outline, one around each hole
    assert all(any(loop is turn for turn in turns) for loop in nested.loops)
    reached = np.min([turn.curve.nearest(ground.mesh.vertices).distances for turn in turns], axis=0)
    assert ground.mesh.vertex_areas[reached > 0.55 * STEP].sum() < 0.003 * ground.region.area_m2
