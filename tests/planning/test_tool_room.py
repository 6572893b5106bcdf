"""Nothing of the tool is in the part, by solids of the robot's model and by the pad's disc."""

import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
import trimesh

from polish_sim.analysis.path_plot import plot_plan
from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.exchange.strokes import ExportSetup
from polish_sim.exchange.urscript import urscript_text
from polish_sim.exchange.viewers import FAR_COLOR, IN_PART_COLOR, LEFT_OUT_COLOR, path_page
from polish_sim.geometry import fit_surface, load_part, select_region
from polish_sim.models import robot_model_path
from polish_sim.planning import inspect_path, measure_given_path, plan_part, plan_path
from polish_sim.planning.ground import prepare_ground
from polish_sim.planning.moves.travel import AirSpace
from polish_sim.planning.planner import plan_on
from polish_sim.planning.quality.areas import FAR
from polish_sim.planning.quality.tool_room import BEHIND_PAD, Discs, Tool, standing_above
from tests.cell.cells import drawn_vertices, meshes_of
from tests.geometry.shapes import prism, surface_of
from tests.planning.shapes import UP, block, pocket, shipped_plan, union
from tests.planning.tools import reached_share, volumes_in_part

CLEARANCE, YIELDS, RADIUS = 0.001, 20.0 / 20000.0, 0.010
PAD = PadConfig(radius_m=RADIUS)
PLAN = PlanConfig(stepover_m=0.004, pattern="contour", region="point:0,0,0")


def walled_plate():
    """A plate 160 x 120 mm with a wall 110 mm high and 5 mm thick across it."""
    return union(block((160, 120, 20), (0, 0, -10)), block((5, 120, 120), (60, 0, 50)))


def boss():
    """A plate 120 x 120 mm with a boss 16 mm across and 40 mm high."""
    post = trimesh.creation.cylinder(8.0, 40.0).apply_translation((5, 3, 20))
    return union(block((120, 120, 20), (0, 0, -10)), post)


def bowl(radius=90.0, depth=20.0):
    ball = trimesh.creation.icosphere(4, radius).apply_translation((0, 0, radius - depth))
    return trimesh.boolean.difference([block((140, 140, 50), (0, 0, -25)), ball], engine="manifold")


