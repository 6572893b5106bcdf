"""The compiled scene: what stands where, its file, the world turned."""

import shutil

import mujoco
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from polish_sim.cell import build_scene, no_part
from polish_sim.cell.scene import Drawn
from polish_sim.config import Scenario
from polish_sim.control import CONTROLLERS
from polish_sim.geometry import load_part
from polish_sim.identification.model_file import write_portable
from polish_sim.models import workpiece_path
from polish_sim.scenario_file import override
from polish_sim.spatial import transform
from tests.cell import cells


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
