"""Exports: every format once, the same bytes for one plan; programs, ROS YAML, and files to look at."""

import io
import re
from dataclasses import replace
from functools import partial
from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from polish_sim.errors import InputError, PlanError
from polish_sim.exchange import FORMATS, ExportSetup, RobotTool, export_plan, viewers
from polish_sim.exchange.formats import yaml_text
from polish_sim.exchange.strokes import feed_frames, rows_without_straight_air, steady_frames
from polish_sim.geometry.mesh import lighter_mesh
from polish_sim.models import robot_model_path
from polish_sim.planning.toolpath import RETRACT, SEGMENTS
from tests.cli.conftest import polish_sim, refused
from tests.planning.shapes import shipped_plan, to_polyline

__all__ = ["polish_sim"]
sphere = partial(shipped_plan, "sphere_100")


def test_all_means_every_format_once_with_the_same_bytes_and_no_program_of_what_touches_nothing(tmp_path):
    one, two = (export_plan(tmp_path / name, sphere(), ["html", "all", "html"]) for name in ("one", "two"))
    files = sorted(file.name for file in (tmp_path / "one").iterdir())
    assert files == sorted(kind.file for kind in FORMATS.values())
    assert len(one) == len(FORMATS)
    for file, again in zip(one, two, strict=True):
        content = file.read_bytes()
        assert len(content) > 1000
        assert content == again.read_bytes(), file.name
    path = replace(sphere().path, segment=np.full_like(sphere().path.segment, RETRACT))
    with pytest.raises(PlanError, match="no process point"):
        export_plan(tmp_path / "none", replace(sphere(), path=path), ["urscript"])
    assert not (tmp_path / "none").exists()


def test_the_command_line_writes_what_is_asked_for_and_of_an_unknown_export_nothing(polish_sim):
    words = ("plan", "sphere_100", "--out", "plan", "--export")
    refused(polish_sim(*words, "step"), "unknown export format 'step'")
    assert not Path("plan").exists()
    setup = ("--set", "part.pose=[0.4, 0, 0.1, 0, 0, 0]", "--contact-force", "12")
    assert polish_sim(*words, "urscript", "--export", "html", *setup)[0] == 3
    files = {file.name for file in Path("plan").iterdir()}
    assert {"path.script", "path.html", "path.csv", "path.png"} <= files
    script = Path("plan/path.script").read_text()
    assert "global T_base_work = p[0.4, 0, 0.1, 0, 0, 0]" in script
    assert "global part_is_placed = True" in script
    assert "global force_n = 12 " in script


def test_the_default_tool_is_that_of_the_shipped_cell_and_half_a_pose_is_refused():
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    data, tool = mujoco.MjData(model), RobotTool()
    mujoco.mj_forward(model, data)
    bodies, flange = [model.body(name).id for name in ("tool_mount", "head")], data.site("flange")
    mass, R = model.body_mass[bodies], flange.xmat.reshape(3, 3)
    middle = R.T @ ((mass @ data.xipos[bodies]) / mass.sum() - flange.xpos)
    tcp = R.T @ (data.site("tool").xpos - flange.xpos)
    assert tool.payload_kg == pytest.approx(mass.sum())
    assert tool.payload_center_m == pytest.approx(middle, abs=1e-4)
    assert tool.tcp_pose == pytest.approx([*tcp, 0.0, 0.0, 0.0], abs=1e-9)
    for pose in ((0.1, 0.2, 0.3), (0.0,) * 5 + (np.nan,)):
        with pytest.raises(InputError, match=r"part_pose .* is no pose"):
            ExportSetup(part_pose=pose)
        with pytest.raises(InputError, match=r"tool\.tcp_pose .* is no pose"):
            ExportSetup(tool=RobotTool(tcp_pose=pose))