def scan():
    """A closed form with hills and hollows, its vertices off by 0.05 mm as a scanner leaves them."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=60.0)
    way = ball.vertices / 60.0
    hills, hollows = np.sin(3.0 * way[:, 0] + 1.0) * np.cos(4.0 * way[:, 1]), np.sin(5.0 * way[:, 2])
    waves = 1.0 + 0.10 * hills + 0.06 * hollows
    noise = np.random.default_rng(5).normal(0.0, 0.05, (len(way), 3))
    return trimesh.Trimesh(ball.vertices * waves[:, None] + noise, ball.faces)


def shelf():
    """A plate 160 x 120 mm under a shelf 80 mm above it: pad and shaft fit under, the spindle does not."""
    post, board = block((10, 120, 100), (75, 0, 50)), block((60, 120, 10), (50, 0, 85))
    return union(block((160, 120, 20), (0, 0, -10)), post, board)


CASES = {
    "pocket": (pocket, "point:0,0,0", 0.0),
    "walled plate": (walled_plate, "point:0,0,0", 0.0),
    "boss": (boss, "point:40,40,0", 0.0),
    "shelf": (shelf, "point:-40,0,0", 0.0),
    "bowl": (bowl, "point:0,0,-20", 0.005),
    "scan": (scan, "auto", 0.005),
}
"""Part, region, and how far the pad may be compressed on hollow ground besides by the force [m]."""


@cache
def part_of(name):
    return CASES[name][0]()


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    @cache
    def request(name):
        file = tmp_path_factory.mktemp("part") / "part.stl"
        part_of(name).export(file)
        return PartConfig(str(file), up="z")

    return request


@pytest.fixture(scope="module")
def planned(part):
    @cache
    def plan(name, pattern, diameter_mm, **keys):
        asked = {"stepover_m": 0.3e-3 * diameter_mm, "pattern": pattern, "region": CASES[name][1]} | keys
        return plan_part(part(name), PlanConfig(**asked), pad=PadConfig(radius_m=5e-4 * diameter_mm))

    return plan


@pytest.mark.parametrize(
    ("name", "pattern", "diameter_mm"),
    [
        ("pocket", "contour", 20.0), ("boss", "fermat", 20.0),
        ("bowl", "spiral", 30.0), ("scan", "contour", 20.0),
    ],
)  # fmt: skip
def test_no_body_of_the_tool_shares_volume_with_the_part_on_any_plan(planned, name, pattern, diameter_mm):
    result = planned(name, pattern, diameter_mm)
    hollow = min(CASES[name][2], 0.1e-3 * diameter_mm)
    shared = volumes_in_part(result.path, part_of(name), 5e-4 * diameter_mm, YIELDS + hollow)
    assert max(shared.values()) < 0.05, shared
    assert result.figures["pad_in_part_max_m"] == 0.0
    assert reached_share(result.figures) > 0.9


def test_in_a_pocket_the_pad_reaches_all_but_the_corners_and_the_clearance(planned):
    radius = 10.0  # of the pad [mm]
    result = planned("pocket", "contour", 2.0 * radius)
    side = 120.0 - 2e3 * CLEARANCE - 2.0 * radius
    reached = side**2 + 4.0 * side * radius + np.pi * radius**2
    assert 1e6 * result.figures["unreachable_area_m2"] == pytest.approx(14400.0 - reached, rel=0.02)
    # The outermost turn keeps the clearance, and no more than a tenth of a step-over besides.
    widest = 2e3 * np.abs(result.path.positions_work[result.path.process, :2]).max()
    assert side - 0.2 * 0.4 * radius < widest < side + 1e-3
    assert reached_share(result.figures) > 0.98
    assert [note.split(": ")[-1] for note in result.notes if "left out" in note] == ["pad too near the part"]
    # What is marked on the pictures is what no disc about a place of the inner square covers.
    row = result.area.left_out["pad too near the part"]
    assert 1e6 * row.area_m2 == pytest.approx(14400.0 - reached, rel=0.04)
    middles = 1e3 * row.triangles.mean(axis=1)[:, :2]
    beyond = np.linalg.norm(np.maximum(np.abs(middles) - 0.5 * side, 0.0), axis=1)
    assert beyond.min() > 0.8 * radius


def test_a_tool_that_leans_away_reaches_more_and_is_nowhere_in_the_part(part, planned):
    coarse = {"stepover_m": 0.006}
    upright, leaned = (planned("shelf", "spiral", 16.0, **coarse, **keys) for keys in ({}, {"avoid": "tilt"}))
    assert next(iter(upright.area.left_out)) == "spindle too near the part"
    # The board begins at x = 20 mm, 80 mm up: the spindle, 32.5 mm in radius there, keeps 1 mm from it.
    reached = upright.path.positions_work[upright.path.process, 0].max()
    assert reached == pytest.approx(0.020 - 0.0335, abs=4e-4)
    gained = upright.figures["unreachable_area_m2"] - leaned.figures["unreachable_area_m2"]
    assert 1e4 * gained > 6.0
    assert leaned.ready.access.gained_m2 == pytest.approx(gained, rel=1e-6)
    assert reached_share(leaned.figures) > 0.99
    # Its rim goes a fifth of its radius deep, as on the most hollow ground, and no deeper.
    assert np.sin(leaned.figures["max_axis_lean_rad"]) < 0.2 + 1e-6
    shared = volumes_in_part(leaned.path, part_of("shelf"), 0.008, YIELDS + 0.2 * 0.008)
    assert max(shared.values()) < 0.05, shared
    # Over the 30 mm on which a lean fades the axis turns by 6.7 rad/m, and along a bend by a little more.
    assert leaned.figures["max_axis_rate_rad_m"] < 1.5 * np.tan(np.arcsin(0.2)) / 0.03
    again = measure_given_path(leaned.path, part("shelf"), leaned.plan, pad=leaned.tool.pad)
    for figure in ("unreachable_area_m2", "coverage"):
        assert again.figures[figure] == leaned.figures[figure]
    assert again.figures["pad_in_part_max_m"] == 0.0


def test_a_wide_pad_that_would_touch_with_its_far_edge_only_stays_upright(planned):
    upright, leaned = (planned("walled plate", "raster", 50.0, **keys) for keys in ({}, {"avoid": "tilt"}))
    assert np.array_equal(upright.path.axes_work, leaned.path.axes_work)
    assert np.array_equal(upright.path.positions_work, leaned.path.positions_work)
    assert any("touch no more: it stands upright" in note for note in leaned.notes)


def test_the_bodies_hold_all_that_the_model_has_behind_the_pad():
    """Every vertex of every mesh from the head to the fourth link lies in one of the planner's cylinders."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tool = data.site("tool")
    for body in ("tool_mount", "link_6", "link_5", "link_4"):
        for geom in meshes_of(model, body):
            seen = (drawn_vertices(model, data, geom) - tool.xpos) @ tool.xmat.reshape(3, 3)
            height, wide = -seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])
            held = np.zeros(len(seen), dtype=bool)
            for cylinder in BEHIND_PAD:
                beside = (height >= cylinder.low - 1e-6) & (height <= cylinder.high + 1e-6)
                held |= beside & (wide <= cylinder.radius)
            assert held.all(), model.geom(geom).name


