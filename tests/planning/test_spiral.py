"""Spiral and contour: where they run, which way, and how the spiral steps inwards (paper 1, section 1.3, fig.
6)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from polish_sim.config import PlanConfig
from polish_sim.planning import plan_path
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.patterns.pitch import Shares, match_turns, spread_shares
from tests.planning.shapes import UP, circle, level, region_of, shipped_plan, square

STEP = 0.008


def closed(points):
    return level(points, closed=True)


def test_the_first_turn_runs_half_a_step_over_inside_the_border():
    plan = shipped_plan("saddle")
    outer = plan.region.boundary_loops[0]
    border = Curve(outer[:-1], np.tile(UP, (len(outer) - 1, 1)), True)
    first = plan.path.positions_work[plan.path.process & (plan.path.pass_index == plan.path.pass_index.min())]
    distance = border.nearest(first[: int(0.85 * len(first))]).distances
    # Corners reach out a little; towards its end the turn begins to drift inwards.
    assert np.median(distance) == pytest.approx(0.5 * STEP, rel=0.02)
    assert np.percentile(distance, [5.0, 95.0]) == pytest.approx([0.5 * STEP] * 2, abs=0.06 * STEP)


@pytest.mark.parametrize(
    ("order", "direction", "side"), [("inward", "conventional", 1.0), ("outward", "climb", -1.0)]
)
def test_what_is_not_done_yet_lies_on_the_left_or_on_the_right(order, direction, side):
    """Inwards on a cap that is the middle, outwards the border."""
    path = plan_path(region_of("sphere_100"), PlanConfig(stepover_m=STEP, order=order, direction=direction))
    points = path.positions_work[path.process]
    inwards = order == "inward"
    radius = np.linalg.norm(points[[0, -1], :2], axis=1)
    assert (radius[0] > radius[1]) == inwards
    feed = np.gradient(points, axis=0)
    to_what_is_left = (-1.0 if inwards else 1.0) * points * [1.0, 1.0, 0.0]
    left = np.cross(UP, feed)
    assert (side * (left * to_what_is_left).sum(axis=1) > 0.0).mean() > 0.95


def test_half_way_between_two_square_turns_lies_a_square():
    """The corner of the inner one is the partner of the whole corner of the outer one."""
    outer, inner = closed(square(0.05)), closed(square(0.042))
    match = match_turns(outer, inner, 0.05, 0.042, STEP)
    assert match.beside.all()
    assert np.diff(match.outer).min() >= 0.0
    assert np.diff(match.inner).min() >= 0.0
    middle = 0.5 * (outer.at(0.05 + match.outer)[0] + inner.at(0.042 + match.inner)[0])
    assert np.abs(middle).max(axis=1) == pytest.approx(np.full(len(middle), 0.046), abs=1e-9)


def test_the_spiral_becomes_archimedean_turn_by_turn():
    """Spacing of neighbouring rounds away from the step: one step-over but for 4% of it."""
    radii = 0.3 - STEP * np.arange(20)
    curves = [closed(circle(r, count=2000)) for r in radii]
    matches = [match_turns(a, b, 0.0, 0.0, STEP) for a, b in pairwise(curves)]
    shares = spread_shares([c.length for c in curves], matches, 0.03, False, STEP)
    phase = np.linspace(0.1, 0.9, 50)
    heights = np.array([i + s.at(phase * s.length) for i, s in enumerate(shares)])
    assert heights[0] == pytest.approx(np.zeros(50), abs=1e-9)
    assert np.diff(heights, axis=0) == pytest.approx(np.ones((19, 50)), abs=0.041)
    slopes = np.ptp(heights, axis=1) / 0.8
    assert np.diff(slopes).min() > -1e-9
    assert slopes[14] == pytest.approx(1.0, abs=0.05)


def test_the_step_inwards_keeps_its_distance_from_the_one_before():
    """On straight turns a slope p moves on by sqrt(1 + p^2) step-overs from turn to turn."""
    curves = [closed(circle(3.0, count=40_000)), closed(circle(3.0 - STEP, count=40_000))]
    matches = [match_turns(*curves, 0.0, 0.0, STEP)]
    first, second = spread_shares([c.length for c in curves], matches, 8.0 * STEP, False, STEP)
    near = first.length + STEP * np.linspace(-3.0, 0.0, 200)

    def heights(shares: Shares, over):
        return np.stack([near / STEP, over + shares.at(near - first.length + shares.length)], axis=1)

    one, other = heights(first, 0.0), heights(second, 1.0)
    gaps = np.linalg.norm(one[:, None] - other[None, 60:140], axis=2).min(axis=0)
    assert gaps == pytest.approx(np.ones(80), abs=0.01)
    assert (other[60:140, 1] - one[60:140, 1]).max() > 1.02


# Contour: closed loops one inside the other.


@pytest.mark.parametrize(
    ("order", "sign", "direction", "way"),
    [("inward", 1.0, "climb", -1.0), ("outward", -1.0, "conventional", 1.0)],
)
def test_what_closed_loops_have_not_done_yet_lies_on_the_left_unless_climbing(order, sign, direction, way):
    plan = PlanConfig(pattern="contour", stepover_m=STEP, order=order, direction=direction)
    path = plan_path(region_of("sphere_100"), plan)
    passes = path.pass_index[path.process]
    loops = [path.positions_work[path.process][passes == number] for number in np.unique(passes)]
    sizes = [np.linalg.norm(loop[:, :2], axis=1).mean() for loop in loops]
    assert (np.diff(sizes) * sign < 0.0).all()
    for loop in loops:
        assert np.cross(loop[:-1], loop[1:])[:, 2].sum() * sign * way > 0.0  # area swept about z
        # It comes back to exactly where it began.
        again = (loop == loop[0]).all(axis=1)
        assert again.sum() == 2
        radius = np.linalg.norm(loop[: np.flatnonzero(again)[1] + 1, :2], axis=1)
        assert np.ptp(radius) < 0.02 * STEP + 0.02 * radius.mean()
