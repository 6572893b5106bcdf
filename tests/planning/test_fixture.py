"""The fixture: the tool keeps clear of it as of the part, and plan, pictures and pages say so."""

import numpy as np
import pytest
import trimesh

from polish_sim.analysis.path_plot import plot_plan
from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.errors import PlanError
from polish_sim.exchange.strokes import ExportSetup
from polish_sim.exchange.viewers import path_page
from polish_sim.geometry import load_part
from polish_sim.geometry.fit import joined_meshes, load_fixture
from polish_sim.planning import inspect_path, measure_given_path, plan_part
from polish_sim.planning.quality.tool_room import BEHIND_PAD, UNSURE_M
from tests.planning.shapes import block, union
from tests.planning.tools import reached_share, volumes_in_part

CLEARANCE, YIELDS, RADIUS = 0.001, 20.0 / 20000.0, 0.025
PLATE = block((160, 120, 20), (0, 0, -10))


def wall(height):
    """A bar along the plate's side x = 80 mm, its top ``height`` above the plate's."""
    return block((20, 160, 40), (90, 0, height - 20))


def vice():
    """Two jaws and a clamp on the plate."""
    jaws = [block((200, 20, 60), (0, y, -20)) for y in (-70, 70)]
    return union(*jaws, block((30, 60, 15), (10, 60, 7.5)))


def asked(folder, fixture):
    PLATE.export(folder / "plate.stl")
    if fixture is None:
        return PartConfig(str(folder / "plate.stl"), up="z")
    fixture.export(folder / "fixture.stl")
    return PartConfig(str(folder / "plate.stl"), up="z", fixture_file=str(folder / "fixture.stl"))


def planned(folder, fixture, pattern="contour", choice="auto"):
    plan = PlanConfig(pattern=pattern, region="point:0,0,0", stepover_m=0.016)
    return plan_part(asked(folder, fixture), plan, pad=PadConfig(radius_m=RADIUS, choice=choice))


@pytest.mark.parametrize(("height", "body"), [(10.0, "pad"), (80.0, "spindle")])
def test_beside_the_fixture_s_wall_the_plate_is_left_out_by_what_the_tool_must_keep(tmp_path, height, body):
    """The pad keeps 1 mm; the spindle's wider housing 1 mm and what the part may lie otherwise."""
    result = planned(tmp_path, wall(height))
    spindle = next(known for known in BEHIND_PAD if known.name == body).radius if body == "spindle" else 0.0
    middle = RADIUS + CLEARANCE if body == "pad" else spindle + CLEARANCE + UNSURE_M
    x = result.path.positions_work[result.path.process, 0]
    assert x.max() == pytest.approx(0.08 - middle, abs=0.0005 + 0.05 * 0.01)
    assert next(iter(result.area.left_out)) == f"{body} too near the fixture"
    # Its corners are the round pad's as well: up to (1 - pi / 4) r^2 each.
    strip = 0.12 * (middle - RADIUS)
    assert strip * 0.9 < result.figures["unreachable_area_m2"] < strip * 1.1 + 2 * 0.22 * RADIUS**2
    assert any(note.endswith(f"{body} too near the fixture") for note in result.notes)


@pytest.mark.parametrize("free", [True, False])
def test_a_fixture_well_below_the_plate_is_no_hindrance(tmp_path, free):
    height = -1e3 * (YIELDS + CLEARANCE + UNSURE_M) - 0.2 if free else -3.0
    assert (planned(tmp_path, wall(height)).ready.access is None) == free


def test_no_body_of_the_tool_shares_volume_with_the_fixture_which_picture_and_page_show(tmp_path):
    result = planned(tmp_path, vice(), "raster")
    assert max(volumes_in_part(result.path, vice(), RADIUS, -YIELDS).values()) < 0.05
    assert max(volumes_in_part(result.path, PLATE, RADIUS, YIELDS).values()) < 0.05
    assert result.figures["pad_in_part_max_m"] == 0.0
    assert reached_share(result.figures) > 0.95
    labels = [text.get_text() for legend in plot_plan(result).legends for text in legend.get_texts()]
    assert "fixture" in labels
    solids = path_page(result, ExportSetup()).solids
    corners = 1e3 * next(solid.vertices for solid in solids if solid.kind == "fixture")
    assert np.ptp(corners, axis=0) == pytest.approx(vice().extents, abs=1e-3)


def test_a_path_planned_without_the_fixture_is_measured_and_named_where_it_runs_into_it(tmp_path):
    bare = planned(tmp_path, None)
    plan, part = PlanConfig(region="point:0,0,0", stepover_m=0.016), asked(tmp_path, vice())
    measured = measure_given_path(bare.path, part, plan)
    assert measured.figures["pad_in_part_beside"] == "fixture"
    assert measured.figures["pad_in_part_max_m"] == pytest.approx(0.015, abs=0.002)  # the clamp's height
    assert any("into the fixture" in note for note in inspect_path(bare.path, part, plan).notes)


def test_a_fixture_that_swallows_the_part_is_refused_by_name(tmp_path):
    with pytest.raises(PlanError, match=r"fixture .* own frame and unit"):
        planned(tmp_path, block((900, 900, 900)), choice="given")


def test_part_and_fixture_joined_enclose_the_volume_of_both(tmp_path):
    config = asked(tmp_path, wall(10))
    mesh = load_part(config.file, up="z")
    joined = joined_meshes(mesh, load_fixture(config.fixture_file, mesh))
    volume = trimesh.Trimesh(joined.vertices, joined.faces, process=False).volume
    assert volume == pytest.approx(1e-9 * (PLATE.volume + wall(10).volume))
