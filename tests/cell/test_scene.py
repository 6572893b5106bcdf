"""What stands in the cell: the compiled scene, the world turned; the part as it really lies."""

import shutil

import mujoco
import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from polish_sim.cell import Touch, build_real_part, build_scene, no_part
from polish_sim.cell.dwell import would_sink
from polish_sim.cell.real_part import bend_of, build_part_fields, displacement_of, spread_over
from polish_sim.cell.scene import Drawn
from polish_sim.config import PadConfig, PartConfig, Scenario
from polish_sim.control import CONTROLLERS
from polish_sim.geometry import field_distance, load_part
from polish_sim.identification.model_file import write_portable
from polish_sim.models import workpiece_path
from polish_sim.scenario_file import override
from polish_sim.spatial import apply, transform
from tests.cell import cells
from tests.cell.cells import DOWN, PAD, press
from tests.geometry.shapes import fit


def standing(name, z=0.15):
    part = no_part()._replace(position=np.array([0.0, -0.5, z]))
    return build_scene(Scenario(), Drawn(load_part(workpiece_path(name)), part))


@pytest.mark.parametrize("name", ["plate_two_holes", "freeform", "wheel_hub_rim"])
def test_a_part_stands_in_the_cell_where_it_is_put_and_the_cell_steps(name):
    model, placed = standing(name), load_part(workpiece_path(name)).vertices + [0.0, -0.5, 0.15]
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_step(model, data, 200)
    assert not any(warning.number for warning in data.warning)
    drawn = cells.drawn_vertices(model, data, model.geom("part").id)
    np.testing.assert_allclose(drawn.min(axis=0), placed.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(drawn.max(axis=0), placed.max(axis=0), atol=1e-6)


def test_head_pad_step_table_and_stand_are_the_scenarios_and_the_drawn_part_does_not_collide():
    head = ["head.stiffness_n_m=4000", "head.damping_n_s_m=33", "head.mass_kg=0.5", "head.travel_m=0.02"]
    model = build_scene(override(Scenario(), [*head, "pad.radius_m=0.03", "simulation.timestep_s=0.0005"]))
    slide, body, usual = model.joint("head_slide"), model.body("head"), build_scene(Scenario()).body("head")
    found = slide.stiffness[0], slide.damping[0], slide.range[1], body.mass[0], model.geom("head_pad").size[0]
    assert found == pytest.approx((4000.0, 33.0, 0.02, 0.5, 0.03))
    assert model.opt.timestep == 0.0005
    np.testing.assert_allclose(body.inertia / usual.inertia, 0.5 / 0.3, rtol=1e-6)
    model, lowest = standing("plate"), load_part(workpiece_path("plate")).vertices[:, 2].min()
    assert model.geom("part").contype == model.geom("part").conaffinity == 0
    assert model.geom("table").contype == 1
    assert model.geom("table").pos[2] + model.geom("table").size[2] == pytest.approx(0.0)
    stand = model.geom("stand")
    assert stand.pos[2] - stand.size[2] == pytest.approx(0.0, abs=0.001)
    assert 0.15 + lowest - 0.002 < stand.pos[2] + stand.size[2] < 0.15 + lowest
    on_table = standing("plate", z=-float(lowest))
    assert not any(on_table.geom(i).name == "stand" for i in range(on_table.ngeom))


def test_meshes_of_one_name_and_a_texture_travel_with_the_model(tmp_path):
    one, two, written = tmp_path / "one", tmp_path / "two", tmp_path / "written"
    for folder, name in ((one, "plate"), (two, "saddle"), (written, "")):
        folder.mkdir()
        if name:
            shutil.copyfile(workpiece_path(name), folder / "part.stl")
    Image.fromarray(np.zeros((4, 4, 3), dtype=np.uint8)).save(one / "skin.png")
    xml = f"""
    <mujoco>
      <compiler meshdir="{one}" texturedir="{one}"/>
      <asset>
        <mesh file="part.stl"/> <mesh name="other" file="{two / "part.stl"}"/>
        <texture type="2d" file="skin.png"/>
      </asset>
      <worldbody><geom type="mesh" mesh="part"/> <geom type="mesh" mesh="other"/></worldbody>
    </mujoco>"""
    before = mujoco.MjModel.from_xml_string(xml)
    write_portable(written / "model.xml", xml)
    shutil.rmtree(one)
    shutil.rmtree(two)
    after = mujoco.MjModel.from_xml_path(str(written.rename(tmp_path / "moved") / "model.xml"))
    np.testing.assert_array_equal(after.mesh_vertnum, before.mesh_vertnum)
    assert after.ntex == 1


def run_turned(angle, controller):
    """Press on a ball that lies 2 mm aside and 1 mm low, and slide over it, with noise and spindle on."""
    turn = transform(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix(), np.zeros(3))
    stroke = cells.pressing_stroke(turn @ cells.TOUCH, slide=0.01, lift=0.005)
    part = cells.part_under(turn @ cells.along_tool(cells.TOUCH, 0.002, 0.001, 0.001), cells.sphere(0.1))
    noise = "sensor.force_noise_n=0.5", "sensor.force_bias_n=3", "spindle.speed_rpm=6000"
    scenario = cells.ideal("force", cells.EVERY_STEP, f"controller.name={controller}", *noise)
    cell = cells.cell_for(scenario, stroke, part=part)
    straight = cells.joints_at(cells.along_tool(cells.TOUCH, z=-0.005))
    np.testing.assert_allclose(cell.data.qpos[:6] - straight, [angle, 0, 0, 0, 0, 0], atol=1e-9)
    return cell.run()


@pytest.mark.parametrize("controller", CONTROLLERS)
def test_a_world_turned_about_the_robots_axis_changes_nothing(controller):
    here, there = run_turned(0.0, controller), run_turned(-1.0, controller)
    assert here.stop_reason is None
    np.testing.assert_array_equal(here.trace.phase, there.trace.phase)
    np.testing.assert_allclose(here.trace.normal_force_n, there.trace.normal_force_n, atol=1e-6)
    np.testing.assert_allclose(here.log["wrench_true_tool"], there.log["wrench_true_tool"], atol=1e-5)
    np.testing.assert_allclose(here.log["q_rad"][:, 1:], there.log["q_rad"][:, 1:], atol=1e-6)
    turned = Rotation.from_rotvec([0.0, 0.0, -1.0]).apply(here.trace.tcp_position_m)
    np.testing.assert_allclose(there.trace.tcp_position_m, turned, atol=1e-9)


def test_a_cell_spends_no_time_on_the_engines_timers():
    cell = cells.on_plane("process.max_feed_s=0.1")
    before = [stage.duration for stage in cell.data.timer]
    assert cell.run().steps > 100
    assert [stage.duration for stage in cell.data.timer] == before


UP = np.array([0.0, 0.0, 1.0])
THICKNESS = 0.003
SMALL_PAD = PadConfig(radius_m=0.01)
HALF, DEEPEST = 0.05, 0.008
T_BASE_WORK = transform(Rotation.from_rotvec([0.2, -0.1, 0.7]).as_matrix(), np.array([0.1, -0.5, 0.2]))


@pytest.fixture(scope="module")
def sheet():
    """A sheet 100 x 100 x 3 mm, its top in the plane z = 0."""
    return fit(trimesh.creation.box((0.1, 0.1, THICKNESS)).subdivide().subdivide(), sunk=THICKNESS / 2)


def real(sheet, config, seed=0):
    touch = Touch(np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]), np.array([UP, UP]), PAD.radius_m)
    fields, rng = build_part_fields(sheet, touch), np.random.default_rng(seed)
    return build_real_part(fields, config, T_BASE_WORK, top_of(sheet), UP, rng)


