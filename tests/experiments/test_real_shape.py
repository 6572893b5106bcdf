"""What the tool meets: a part unlike the drawing that its path comes from, and a fixture."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import mujoco
import numpy as np
import pytest
import trimesh

from polish_sim.config import Scenario
from polish_sim.errors import InputError, MeshError, PlanError
from polish_sim.experiments import default_scenario, prepare_force, run_experiment
from polish_sim.experiments.assembly import build_part, check_settings
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.part_setup import shape_figures
from polish_sim.experiments.surface import place_force
from polish_sim.geometry import field_distance
from polish_sim.log import RETRACT_PHASE
from polish_sim.models import workpiece_path
from polish_sim.models.parts import part
from polish_sim.planning import measure_given_path, plan_part
from polish_sim.scenario_file import merge, override
from polish_sim.spatial import apply
from tests.cell.cells import NOMINAL_PART, drawn_vertices
from tests.planning.shapes import path_through
from tests.planning.test_fixture import asked, wall

ACROSS = np.linspace(-0.06, 0.06, 13)


def on_plate(*changes):
    return override(default_scenario("force"), ["part.file=plate", *NOMINAL_PART, *changes])


def line_on_plate():
    return path_through(np.column_stack([ACROSS, 0.0 * ACROSS, np.full(len(ACROSS), 0.020)]))


def distances(scenario, *lines):
    """Signed distances [m] of points (n, 3) of the work frame from what the pad meets along a line."""
    met = build_part(scenario, replace(place_force(scenario), path=line_on_plate()))
    return [np.array([field_distance(met.field, *point) for point in line]) for line in lines]


@pytest.mark.parametrize("name", ["plate_step", "plate_ramp"])
def test_the_pad_meets_the_real_part_not_the_drawing(name):
    y = np.linspace(-0.02, 0.02, 13)
    truth = part(name).shape.evaluate(np.column_stack([ACROSS, y]))
    points = np.column_stack([ACROSS, y, truth.height])
    found, above = distances(on_plate(f"part.real_file={name}"), points, points + [0.0, 0.0, 0.002])
    away = np.abs(ACROSS) > 0.002  # at the edge itself the field of 1 mm rounds it
    np.testing.assert_allclose(found[away], 0.0, atol=2e-5)
    slanted = 0.002 / np.hypot(1.0, truth.gradient[:, 0])
    np.testing.assert_allclose(above[away], slanted[away], atol=5e-5)


def test_a_real_part_higher_than_the_band_is_still_met(tmp_path):
    """15 mm higher than drawn, beyond the 8 mm of the field and its margin."""
    solid = trimesh.load(workpiece_path("plate"))
    solid.vertices[solid.vertices[:, 2] > 10.0] += [0.0, 0.0, 15.0]
    solid.export(tmp_path / "high.stl")
    points = np.column_stack([ACROSS, 0.0 * ACROSS, np.full(13, 0.035)])
    scenario = on_plate(f"part.real_file={tmp_path / 'high.stl'}")
    on_top, below = distances(scenario, points, points - [0, 0, 0.003])
    np.testing.assert_allclose(on_top, 0.0, atol=1e-6)
    np.testing.assert_allclose(below, -0.003, atol=1e-6)


def test_the_drawing_given_as_the_real_part_changes_nothing_and_another_is_drawn_with_how_far_it_lies_off():
    short = ("process.hold_s=1", "process.approach_speed_m_s=0.05", "part.displacement_m=0.001")
    drawn = run_experiment(on_plate(*short))
    same = run_experiment(on_plate("part.real_file=plate", *short))
    np.testing.assert_allclose(same.log["normal_force_n"], drawn.log["normal_force_n"], atol=1e-3)
    scenario = on_plate("part.real_file=plate_ramp")
    model = prepare_force(scenario)[1].model
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    heights = drawn_vertices(model, data, model.geom("part").id)[:, 2]
    assert np.ptp(heights) == pytest.approx(0.0245, abs=1e-6)
    facts = shape_figures(place_force(scenario).shape, line_on_plate())["real_part"]
    assert facts["lowest_m"] == pytest.approx(0.0, abs=1e-6)
    assert facts["highest_m"] == pytest.approx(0.0045, abs=1e-6)
    assert shape_figures(place_force(on_plate()).shape, line_on_plate()) == {}


@pytest.mark.parametrize(
    ("scale", "shift", "message"),
    [
        (1.0, [500.0, 0.0, 0.0], "'plate' .* 400 mm .* 20 mm"),
        (0.1, [0.0, 0.0, -40.0], "20 x 20 x 2 mm .* 200 x 200 x 20 mm"),
    ],
)
def test_a_real_part_elsewhere_or_in_another_unit_is_refused(tmp_path, scale, shift, message):
    solid = trimesh.load(workpiece_path("plate"))
    solid.apply_scale(scale)
    solid.apply_translation(shift)
    solid.export(tmp_path / "other.stl")
    with pytest.raises(MeshError, match=message):
        prepare_force(on_plate(f"part.real_file={tmp_path / 'other.stl'}"))


@cache
def scenario(with_fixture):
    part = asked(Path(mkdtemp()), wall(10.0) if with_fixture else None)
    settings = {
        "part": {"file": part.file, "fixture_file": part.fixture_file, "up": "z", "displacement_m": 0.001},
        "plan": {
            "region": "point:0,0,0",
            "pattern": "raster",
            "stepover_m": 0.03,
            "raster_direction": [1.0, 0.0, 0.0],
        },
        "process": {"feed_m_s": 0.05, "max_feed_s": 4.0},
    }
    return merge(Scenario(experiment="surface"), settings, "")


@cache
def plan(with_fixture):
    of = scenario(with_fixture)
    return plan_part(of.part, of.plan, of.process, of.pad)


def test_a_part_in_a_fixture_that_hangs_below_it_is_placed_with_it_above_the_table_and_run_beside_it():
    result = plan(True)
    low = [mesh.vertices[:, 2].min() for mesh in (result.mesh, result.standing[0])]
    assert low == pytest.approx([-0.02, -0.03])
    T = PartPlacing(scenario(True), *result.standing, result.path).reach().T_base_work
    assert apply(T, result.standing[0].vertices)[:, 2].min() > -1e-3
    run = run_experiment(scenario(True), plan(True))
    assert run.stop_reason is None
    assert np.median(run.log["normal_force_n"][run.log.fed]) == pytest.approx(20.0, abs=1.0)


def test_a_path_planned_without_it_is_refused_or_stopped_at_the_wall_and_a_fixture_where_it_is_not_seen():
    of = scenario(True)
    blind = measure_given_path(plan(False).path, of.part, of.plan, of.process, of.pad)
    with pytest.raises(PlanError, match="into the fixture"):
        run_experiment(of, blind)
    run = run_experiment(merge(of, {"safety": {"tool_in_part": "allow"}}, ""), blind)
    assert run.stop_reason.startswith("pad, tool, wrist or forearm ran into the fixture")
    T = np.array(run.figures["T_base_work"])
    stopped = run.log["tcp_position_m"][run.log["phase"] < RETRACT_PHASE][-1]
    place = (stopped - T[:3, 3]) @ T[:3, :3]
    # The path begins 15 mm beside the wall, with a pad of 50 mm: it comes down on the wall, 10 mm high.
    assert place[0] == pytest.approx(0.065, abs=0.5e-3)
    assert place[2] == pytest.approx(0.010 + 0.5e-3, abs=0.2e-3)  # half the grid's spacing counts as touch
    with pytest.raises(InputError, match=r"part\.fixture_file .*'run surface'"):
        check_settings(merge(scenario(True), {"experiment": "force"}, ""))