@pytest.mark.parametrize(("name", "comment"), [("apt", "$$"), ("urscript", "#"), ("ros", "#")])
def test_programs_say_where_the_tool_is_in_the_part(tmp_path, name, comment):
    points = sphere().path.positions_work
    pressed = points[sphere().path.process]
    middle = pressed[len(pressed) // 2]
    near = sphere().path.process & (np.linalg.norm(points - middle, axis=1) < 0.01)
    (file,) = export_plan(tmp_path, replace(sphere(), in_part=points[near]), [name])
    lines = [line.strip() for line in file.read_text().splitlines()]
    begins, ends = (
        [k for k, line in enumerate(lines) if line == f"{comment} the tool is in the part {word} here"]
        for word in ("from", "up to")
    )
    assert len(begins) > 0
    assert len(begins) - len(ends) in (0, 1)  # a stroke may end in the part
    assert all(begin < end for begin, end in zip(begins, ends, strict=False))
    if name == "apt":
        marked = [line for line in lines[begins[0] : ends[0]] if line.startswith("GOTO/")]
        points = 1e-3 * np.array([[float(x) for x in line[5:].split(",")[:3]] for line in marked])
        assert np.linalg.norm(points - middle, axis=1).min() < 0.01
    (clean,) = export_plan(tmp_path / "clean", sphere(), [name])
    assert "in the part" not in clean.read_text()


def test_the_yaml_is_a_pose_array_with_one_entry_per_pose_in_every_list_beside_it():
    yaml, result = pytest.importorskip("yaml"), sphere()
    odd = replace(result, mesh=replace(result.mesh, name="it's\n: a #part\x07"))
    # By YAML 1.1, which reads 1e-5 as a string; in C, for it is long.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    document = yaml.load(yaml_text(odd, ExportSetup(frame_id="part_frame")), loader)
    assert document["part"]["name"] == odd.mesh.name
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
    for inward, axes, least in (
        (np.array([0.0, 0.0, -0.065]) - places[path.process], frames[:, :, 2], np.cos(np.radians(0.1))),
        (np.diff(places[path.process], axis=0), frames[:-1, :, 0], 0.99),
    ):
        along = inward / np.linalg.norm(inward, axis=1, keepdims=True)
        assert np.sum(axes * along, axis=1).min() > least


@pytest.mark.parametrize("frames_of", [feed_frames, steady_frames])
def test_tool_frames_are_right_handed_with_z_into_the_part_and_keep_x_on_straight_leads(frames_of):
    path, frames = sphere().path, frames_of(sphere().path)
    unity = np.tile(np.eye(3), (len(frames), 1, 1))
    assert np.swapaxes(frames, 1, 2) @ frames == pytest.approx(unity, abs=1e-12)
    assert np.linalg.det(frames) == pytest.approx(1.0)
    assert frames[:, :, 2] == pytest.approx(-path.axes_work, abs=1e-12)
    first = int(path.process.argmax())
    assert frames[:first, :, 0] == pytest.approx(np.tile(frames[first, :, 0], (first, 1)), abs=1e-9)


SETUP = ExportSetup()


def test_the_tube_wraps_the_path_and_ply_and_glb_hold_it_and_the_part_in_metres_with_colours():
    result = shipped_plan("plate_two_holes")
    tube = viewers.path_rods(result)
    assert tube.is_watertight
    assert tube.volume > 0.0
    radius, points = viewers.RADIUS_SHARE * result.plan.stepover_m, result.path.positions_work
    assert cKDTree(points).query(tube.vertices)[0].max() < 1.3 * radius
    rod = trimesh.creation.cylinder(1.0, 1.0, sections=viewers.SIDES).vertices
    ends = np.lexsort((rod[:, 2], rod[:, 0] ** 2 + rod[:, 1] ** 2 > 0.5))[:2]
    line = tube.vertices.reshape(-1, len(rod), 3)[:, ends].reshape(-1, 3)
    assert to_polyline(points[::25], line).max() < viewers.CHORD_SHARE * radius * 1.01
    part, tube = sphere().mesh, viewers.path_rods(sphere())
    drawn = tube.visual.vertex_colors[:, :3]
    in_the_air = (drawn == viewers.LEAD_COLOR).all(axis=1)
    assert in_the_air[[0, -1]].all()
    in_contact = drawn[~in_the_air]
    # Viridis, from violet to yellow; the leads take up the last 2% of the length.
    for color, wanted in ((in_contact[0], (68, 1, 84)), (in_contact[-1], (253, 231, 37))):
        assert np.abs(color.astype(int) - wanted).max() < 20
    mesh = trimesh.load(io.BytesIO(viewers.ply_bytes(sphere(), SETUP)), file_type="ply", process=False)
    assert mesh.vertices == pytest.approx(np.concatenate([part.vertices, tube.vertices]), abs=1e-6)
    assert len(mesh.faces) == len(part.faces) + len(tube.faces)
    assert (mesh.visual.vertex_colors[-len(drawn) :, :3] == drawn).all()
    scene = trimesh.load(io.BytesIO(viewers.glb_bytes(sphere(), SETUP)), file_type="glb")
    assert set(scene.geometry) == {"part", "path"}
    assert len(scene.geometry["part"].faces) == len(part.faces)
    placed = scene.geometry["part"].copy().apply_transform(scene.graph.get("part")[0])
    assert placed.bounds[1, 1] == pytest.approx(part.vertices[:, 2].max(), abs=1e-6)
    assert scene.geometry["path"].visual.vertex_colors.shape[1] == 4


def test_the_page_has_part_path_figures_and_a_moving_pad_fetches_nothing_and_cannot_be_broken_out_of():
    page = viewers.html_text(sphere(), SETUP)
    code = re.sub('<script type="text/plain" id="data">.*?</script>', "", page, flags=re.DOTALL)
    for word in ("://", "src=", "url(", "import", "fetch(", "XMLHttpRequest", "WebSocket", "eval("):
        assert word not in code, word
    assert not re.search("@[A-Z]+@", code)
    named = replace(sphere().mesh, name="</script><script>alert(1)</script>")
    page = viewers.html_text(replace(sphere(), mesh=named), SETUP)
    assert "<script>alert" not in page
    assert page.count("</script>") == 2
    result, path = sphere(), sphere().path
    page = viewers.path_page(result, SETUP)
    part = next(solid for solid in page.solids if solid.kind == "part")
    assert (part.vertices == result.mesh.vertices).all()
    assert (part.faces == result.mesh.faces).all()
    assert (page.path == path.positions_work).all()
    in_contact = np.ptp(page.motion.time[path.process])
    assert in_contact == pytest.approx(np.ptp(path.s[path.process]) / SETUP.process.feed_m_s)
    length = f"{result.figures['path_length_m']:.3f}"
    assert ["path length in contact", "m", length] in page.tables["Figures"]
    assert ["retracts", "", "1"] in page.tables["Figures"]
    for row in range(0, len(page.motion.time), 97):
        pose = np.eye(4)
        for body in page.bodies[1:]:  # the first one turns the part upright
            joint, step = body.joint, np.eye(4)
            value = page.motion.joints[row, joint] if joint >= 0 else 0.0
            if body.slide:
                step[:3, 3] = value * np.array(body.axis)
            else:
                step[:3, :3] = Rotation.from_rotvec(value * np.array(body.axis)).as_matrix()
            pose = pose @ np.array(body.rest) @ step
        assert pose[:3, 3] == pytest.approx(path.positions_work[row], abs=1e-12)
        assert pose[:3, 2] == pytest.approx(-path.axes_work[row], abs=1e-9)


def test_a_part_of_many_facets_is_shown_by_a_lighter_copy_close_to_it():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    mesh = replace(sphere().mesh, vertices=ball.vertices, faces=ball.faces.astype(np.int32))
    assert len(mesh.faces) > viewers.MOST_FACETS
    for most in (viewers.MOST_FACETS, 10_000):  # the latter far fewer: vertices are joined on a grid first
        vertices, faces = lighter_mesh(mesh.vertices, mesh.faces, most)
        assert most // 2 < len(faces) <= most
        assert np.abs(np.linalg.norm(vertices, axis=1) - 0.1).max() < 1e-3
        assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(ball.volume, rel=0.01)
    assert len(viewers.html_text(replace(sphere(), mesh=mesh), SETUP)) < 3_000_000