def top_of(sheet):
    heights = sheet.vertices[sheet.faces][:, :, 2]
    return sheet.restrict(np.flatnonzero(np.all(heights > -1e-9, axis=1)).astype(np.int32))


def test_displacement_and_form_error_have_their_size_direction_and_shortest_wave():
    normal, center, along = np.array([0.6, 0.0, 0.8]), np.array([0.05, -0.02, 0.1]), []
    for seed in range(200):
        T = displacement_of(PartConfig(), normal, center, np.random.default_rng(seed))
        shift = apply(T, center[None])[0] - center
        assert np.linalg.norm(shift) == pytest.approx(0.001)
        assert Rotation.from_matrix(T[:3, :3]).magnitude() == pytest.approx(PartConfig().rotation_rad)
        along.append(shift @ normal / 0.001)
    assert np.abs(along).min() >= 0.7
    assert np.abs(along).min() < 0.72
    assert 60 < np.sum(np.array(along) > 0.0) < 140
    rng, h = np.random.default_rng(1), 1e-4
    points = np.column_stack([rng.uniform(-0.1, 0.1, (3000, 2)), np.zeros(3000)])
    crossed = (points[:5, None] + points[5:9]).reshape(-1, 3)
    for seed in range(10):
        bend = bend_of(PartConfig(), points, np.random.default_rng(seed))
        values = bend(points)
        assert np.ptp(values) == pytest.approx(0.0003)
        assert values.max() == pytest.approx(-values.min())
        np.testing.assert_allclose(bend.on_grid(points[:5], points[5:9]).ravel(), bend(crossed), atol=1e-17)
        curvature = (bend(points + [h, 0, 0]) - 2.0 * values + bend(points - [h, 0, 0])) / h**2
        assert np.abs(curvature).max() < 0.00015 * 8 * (2.0 * np.pi / 0.04) ** 2


