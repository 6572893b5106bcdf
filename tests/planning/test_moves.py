"""Between strokes: leads and travels keep clear of the part, ways are short, places can be left out."""

from dataclasses import replace
from itertools import pairwise, permutations, product

import numpy as np
import pytest
import trimesh

from polish_sim.config import LEAST_FORCE_N, PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.errors import PlanError
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.planning import measure_given_path, plan_part
from polish_sim.planning.moves import leads, travel
from polish_sim.planning.moves.stroke import lift_over
from polish_sim.planning.quality.areas import CutOut
from polish_sim.planning.quality.tool_room import Tool
from polish_sim.planning.toolpath import BEFORE, PROCESS, stretches
from tests.geometry.shapes import prism, surface_of
from tests.planning.shapes import UP, block, path_through, plan_of, union

CLEARANCE = 0.03
LANDING = leads.normal_lead, leads.normal_lead, CLEARANCE
PRESSED = Tool(PadConfig(), 20.0)


def slab_with_wall(height=60.0):
    """A slab 200 x 100 x 10 mm, its top at z = 0, with a wall across the middle."""
    return surface_of(union(block((200, 100, 10), (0, 0, -5)), block((10, 100, height), (0, 0, height / 2))))


def stroke(x0, x1, y=0.0):
    return travel.move_in(PROCESS, np.linspace((x0, y, 0.0), (x1, y, 0.0), 60), UP, 0)


@pytest.mark.parametrize(("height", "ahead"), [(20.0, 0.04), (60.0, 0.04), (60.0, -0.03)])
def test_travels_rise_over_a_wall_and_no_higher_than_what_lies_between_makes_them(height, ahead):
    part = slab_with_wall(height)
    first, second = (leads.with_leads(stroke(a, a + 0.02), *LANDING) for a in (-0.06, ahead))
    way = travel.travel(first, second, travel.AirSpace(part, CLEARANCE, UP))
    assert signed_distances(part, way.positions).min() >= 0.69 * CLEARANCE
    assert way.positions[:, 2].max() <= 1e-3 * height * (ahead > 0.0) + CLEARANCE + 1e-9
    assert np.linalg.norm(np.diff(way.positions, axis=0), axis=1).max() < 1.1e-3


def test_from_one_side_of_a_plate_to_the_other_the_tool_goes_round():
    part = surface_of(block((100, 100, 10)))
    top = stroke(-0.02, 0.02)._replace(positions=stroke(-0.02, 0.02).positions + [0.0, 0.0, 0.005])
    below = top._replace(positions=top.positions * [1.0, 1.0, -1.0], axes=-top.axes)
    first, second = (leads.with_leads(move, *LANDING) for move in (top, below))
    way = travel.travel(first, second, travel.AirSpace(part, CLEARANCE, UP))
    assert signed_distances(part, way.positions).min() >= 0.69 * CLEARANCE
    assert np.linalg.norm(way.axes, axis=1) == pytest.approx(np.ones(len(way.axes)))


def test_a_ramp_that_would_cut_a_wall_or_leave_a_tight_bowl_is_not_taken_and_free_leads_are_kept():
    part = slab_with_wall(50.0)
    # Half the pad and a little: next to the wall, heading away from it, the ramp would come through it.
    air = travel.AirSpace(part, CLEARANCE, UP, PRESSED)
    start, end = leads.choose_leads(stroke(0.032, 0.07), "tangent", air)
    assert (start, end) == (leads.normal_lead, leads.tangent_lead)
    part = surface_of(block((200, 200, 10), (0, 0, -5)))
    air = travel.AirSpace(part, CLEARANCE, UP, PRESSED)
    for name, shape in leads.LEADS.items():
        start, end = leads.choose_leads(stroke(-0.05, 0.05), name, air)
        assert start is end is shape
    # The ramp of 20 deg is a chord of the bowl, 2 R sin(20 deg): 20.5 mm for R = 30 mm, the ramp 29 mm.
    ball = trimesh.creation.icosphere(4, 30.0)
    bowl = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] < -9.0][:, ::-1])
    part = surface_of(bowl)
    angle = np.linspace(-0.1, 0.1, 40)
    normal = np.stack([-np.sin(angle), 0.0 * angle, np.cos(angle)], axis=1)
    move = travel.move_in(PROCESS, -0.03 * normal, normal, 0)
    start, _ = leads.choose_leads(move, "tangent", travel.AirSpace(part, CLEARANCE, UP))
    assert start is not leads.tangent_lead


