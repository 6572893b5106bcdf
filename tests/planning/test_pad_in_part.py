"""The pad's disc beside walls, on edges and on curved places."""

import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.exchange.strokes import ExportSetup
from polish_sim.exchange.urscript import urscript_text
from polish_sim.geometry import fit_surface, load_part, select_region
from polish_sim.planning import inspect_path, measure_given_path, plan_part, plan_path
from polish_sim.planning.quality.tool_room import Discs, standing_above
from tests.planning.shapes import UP, moved, pocket, shipped_plan, surface_of

RADIUS = 0.010
PAD = PadConfig(radius_m=RADIUS)
PLAN = PlanConfig(stepover_m=0.004, pattern="contour", region="point:0,0,0")


def disc(x, y, z=0.0, low=1e-3):
    return Discs(np.array([[x, y, z]]), UP[None], np.array([low]), np.array([0.022]), RADIUS)


@pytest.mark.parametrize(
    ("gap", "thickness", "facet"), [(0.0005, 40.0, 500.0), (0.0099, 1.0, 500.0), (0.0005, 40.0, 10.0)]
)
def test_beside_a_wall_the_disc_is_in_it_by_what_its_radius_has_over_the_gap(tmp_path, gap, thickness, facet):
    """However thin the wall is, and of however many rows of facets: the pad has to get past it."""
    part = surface_of(pocket(ring_mm=thickness).subdivide_to_size(facet), tmp_path)
    found = standing_above(part, disc(0.060 - gap, 0.013))
    assert found.depths[0] == pytest.approx(RADIUS - gap, abs=1e-9)
    assert found.reaches[0] == pytest.approx(RADIUS - gap, abs=1e-9)
    assert standing_above(part, disc(0.060 - RADIUS - 1e-6, 0.013)).depths[0] == 0.0
    # It is no deeper in a step than the step is high.
    step = surface_of(pocket(wall_mm=3.0), tmp_path)
    assert standing_above(step, disc(0.0595, 0.013)).depths[0] == pytest.approx(0.003, abs=1e-9)
    assert standing_above(step, disc(0.0595, 0.013, low=0.0031)).depths[0] == 0.0


def test_before_a_slope_the_rim_is_as_deep_as_the_plane_says(tmp_path):
    """A ramp of 45 deg from x = 5 mm on: the rim at x = 10 mm is 5 mm sin 45 deg behind its plane."""
    outline = [(-50, -10), (60, -10), (60, 55), (5, 0), (-50, 0)]
    polygon = trimesh.path.polygons.Polygon(outline)
    ramp = trimesh.creation.extrude_polygon(polygon, 80.0)
    ramp.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    part = surface_of(moved(ramp, 0, 40, 0), tmp_path)
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


def test_inspect_finds_what_the_plan_finds_and_a_pad_that_yields_more_is_in_it_over_less(in_pocket):
    result, file = in_pocket
    part = PartConfig(str(file), up="z")
    seen = inspect_path(result.path, part, result.plan, pad=PAD)
    for name in ("pad_in_part_max_m", "pad_in_part_length_m"):
        assert seen.figures[name] == pytest.approx(result.figures[name], rel=1e-9)
    assert any("into the part" in note for note in seen.notes)
    # 20 N on 4000 N/m: 5 mm. Only the outermost turn is deeper; on the next the shaft, 9 mm wide, is in it.
    soft = inspect_path(
        result.path, part, result.plan, pad=replace(PAD, stiffness_n_m=4000.0)
    ).quality.pad_in_part
    assert soft.lengths[[body == "pad" for body in soft.bodies]].sum() == pytest.approx(4 * 0.116, rel=0.02)
    assert np.median(soft.depths[[body == "shaft" for body in soft.bodies]]) == pytest.approx(0.003, abs=1e-5)


def test_the_robot_program_of_a_pad_in_a_wall_says_so_and_asks(in_pocket):
    text = urscript_text(in_pocket[0], ExportSetup())
    assert re.search(
        r"^# - DO NOT RUN IT AS IT IS: the pad runs up to [78]\.\d+ mm into the part", text, re.M
    )
    assert 'popup("Continue? the pad runs up to' in text
    assert "DO NOT RUN" not in urscript_text(shipped_plan("plate"), ExportSetup())