def test_pictures_show_what_is_out_of_reach_and_where_the_tool_is_in_the_part(planned, in_pocket):
    for shown, label, color in (
        (planned("pocket", "contour", 20.0), "left out: pad too near the part", LEFT_OUT_COLOR),
        (planned("pocket", "contour", 20.0), FAR, FAR_COLOR),
        (in_pocket[0], "tool in the part", IN_PART_COLOR),
    ):
        figure = plot_plan(shown)
        assert label in [text.get_text() for text in figure.legends[0].get_texts()]
        marked = next(solid for solid in path_page(shown, ExportSetup()).solids if solid.kind == label)
        assert len(marked.vertices) > 100
        assert 255.0 * np.array(marked.color) == pytest.approx(color)
        if label == FAR:
            drawn = [line.get_color() for line in figure.axes[1].lines if line.get_label() == FAR]
            assert 255.0 * np.array(drawn) == pytest.approx(np.array([FAR_COLOR]))


def test_the_tool_has_room_in_the_air_or_not():
    """A lead that keeps the tool point clear keeps the tool out of the wall, 6 mm beside the pad's rim."""
    air = AirSpace(surface_of(boss()), 0.03, UP, Tool(PadConfig(radius_m=0.010), 20.0))
    for away, free in ((0.024, True), (0.017, False)):
        line = np.array([[0.005 + away, 0.003, z] for z in (0.005, 0.02)])
        assert air.has_room(line, np.tile(UP, (2, 1))) == free


def test_a_pad_too_large_and_a_plan_all_of_which_is_in_the_part_are_refused(planned, tmp_path, part):
    with pytest.raises(PlanError, match=r"its pad would still come .* too close"):
        planned("pocket", "spiral", 122.0, stepover_m=0.008)
    bowl(40.0).export(tmp_path / "bowl.stl")
    hollow = PartConfig(str(tmp_path / "bowl.stl"), up="z")
    plan = PlanConfig(region="point:0,0,-20", stepover_m=0.016)
    with pytest.raises(PlanError, match=r"hollow of less than 62\.5 mm radius"):
        plan_part(hollow, plan, pad=PadConfig(choice="given"))
    # The default pad is replaced by one that follows the bowl: 40 mm is 2.5 times the radius of one of 32 mm.
    assert plan_part(hollow, plan).tool.pad.radius_m <= 0.016
    mesh = load_part(part("boss").file, "mm", "z")
    plan = PlanConfig(stepover_m=0.02, pattern="contour", region="point:40,40,0")
    surface = fit_surface(mesh)
    ground = prepare_ground(select_region(surface, mesh, plan.region), plan)
    air = AirSpace(surface, plan.clearance_m, mesh.up, Tool(PadConfig(radius_m=0.2), 20.0))
    with pytest.raises(PlanError, match=r"no stroke .* at \(.*\) mm"):
        plan_on(ground, plan, air=air)


def disc(x, y, z=0.0, low=1e-3):
    return Discs(np.array([[x, y, z]]), UP[None], np.array([low]), np.array([0.022]), RADIUS)