def test_two_islands_get_their_own_passes_and_one_lift_each(tmp_path):
    """Two pads 60 mm wide on a common base: two components, one spiral each, a travel between."""
    pads = [block((60, 60, 20), (x, 0, 5)) for x in (-60, 60)]
    part = union(block((200, 100, 10), (0, 0, -5)), *pads)
    plan = PlanConfig(region="box:-100,-50,14,100,50,16", stepover_m=0.008, bridge_m=0.0)
    result = plan_of(part, tmp_path / "islands.stl", plan)
    figures, path = result.figures, result.path
    assert figures["retracts"] == 2
    assert figures["self_crossings"] == 0
    assert figures["coverage_stepover"] > 0.97
    assert np.count_nonzero(np.diff(np.sign(path.positions_work[path.process, 0]))) == 1
    assert signed_distances(result.surface, path.positions_work[~path.process]).min() >= 0.0
    assert figures["air_length_m"] == pytest.approx(np.ptp(path.s) - figures["path_length_m"], abs=2e-3)


def test_beside_the_saddle_s_sharp_top_edge_no_lead_is_said_to_run_into_the_part():
    result = plan_part(PartConfig("saddle"), PlanConfig(pattern="fermat"), pad=PadConfig(radius_m=0.010))
    assert not any("runs into the part" in note or "would run into" in note for note in result.notes)
    ends = result.path.positions_work[~result.path.process]
    assert signed_distances(result.surface, ends).min() > -1e-9


def air(ends, order, flips):
    """Length of the ways from block to block."""
    walked = [ends[block][::-1] if flip else ends[block] for block, flip in zip(order, flips, strict=True)]
    return sum(np.linalg.norm(b[0] - a[1]) for a, b in pairwise(walked))


def shortest(ends, free):
    """The best of all orders that begin with the first block as it is."""
    others = range(1, len(ends))
    flips = list(product([0, 1] if free else [0], repeat=len(others)))
    return min(air(ends, (0, *rest), (0, *turns)) for rest in permutations(others) for turns in flips)


@pytest.mark.parametrize("free", [True, False])
@pytest.mark.parametrize("seed", range(3))
def test_the_way_is_within_a_tenth_of_the_shortest_of_all(free, seed):
    ends = np.random.default_rng(seed).uniform(size=(6, 2, 3))
    order, backwards = travel.order_blocks(ends, free)
    assert sorted(order) == list(range(6))
    assert air(ends, order, backwards) <= 1.1 * shortest(ends, free)
    assert free or not backwards.any()


def test_stripes_become_a_zig_zag_and_the_first_block_is_the_given_one_unless_a_start_is_asked_for():
    y = np.concatenate([[0], np.random.default_rng(1).permutation(39) + 1]) * 0.01
    ends = np.stack([np.column_stack([x + 0 * y, y, 0 * y]) for x in (0.0, 1.0)], axis=1)
    order, backwards = travel.order_blocks(ends, True)
    assert air(ends, order, backwards) == pytest.approx(39 * 0.01)
    assert np.diff(y[order]) == pytest.approx(np.full(39, 0.01))
    assert list(backwards) == [k % 2 == 1 for k in range(40)]
    ends = np.random.default_rng(5).uniform(size=(20, 2, 3))
    for start, first in (((), (0, False)), ((ends[7, 1] + 1e-4,), (7, True))):
        order, backwards = travel.order_blocks(ends, True, *start)
        assert (order[0], backwards[0]) == first
    assert travel.order_blocks(ends, False, ends[7, 0])[0][0] == 7
    assert travel.order_blocks(ends[:1], True, ends[0, 1])[1][0]
    assert not travel.order_blocks(ends[:1], False, ends[0, 1])[1][0]


@pytest.fixture(scope="module")
def plan():
    return plan_part(PartConfig(file="plate"), PlanConfig(stepover_m=0.02))


