"""What the pad reaches and for how long, against closed forms; what of the region is left out, and why."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from polish_sim.arrays import chord_lengths
from polish_sim.config import PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.exchange import read_cuts, write_plan
from polish_sim.planning import inspect_path
from polish_sim.planning.curve import Curve
from polish_sim.planning.ground import prepare_ground, triangulate
from polish_sim.planning.part_plan import LEFT_OUT, Mend
from polish_sim.planning.points import thin
from polish_sim.planning.quality import coverage
from polish_sim.planning.quality.areas import FAR, CutOut, _above_zero
from polish_sim.planning.quality.coverage import PadSteps, pad_depths, time_under_pad
from polish_sim.planning.quality.located import locate
from polish_sim.planning.quality.tool_room import BEHIND_PAD
from polish_sim.planning.toolpath import RETRACT
from tests.planning.shapes import UP, block, level, path_through, plan_of, region_of, union

PAD = PadConfig()
R, K, F = PAD.radius_m, PAD.stiffness_n_m, 20.0
SMALL = 0.5 * F / K / R


@pytest.mark.parametrize(
    ("bend", "slope", "depth", "rel"),
    [
        (0.0, 0.0, F / K, 1e-12),
        # On a tight sphere a spot touches: its radius is sqrt(2 R_s d), the force K d^2 R_s / R^2.
        (20.0, 0.0, np.sqrt(20.0 * F * R**2 / K), 0.01),
        (10.0, 0.0, np.sqrt(10.0 * F * R**2 / K), 0.01),
        # On a gentle one all of the pad: the mean compression is F / K, the middle R^2 / (4 R_s) deeper.
        (1.0, 0.0, F / K + R**2 / 4.0, 0.01),
        (-1.0, 0.0, F / K - R**2 / 4.0, 0.01),
        # Tilted and touching all over: springs lifted on one side press as much more on the other.
        (0.0, SMALL, F / K, 1e-3),
    ],
)
def test_the_pad_sinks_in_until_it_carries_the_force(bend, slope, depth, rel):
    found = pad_depths(np.full((1, 2), bend), PAD, F, np.array([[slope, 0.0]]))
    assert found == pytest.approx([depth], rel=rel)


def test_one_line_across_a_plate_covers_a_stripe():
    mesh = triangulate(region_of("plate").surface, 0.002)
    line = level(np.linspace((-0.1, 0.0, 0.02), (0.1, 0.0, 0.02), 400))
    share = coverage.strict_share(mesh, mesh.areas, [line], 0.04)
    assert share == pytest.approx(2 * 0.55 * 0.04 / 0.2, abs=6e-4)
    other_side = Curve(line.positions, -line.normals, False)
    assert not coverage.strictly_covered(mesh.vertices, mesh.normals, [other_side], 0.04).any()


def flat_steps(points, feed):
    """Steps of the pad over a plane, pressed in a little."""
    points, length = level(points).positions, chord_lengths(np.asarray(points))
    count = len(length)
    return PadSteps(points[:-1], points[1:], np.tile(UP, (count, 1)), np.full(count, 1e-3), length / feed)


def test_a_straight_line_gives_2_sqrt_r2_minus_y2_over_the_feed_in_any_frame_and_on_long_chords():
    y = np.linspace(-1.2 * R, 1.2 * R, 49)
    points = np.column_stack([np.full(49, 0.003), y, 0.0 * y])
    steps = flat_steps(np.linspace((-0.1, 0.0), (0.1, 0.0), 37), 0.01)
    times = time_under_pad(points, np.tile(UP, (49, 1)), steps, R)
    assert times == pytest.approx(2.0 * np.sqrt(np.maximum(R**2 - y**2, 0.0)) / 0.01, abs=1e-9)
    rng = np.random.default_rng(2)
    turn = Rotation.random(rng=rng).as_matrix()
    places = rng.uniform(-0.08, 0.08, (3000, 3)) * [1.0, 1.0, 0.0]
    steps = flat_steps([[-0.03, 0.0], [0.03, 0.01], [0.0, 0.03]], 0.01)
    starts, ends, ups, *rest = steps
    moved = PadSteps(starts @ turn.T + 0.3, ends @ turn.T + 0.3, ups @ turn.T, *rest)
    there = time_under_pad(places, np.tile(UP, (3000, 1)), steps, R)
    here = time_under_pad(places @ turn.T + 0.3, np.tile(turn @ UP, (3000, 1)), moved, R)
    assert here == pytest.approx(there, abs=1e-9)
    # Twice as fast on the second half: half the time there; two points a line are as good as many.
    ground = prepare_ground(region_of("plate"), PlanConfig())
    feed = np.array([0.01, 0.01, 0.02, 0.02])
    ends = [[-0.08, 0.0, 0.02], [-1e-4, 0.0, 0.02], [1e-4, 0.0, 0.02], [0.08, 0.0, 0.02]]
    on = locate(ground, path_through(ends, feed=feed), ProcessConfig())
    # Where nothing that counts comes under the pad, as at the end of a path, half of it took no time.
    bare = coverage.expose(ground, on, PAD).times == 0.0
    assert coverage.expose(ground, on, PAD, bare).figures["exposure_median_s"] == 0.0
    steps = coverage.pad_steps(on, PAD)
    places = np.array([[-0.04, 0.01, 0.02], [0.04, 0.01, 0.02]])
    times = time_under_pad(places, np.tile(UP, (2, 1)), steps, R)
    whole = 2.0 * np.sqrt(R**2 - 0.01**2) / 0.01
    assert times == pytest.approx([whole, 0.5 * whole], rel=1e-6)


def test_a_strongly_tilted_pad_stands_on_its_edge():
    """At a slope of 0.5 only a segment of the disc touches; the springs there carry the force."""
    depth = pad_depths(np.zeros((1, 2)), PAD, 20.0, np.array([[0.5, 0.0]]))[0]
    assert depth < -0.004
    x = np.linspace(-R, R, 200_001)
    pressure = PAD.stiffness_n_m / (np.pi * R**2) * np.maximum(depth + 0.5 * x, 0.0)
    assert np.trapezoid(pressure * 2.0 * np.sqrt(R**2 - x**2), x) == pytest.approx(20.0, rel=0.05)


def test_thinned_points_are_apart_and_leave_nothing_out():
    points = np.random.default_rng(3).uniform(0.0, 0.1, (5000, 3)) * [1.0, 1.0, 0.1]
    some = thin(points, 0.004)
    assert len(cKDTree(points[some.kept]).query_pairs(0.004 * (1.0 - 1e-9))) == 0
    assert np.linalg.norm(points - points[some.kept][some.stands_for], axis=1).max() < 0.004


def test_rows_add_up_to_the_region_and_name_the_wall_the_narrow_component_and_what_was_cut(tmp_path):
    wall, strip = block((40, 120, 90), (110, 0, 40)), block((120, 15, 10), (0, 100, 0))
    solid = union(block((200, 120, 10)), wall, strip)
    plan = PlanConfig(region="box:-200,-200,-1,90,200,6", stepover_m=0.016)
    result = plan_of(solid, tmp_path / "part.stl", plan, PadConfig(choice="given"))
    m = result.figures
    assert m["region_area_m2"] == pytest.approx(0.190 * 0.120 + 0.120 * 0.015, rel=1e-3)
    assert m["polished_area_m2"] + m["left_out_area_m2"] == pytest.approx(m["region_area_m2"], rel=1e-9)
    assert sum(m["left_out"].values()) == pytest.approx(m["left_out_area_m2"], rel=1e-12)
    assert m["coverage"] == pytest.approx(m["polished_area_m2"] / m["region_area_m2"])
    assert m["left_out"]["component narrower than half the pad"] == pytest.approx(0.120 * 0.015, rel=0.02)
    # The spindle's housing, 32.5 mm in radius, keeps 1 mm from the wall.
    middle = next(body for body in BEHIND_PAD if body.name == "spindle").radius + 0.001
    strip_m2 = 0.120 * (middle - 0.025)
    assert 0.9 * strip_m2 < m["left_out"]["spindle too near the part"] < 1.1 * strip_m2 + 2 * 0.22 * 0.025**2
    for planned in (result, result.behind(0.3)):
        write_plan(tmp_path, planned)
        asked = PartConfig(str(tmp_path / "part.stl"), up="z"), planned.plan, ProcessConfig(), PAD
        found = inspect_path(planned.path, *asked, cuts=read_cuts(tmp_path)).figures["left_out"]
        assert found == pytest.approx(planned.figures["left_out"], rel=0.02)


def test_the_margin_that_a_smaller_pad_keeps_off_the_edges_is_no_gap_between_turns(tmp_path):
    result = plan_of(block((120, 24, 10)), tmp_path / "part.stl", PlanConfig())
    assert any("mm off the edges chosen" in note for note in result.notes)
    figures = result.figures
    assert figures["furthest_from_path_m"] > figures["stepover_expected_m"]
    assert figures["beyond_stepover_area_m2"] == 0.0


def test_what_is_shown_of_a_row_ends_on_the_line_where_its_share_is_a_half():
    triangles = np.random.default_rng(4).normal(size=(500, 3, 3))
    sides = [_above_zero(triangles, sign * (triangles[:, :, 0] - 0.3)) for sign in (1.0, -1.0)]
    assert (sides[0][:, :, 0].min(), sides[1][:, :, 0].max()) == pytest.approx((0.3, 0.3), abs=1e-12)
    edges = [np.diff(each, axis=1).swapaxes(0, 1) for each in (triangles, *sides)]
    whole, above, below = (np.linalg.norm(np.cross(*each), axis=1).sum() for each in edges)
    assert whole == pytest.approx(above + below, rel=1e-12)


def test_what_is_cut_out_of_a_path_afterwards_takes_its_reason(tmp_path):
    plan = PlanConfig(pattern="raster", raster_direction=(0.0, 1.0, 0.0), stepover_m=0.016)
    result = plan_of(block((240, 120, 10)), tmp_path / "part.stl", plan, PadConfig(choice="given"))
    path = result.path
    shaking = path.process & (np.abs(path.positions_work[:, 0]) < 0.06)
    rest, cut = path.rows(~shaking), CutOut("shakes", path.positions_work[shaking])
    # A lift stands where the stretch was: else both sides of it would be one stroke.
    rest = replace(rest, segment=np.where(np.diff(rest.s, append=rest.s[-1]) > 0.01, RETRACT, rest.segment))
    account = result.ready.measure(rest, [cut]).area
    # 120 mm less the two radii the pad covers from the turns on either side.
    assert account.figures["left_out"]["shakes"] == pytest.approx(0.120 * (0.120 - 0.050), rel=0.15)
    gapped = result.along(rest, [Mend(LEFT_OUT, "shakes", 0.0, 0.12, cut.positions)])
    again, far = gapped.figures, gapped.area.marked[FAR]
    assert again["left_out"] == account.figures["left_out"]
    # Beside the gap the pad's rim polishes what is up to its radius from a turn: no step-over shows that.
    assert result.figures["beyond_stepover_area_m2"] == 0.0 < 0.016 < again["furthest_from_path_m"] <= R
    assert again["beyond_stepover_area_m2"] == pytest.approx(2.0 * 0.120 * (R - 0.016), rel=0.15)
    assert np.abs(far[..., 0]).max() < 0.060 - 0.016 + 0.006
    assert any(note.startswith(FAR) for note in gapped.notes)
    accounted = again["polished_area_m2"] + again["left_out_area_m2"]
    assert accounted == pytest.approx(again["region_area_m2"], rel=1e-9)