@pytest.mark.parametrize(
    ("gap", "thickness", "facet"), [(0.0005, 40.0, 500.0), (0.0099, 1.0, 500.0), (0.0005, 40.0, 10.0)]
)
def test_beside_a_wall_the_disc_is_in_it_by_what_its_radius_has_over_the_gap(gap, thickness, facet):
    """However thin the wall is, and of however many rows of facets: the pad has to get past it."""
    part = surface_of(pocket(ring_mm=thickness).subdivide_to_size(facet))
    found = standing_above(part, disc(0.060 - gap, 0.013))
    assert found.depths[0] == pytest.approx(RADIUS - gap, abs=1e-9)
    assert found.reaches[0] == pytest.approx(RADIUS - gap, abs=1e-9)
    assert standing_above(part, disc(0.060 - RADIUS - 1e-6, 0.013)).depths[0] == 0.0
    step = surface_of(pocket(wall_mm=3.0))
    assert standing_above(step, disc(0.0595, 0.013)).depths[0] == pytest.approx(0.003, abs=1e-9)
    assert standing_above(step, disc(0.0595, 0.013, low=0.0031)).depths[0] == 0.0


def test_before_a_slope_the_rim_is_as_deep_as_the_plane_says():
    """A ramp of 45 deg from x = 5 mm on: the rim at x = 10 mm is 5 mm sin 45 deg behind its plane."""
    ramp = prism([(-50, -10), (60, -10), (60, 55), (5, 0), (-50, 0)], 80.0)
    part = surface_of(ramp.apply_translation((0, -40, 0)))
    found = standing_above(part, disc(0.0, 0.0))
    assert found.depths[0] == pytest.approx(0.005 * np.sin(np.pi / 4), abs=1e-9)
    # What stands no higher than 1 mm does not count: the ramp does so from x = 6 mm on.
    assert found.reaches[0] == pytest.approx(0.004, abs=1e-9)


@pytest.fixture(scope="module")
def in_pocket(tmp_path_factory):
    """A path up to the walls of the pocket, planned without a tool, and the pocket's file."""
    file = tmp_path_factory.mktemp("pocket") / "pocket.stl"
    pocket().export(file)
    part = load_part(file, "mm", "z")
    path = plan_path(select_region(fit_surface(part), part, PLAN.region), PLAN)
    return measure_given_path(path, PartConfig(str(file), up="z"), PLAN, pad=PAD), file


def test_a_path_in_a_pocket_shows_how_deep_the_pad_is_in_the_wall_and_a_plan_keeps_away(in_pocket):
    result, file = in_pocket
    nearest = 0.060 - np.abs(result.path.positions_work[result.path.process, :2]).max()
    figures = result.figures
    assert figures["pad_in_part_max_m"] == pytest.approx(RADIUS - nearest, abs=1e-5)
    assert figures["pad_in_part_body"] == "pad"
    # Both outermost turns are nearer to the wall than the pad's radius; the next runs 10 mm away from it.
    assert 2 * 4 * 0.104 < figures["pad_in_part_length_m"] < 2 * 4 * 0.116 + 0.004
    (note,) = (note for note in result.notes if "into the part" in note)
    assert "plan it anew with this pad" in note
    assert len(result.in_part) > 50
    cured = plan_part(PartConfig(str(file), up="z"), PLAN, pad=PAD)
    assert cured.figures["pad_in_part_max_m"] == 0.0
    assert not any("into the part" in note for note in cured.notes)


def test_inspect_and_the_robot_program_say_of_a_pad_in_a_wall_what_the_plan_says(in_pocket):
    result, file = in_pocket
    part = PartConfig(str(file), up="z")
    seen = inspect_path(result.path, part, result.plan, pad=PAD)
    for name in ("pad_in_part_max_m", "pad_in_part_length_m"):
        assert seen.figures[name] == pytest.approx(result.figures[name], rel=1e-9)
    assert any("into the part" in note for note in seen.notes)
    # 20 N on 4000 N/m: 5 mm. Only the outermost turn is deeper; on the next the shaft, 9 mm wide, is in it.
    softer = replace(PAD, stiffness_n_m=4000.0)
    soft = inspect_path(result.path, part, result.plan, pad=softer).quality.pad_in_part
    pad, shaft = (np.array([found == body for found, _ in soft.pairs]) for body in ("pad", "shaft"))
    assert soft.lengths[pad].sum() == pytest.approx(4 * 0.116, rel=0.02)
    assert np.median(soft.depths[shaft]) == pytest.approx(0.003, abs=1e-5)
    text = urscript_text(result, ExportSetup())
    assert re.search(r"^# - DO NOT RUN .*: the pad runs up to [78]\.\d+ mm into the part", text, re.M)
    assert 'popup("Continue? the pad runs up to' in text
    assert "DO NOT RUN" not in urscript_text(shipped_plan("plate"), ExportSetup())