def test_a_part_lies_where_it_is_placed_as_drawn_or_bent_as_the_form_error_of_its_seed_says(sheet):
    part = real(sheet, PartConfig(displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0))
    np.testing.assert_allclose(part.rotation, T_BASE_WORK[:3, :3], atol=1e-15)
    np.testing.assert_allclose(part.position, T_BASE_WORK[:3, 3], atol=1e-15)
    R = T_BASE_WORK[:3, :3] @ DOWN
    # Deeper than half a thin sheet the pad is pushed out the way it came; half over the edge it feels half.
    for x, depth, force, off in (
        (0.01, -0.0005, 0.0, 0.0), (0.01, 0.002, 40.0, 1e-3),
        (0.0, 0.9 * THICKNESS, 54.0, 0.01), (0.05, 0.001, 10.0, 0.5),
    ):  # fmt: skip
        center = apply(T_BASE_WORK, np.array([[x, 0.005, -depth]]))[0]
        pushed = T_BASE_WORK[:3, :3].T @ press(part, center, R).force
        np.testing.assert_allclose(pushed, [0.0, 0.0, force], atol=off)
    # Not just where the pad goes; to half a cell: inside a sheet thinner than a cell no node is negative.
    places, coarse = np.random.default_rng(0).uniform(-0.05, 0.05, (500, 2)), part.coarse
    levels = -THICKNESS / 2 + np.array([0.0, 0.008])
    inside, beside = ([field_distance(coarse, *place, z) for place in places] for z in levels)
    assert max(inside) < 0.5 * coarse.spacing < min(beside)
    config = PartConfig(displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0003)
    part, top = real(sheet, config, seed=3), top_of(sheet)
    bend = bend_of(config, spread_over(top), np.random.default_rng(3))
    points = np.column_stack([np.random.default_rng(0).uniform(-0.03, 0.03, (200, 2)), np.zeros(200)])
    found = [field_distance(part.field, *point) for point in points]
    np.testing.assert_allclose(found, -bend(points), atol=1e-6)
    assert np.ptp(found) > 0.0001
    shifts = [real(sheet, PartConfig(), seed).position for seed in (5, 5, 6)]
    np.testing.assert_array_equal(shifts[0], shifts[1])
    assert not np.array_equal(shifts[0], shifts[2])


@pytest.fixture(scope="module")
def block():
    """A block with an edge at x = 50 mm, as the pad meets it near there."""
    surface = fit(trimesh.creation.box((2.0 * HALF, 0.06, 0.02)), sunk=0.01)
    near_it = np.array([[0.03, 0.0, 0.0], [0.06, 0.0, 0.0]])
    return build_part_fields(surface, Touch(near_it, np.array([UP, UP]), SMALL_PAD.radius_m))


def sinks(block, x, force, aside):
    """Whether the pad sinks with its middle at ``x`` (n,) [m]."""
    places = np.column_stack([x, np.zeros((len(x), 2))])
    ups, forces = np.tile(UP, (len(x), 1)), np.full(len(x), force)
    return would_sink(block, SMALL_PAD, places, ups, forces, aside)


def test_near_an_edge_the_hold_is_lost_earlier_on_a_part_that_lies_aside(block):
    """Inside it lasts up to the force of the pad's springs at the depth there is."""
    most, inside = SMALL_PAD.stiffness_n_m * DEEPEST, np.array([0.03])
    assert not sinks(block, inside, 0.99 * most, 0.001).any()
    assert sinks(block, inside, 1.01 * most, 0.0).all()
    x = np.arange(0.03, 0.06, 0.00025)
    lost = [sinks(block, x, 20.0, aside) for aside in (0.0, 0.003, 0.005)]
    for found in lost:
        assert 0 < np.count_nonzero(found) < len(x)
    straight, shifted, further = (x[found.argmax()] for found in lost)
    assert straight > HALF  # with its middle on the edge a half of the pad is left, and enough
    assert straight - shifted > 0.001
    assert shifted - further > 0.001