def test_a_stroke_cut_in_two_lands_and_leaves_at_the_cut_and_is_the_same_elsewhere(plan):
    path = plan.path
    gone = path.process & (path.s > 0.4) & (path.s < 0.5)
    left = lift_over(path, gone, plan.plan, plan.ready.air)
    np.testing.assert_array_equal(left.lost, gone)
    assert len(stretches(left.path.process)) == len(stretches(path.process)) + 1
    kept = left.path.positions_work[left.path.process]
    np.testing.assert_array_equal(kept, path.positions_work[path.process & ~gone])
    (_, last), (first, _) = stretches(left.path.process)[:2]
    between = left.path.positions_work[last : first + 1, 2]
    assert between.max() - between.min() == pytest.approx(plan.plan.clearance_m, abs=1e-6)
    once = left.path
    again = lift_over(once, once.process & (once.s > once.s[first] + 0.1), plan.plan, plan.ready.air)
    np.testing.assert_array_equal(again.path.s[: last + 1], once.s[: last + 1])
    # What is left of a stroke is longer than a step-over, or nothing.
    nearly_all = path.process & (path.s > path.s[path.process][0] + 0.015)
    assert lift_over(path, nearly_all, plan.plan, plan.ready.air) is None


def test_a_plan_from_a_place_on_lands_before_it_by_what_its_rising_force_lacks(plan):
    """Pressed along the path [N m] it is from its middle on what the whole plan is there."""
    whole, places = plan.path, plan.path.s[plan.path.process]
    rest = plan.behind(0.5)
    process = rest.path.process

    def pressed(path, since):
        held = path.process & (path.s >= since)
        return np.trapezoid(path.force_at(path.s[held], plan.tool.force), path.s[held])

    landing = whole.positions_work[whole.process & (whole.s >= 0.5 - 0.5 * plan.tool.pad.radius_m)][0]
    np.testing.assert_array_equal(rest.path.positions_work[process][0], landing)
    assert pressed(rest.path, 0.0) == pytest.approx(pressed(whole, 0.5), rel=0.005)
    assert rest.path.force[process][0] == pytest.approx(0.5 * plan.tool.force, rel=0.02)
    assert rest.path.force[process][-1] == plan.tool.force
    assert len(rest.mends[-1].places) > 0
    # What the whole leaves out the rest does, for the same reasons, wherever else the path was cut.
    cut = replace(plan, cuts=(CutOut("a cut", whole.positions_work[whole.process]),)).behind(0.5)
    lost = dict(cut.figures["left_out"])
    assert lost.pop(BEFORE) > 0.0
    assert lost == plan.figures["left_out"]
    # Little behind the first landing the stroke is pressed from its start again, by little less.
    near = plan.behind(places[0] + 0.004)
    assert near.mends == ()
    assert pressed(near.path, 0.0) == pytest.approx(pressed(whole, places[0] + 0.004), rel=0.005)
    begun = plan.behind(0.5 * places[0])
    assert begun.mends == ()
    assert set(begun.path.force) == {plan.tool.force}
    light = replace(plan, path=replace(whole, force=np.full(len(whole.s), 0.6)))
    assert light.behind(0.5).path.force.min() == LEAST_FORCE_N
    with pytest.raises(PlanError, match="nothing of the path is left behind"):
        plan.behind(1e3)


def test_the_rest_of_a_path_is_clear_of_what_its_whole_force_presses(tmp_path):
    """A ledge of 0.7 mm under the pad's rim: at 20 N the pad yields 1 mm, half of it where it lands anew."""
    profile = np.array([[-60.0, 0.0], [60.0, 0.0], [60.0, 10.7], [10.0, 10.7], [10.0, 10.0], [-60.0, 10.0]])
    prism(profile, 200.0).export(tmp_path / "ledge.stl")
    part = PartConfig(file=str(tmp_path / "ledge.stl"), unit="mm", up="z")
    line = path_through(np.linspace([0.0, 0.03, 0.01], [0.0, 0.17, 0.01], 120))
    plan = measure_given_path(line, part, PlanConfig(), ProcessConfig(contact_force_n=20.0), PadConfig())
    assert len(plan.in_part) == 0
    rest = plan.behind(0.07)
    assert rest.path.force.min() < 11.0
    assert len(rest.in_part) == 0
