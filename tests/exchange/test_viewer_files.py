"""Files to look at: PLY, glTF, HTML."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from polish_sim.exchange import ExportSetup, viewers
from polish_sim.geometry.mesh import lighter_mesh
from tests.planning.shapes import shipped_plan, to_polyline

SETUP = ExportSetup()


def test_the_tube_wraps_the_path_and_is_closed():
    result = shipped_plan("plate_two_holes")
    tube = viewers.path_tube(result)
    solid = trimesh.Trimesh(tube.vertices, tube.faces, process=False)
    assert solid.is_watertight
    assert solid.volume > 0.0
    radius = viewers.RADIUS_SHARE * result.plan.stepover_m
    points = result.path.positions_work
    assert cKDTree(points).query(tube.vertices)[0].max() < 1.3 * radius
    middle = tube.vertices.reshape(-1, viewers.SIDES, 3).mean(axis=1)
    assert to_polyline(points[::25], middle).max() < viewers.CHORD_SHARE * radius * 1.01


def test_colours_run_along_the_length_and_leads_have_their_own():
    tube = viewers.path_tube(shipped_plan("sphere_100"))
    in_the_air = (tube.colors == viewers.LEAD_COLOR).all(axis=1)
    assert in_the_air[[0, -1]].all()
    in_contact = tube.colors[~in_the_air]
    # Viridis, from violet to yellow; the leads take up the last 2% of the length.
    for color, wanted in ((in_contact[0], (68, 1, 84)), (in_contact[-1], (253, 231, 37))):
        assert np.abs(color.astype(int) - wanted).max() < 20


def test_ply_holds_part_and_path_in_metres_with_colours():
    result = shipped_plan("sphere_100")
    mesh = trimesh.load(io.BytesIO(viewers.ply_bytes(result, SETUP)), file_type="ply", process=False)
    tube = viewers.path_tube(result)
    vertices = np.concatenate([result.mesh.vertices, tube.vertices])
    assert mesh.vertices == pytest.approx(vertices, abs=1e-6)
    assert len(mesh.faces) == len(result.mesh.faces) + len(tube.faces)
    assert (mesh.visual.vertex_colors[-len(tube.colors) :, :3] == tube.colors).all()


def test_glb_holds_two_named_meshes_with_y_up():
    result = shipped_plan("sphere_100")
    scene = trimesh.load(io.BytesIO(viewers.glb_bytes(result, SETUP)), file_type="glb")
    assert set(scene.geometry) == {"part", "path"}
    assert len(scene.geometry["part"].faces) == len(result.mesh.faces)
    placed = {name: scene.geometry[name].copy() for name in scene.geometry}
    for name, mesh in placed.items():
        mesh.apply_transform(scene.graph.get(name)[0])
    high = result.mesh.vertices[:, 2].max()
    assert placed["part"].bounds[1, 1] == pytest.approx(high, abs=1e-6)
    assert scene.geometry["path"].visual.vertex_colors.shape[1] == 4


def test_the_page_fetches_nothing():
    page = viewers.html_text(shipped_plan("sphere_100"), SETUP)
    code = re.sub('<script type="text/plain" id="data">.*?</script>', "", page, flags=re.DOTALL)
    for word in ("://", "src=", "url(", "import", "fetch(", "XMLHttpRequest", "WebSocket", "eval("):
        assert word not in code, word
    assert not re.search("@[A-Z]+@", code)


def test_the_page_has_part_path_and_figures_and_takes_the_time_the_feed_says():
    result = shipped_plan("sphere_100")
    page = viewers.path_page(result, SETUP)
    part = next(solid for solid in page.solids if solid.kind == "part")
    assert (part.vertices == result.mesh.vertices).all()
    assert (part.faces == result.mesh.faces).all()
    assert (page.path == result.path.positions_work).all()
    in_contact = np.ptp(page.motion.time[result.path.process])
    assert in_contact == pytest.approx(np.ptp(result.path.s[result.path.process]) / SETUP.process.feed_m_s)
    length = f"{result.figures['path_length_m']:.3f}"
    assert ["path length in contact", "m", length] in page.tables["Figures"]
    assert ["retracts", "", "1"] in page.tables["Figures"]


def test_the_pad_of_the_page_stands_on_the_path_along_its_axes():
    result = shipped_plan("sphere_100")
    page = viewers.path_page(result, SETUP)
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
        assert pose[:3, 3] == pytest.approx(result.path.positions_work[row], abs=1e-12)
        assert pose[:3, 2] == pytest.approx(-result.path.axes_work[row], abs=1e-9)


def test_a_name_cannot_break_out_of_the_page():
    result = shipped_plan("sphere_100")
    name = "</script><script>alert(1)</script>"
    page = viewers.html_text(replace(result, mesh=replace(result.mesh, name=name)), SETUP)
    assert "<script>alert" not in page
    assert page.count("</script>") == 2


def test_a_part_of_many_facets_is_shown_by_a_lighter_copy_close_to_it():
    result = shipped_plan("sphere_100")
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)
    mesh = replace(result.mesh, vertices=ball.vertices, faces=ball.faces.astype(np.int32))
    assert len(mesh.faces) > viewers.MOST_FACETS
    for most in (viewers.MOST_FACETS, 10_000):  # the latter far fewer: vertices are joined on a grid first
        vertices, faces = lighter_mesh(mesh.vertices, mesh.faces, most)
        assert most // 2 < len(faces) <= most
        assert np.abs(np.linalg.norm(vertices, axis=1) - 0.1).max() < 1e-3
        assert trimesh.Trimesh(vertices, faces).volume == pytest.approx(ball.volume, rel=0.01)
    assert len(viewers.html_text(replace(result, mesh=mesh), SETUP)) < 3_000_000
