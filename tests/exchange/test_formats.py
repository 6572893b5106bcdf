"""Exports: every format once, the same bytes for one plan, the robot's tool, the command line, ROS YAML."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.errors import InputError, PlanError
from polish_sim.exchange import FORMATS, ExportSetup, RobotTool, export_plan
from polish_sim.exchange.formats import yaml_text
from polish_sim.exchange.strokes import feed_frames, rows_without_straight_air, steady_frames
from polish_sim.models import robot_model_path
from polish_sim.planning.toolpath import RETRACT, SEGMENTS
from tests.cli.conftest import polish_sim, refused
from tests.planning.shapes import shipped_plan

__all__ = ["polish_sim"]
Polish = Callable[..., tuple[int, str, str]]


def test_all_means_every_format_once_and_the_same_plan_gives_the_same_bytes(tmp_path):
    plan = shipped_plan("sphere_100")
    one, two = (export_plan(tmp_path / name, plan, ["html", "all", "html"]) for name in ("one", "two"))
    assert sorted(file.name for file in (tmp_path / "one").iterdir()) == sorted(
        kind.file for kind in FORMATS.values()
    )
    assert len(one) == len(FORMATS)
    for file, again in zip(one, two, strict=True):
        content = file.read_bytes()
        assert len(content) > 1000
        assert content == again.read_bytes(), file.name


def test_a_path_that_touches_nothing_is_no_robot_program(tmp_path):
    result = shipped_plan("sphere_100")
    path = replace(result.path, segment=np.full(len(result.path.s), RETRACT, dtype=np.int8))
    with pytest.raises(PlanError, match="no process point"):
        export_plan(tmp_path, replace(result, path=path), ["urscript"])
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_writes_what_is_asked_for(polish_sim):
    words = ("--export", "urscript", "--export", "html", "--set", "part.pose=[0.4, 0, 0.1, 0, 0, 0]")
    assert polish_sim("plan", "sphere_100", *words, "--contact-force", "12", "--out", "plan")[0] == 3
    assert {"path.script", "path.html", "path.csv", "path.png"} <= {
        file.name for file in Path("plan").iterdir()
    }
    script = Path("plan/path.script").read_text()
    assert "global T_base_work = p[0.4, 0, 0.1, 0, 0, 0]" in script
    assert "global part_is_placed = True" in script
    assert "global force_n = 12 " in script


def test_an_unknown_export_is_one_message_and_nothing_is_written(polish_sim):
    refused(
        polish_sim("plan", "sphere_100", "--export", "step", "--out", "plan"), "unknown export format 'step'"
    )
    assert not Path("plan").exists()


def test_the_default_tool_is_that_of_the_shipped_cell():
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    bodies = [model.body(name).id for name in ("tool_mount", "head")]
    mass = model.body_mass[bodies]
    flange = data.site("flange")
    middle = flange.xmat.reshape(3, 3).T @ ((mass @ data.xipos[bodies]) / mass.sum() - flange.xpos)
    tcp = flange.xmat.reshape(3, 3).T @ (data.site("tool").xpos - flange.xpos)
    tool = RobotTool()
    assert tool.payload_kg == pytest.approx(mass.sum())
    assert tool.payload_center_m == pytest.approx(middle, abs=1e-4)
    assert tool.tcp_pose == pytest.approx([*tcp, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("pose", [(0.1, 0.2, 0.3), (0.0,) * 5 + (np.nan,)])
def test_half_a_pose_is_refused(pose):
    with pytest.raises(InputError, match=r"part_pose .* is no pose"):
        ExportSetup(part_pose=pose)
    with pytest.raises(InputError, match=r"tool\.tcp_pose .* is no pose"):
        ExportSetup(tool=RobotTool(tcp_pose=pose))


@pytest.mark.parametrize(("name", "comment"), [("apt", "$$"), ("urscript", "#"), ("ros", "#")])
def test_programs_say_where_the_tool_is_in_the_part(tmp_path, name, comment):
    plan = shipped_plan("sphere_100")
    pressed = plan.path.positions_work[plan.path.process]
    middle = pressed[len(pressed) // 2]
    near = plan.path.process & (np.linalg.norm(plan.path.positions_work - middle, axis=1) < 0.01)
    (file,) = export_plan(tmp_path, replace(plan, in_part=plan.path.positions_work[near]), [name])
    lines = [line.strip() for line in file.read_text().splitlines()]
    begins = [k for k, line in enumerate(lines) if line == f"{comment} the tool is in the part from here"]
    ends = [k for k, line in enumerate(lines) if line == f"{comment} the tool is in the part up to here"]
    assert len(begins) > 0
    assert len(begins) - len(ends) in (0, 1)  # a stroke may end in the part
    assert all(begin < end for begin, end in zip(begins, ends, strict=False))
    if name == "apt":
        marked = [line for line in lines[begins[0] : ends[0]] if line.startswith("GOTO/")]
        points = 1e-3 * np.array([[float(x) for x in line[5:].split(",")[:3]] for line in marked])
        assert np.linalg.norm(points - middle, axis=1).min() < 0.01
    (clean,) = export_plan(tmp_path / "clean", plan, [name])
    assert "in the part" not in clean.read_text()


def test_the_yaml_is_a_pose_array_with_one_entry_per_pose_in_every_list_beside_it():
    yaml = pytest.importorskip("yaml")
    result = shipped_plan("sphere_100")
    odd = replace(result, mesh=replace(result.mesh, name="it's\n: a #part\x07"))
    # By YAML 1.1, which reads 1e-5 as a string; in C, for it is long.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    document = yaml.load(yaml_text(odd, ExportSetup(frame_id="part_frame")), loader)
    assert document["part"]["name"] == "it's : a #part "
    assert document["header"] == {"frame_id": "part_frame", "stamp": {"sec": 0, "nanosec": 0}}
    path = result.path.rows(rows_without_straight_air(result.path))
    assert document["segment"] == [SEGMENTS[code] for code in path.segment]
    assert document["pass_index"] == path.pass_index.tolist()
    assert document["force_n"] == pytest.approx(np.where(path.process, 20.0, 0.0))
    assert np.array(document["feed_m_s"])[path.process] == pytest.approx(0.01)
    places = np.array([[pose["position"][axis] for axis in "xyz"] for pose in document["poses"]])
    assert places == pytest.approx(path.positions_work, abs=1e-9)
    quaternions = np.array([[pose["orientation"][axis] for axis in "xyzw"] for pose in document["poses"]])
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(1.0, abs=1e-8)
    frames = Rotation.from_quat(quaternions).as_matrix()[path.process]
    # Middle of the sphere of 100 mm radius; 0.1 deg is what the fitted normals may be off.
    inward = np.array([0.0, 0.0, -0.065]) - places[path.process]
    inward /= np.linalg.norm(inward, axis=1, keepdims=True)
    assert np.sum(frames[:, :, 2] * inward, axis=1).min() > np.cos(np.radians(0.1))
    feed = np.diff(places[path.process], axis=0)
    feed /= np.linalg.norm(feed, axis=1, keepdims=True)
    assert np.sum(frames[:-1, :, 0] * feed, axis=1).min() > 0.99


@pytest.mark.parametrize("frames_of", [feed_frames, steady_frames])
def test_tool_frames_are_right_handed_with_z_into_the_part_and_keep_x_on_straight_leads(frames_of):
    path = shipped_plan("sphere_100").path
    frames = frames_of(path)
    assert np.swapaxes(frames, 1, 2) @ frames == pytest.approx(
        np.tile(np.eye(3), (len(frames), 1, 1)), abs=1e-12
    )
    assert np.linalg.det(frames) == pytest.approx(1.0)
    assert frames[:, :, 2] == pytest.approx(-path.axes_work, abs=1e-12)
    first = int(path.process.argmax())
    assert frames[:first, :, 0] == pytest.approx(np.tile(frames[first, :, 0], (first, 1)), abs=1e-9)
