"""The shipped STL files are closed, lie on their formulas, and the freeform is curved as the paper's part."""

import numpy as np
import pytest
import trimesh

from polish_sim.config import PlanConfig
from polish_sim.errors import InputError
from polish_sim.models import workpiece_names, workpiece_path
from polish_sim.models.generate_workpieces import write_workpieces
from polish_sim.models.parts import part, parts
from polish_sim.models.shapes import normal_curvature, normals, principal_curvatures

NAMES = sorted(parts())
STL_ROUNDING = 1e-8  # single precision at 100 mm [m]


def shipped(name):
    mesh = trimesh.load(workpiece_path(name))
    mesh.vertices = mesh.vertices * 1e-3
    return mesh


def test_every_shipped_part_is_generated_with_the_same_bytes(tmp_path):
    assert list(workpiece_names()) == NAMES
    assert sorted(path.stem for path in workpiece_path("plate").parent.glob("*.stl")) == NAMES
    for look_up in (workpiece_path, part):
        with pytest.raises(InputError, match=r"'teapot'.*freeform.*plate"):
            look_up("teapot")
    for path in write_workpieces(tmp_path):
        assert path.read_bytes() == workpiece_path(path.stem).read_bytes(), path.stem


@pytest.mark.parametrize("name", NAMES)
def test_a_workpiece_is_one_closed_solid_whose_largest_smooth_face_looks_up_and_lies_on_its_formula(name):
    """So that the choice of the side to polish, which goes by size, is not left to chance."""
    mesh = shipped(name)
    assert mesh.is_volume
    assert mesh.body_count == 1
    assert mesh.bounds[0, 2] == 0.0
    assert len(mesh.faces) < 40_000
    assert workpiece_path(name).stat().st_size < 2.5e6
    smooth = mesh.face_adjacency[mesh.face_adjacency_angles < np.radians(30)]
    faces = trimesh.graph.connected_components(smooth, min_len=1)
    top = max(faces, key=lambda facets: mesh.area_faces[facets].sum())
    assert mesh.face_normals[top, 2].min() > 0.7
    corners = mesh.vertices[np.unique(mesh.faces[top])]
    truth = part(name).shape.evaluate(corners[:, :2])
    np.testing.assert_allclose(corners[:, 2], truth.height, atol=STL_ROUNDING)
    middles = part(name).shape.evaluate(mesh.triangles_center[top][:, :2])
    assert (normals(middles) * mesh.face_normals[top]).sum(axis=1).min() > np.cos(np.radians(1.5))


@pytest.mark.parametrize("name", NAMES)
def test_gradient_and_hessian_are_derivatives_of_the_height(name):
    shape, h = part(name).shape, 1e-6
    angle = np.random.default_rng(3).uniform(0, 2 * np.pi, 300)
    low, high = (0.061, 0.099) if name == "wheel_hub_rim" else (0.0, 0.6 * shipped(name).extents[1] / 2)
    radius = np.random.default_rng(4).uniform(low, high, 300)
    xy = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    here = shape.evaluate(xy)
    for i, step in enumerate(h * np.eye(2)):
        plus, minus = shape.evaluate(xy + step), shape.evaluate(xy - step)
        np.testing.assert_allclose((plus.height - minus.height) / (2 * h), here.gradient[:, i], atol=1e-8)
        np.testing.assert_allclose((plus.gradient - minus.gradient) / (2 * h), here.hessian[:, i], atol=1e-5)


def test_spheres_cylinder_saddle_and_rim_have_their_textbook_curvatures_and_the_plates_holes_go_through():
    for name, radius in (("sphere_300", 0.3), ("sphere_100", 0.1), ("sphere_50", 0.05)):
        mesh = shipped(name)
        graph = part(name).shape.evaluate(mesh.vertices[mesh.vertices[:, 2] > 0.005][:, :2])
        np.testing.assert_allclose(principal_curvatures(graph), 1 / radius, rtol=1e-9)
        assert np.linalg.norm(graph.gradient, axis=1).max() < np.tan(np.radians(35))
    cylinder = part("cylinder").shape.evaluate(np.array([[0.03, 0.02], [-0.05, 0.01]]))
    np.testing.assert_allclose(principal_curvatures(cylinder), [[1 / 0.15, 0.0]] * 2, atol=1e-12)
    saddle = part("saddle").shape.evaluate(np.zeros((1, 2)))
    np.testing.assert_allclose(principal_curvatures(saddle), [[5.0, -5.0]])
    crest = part("wheel_hub_rim").shape.evaluate(np.array([[0.08, 0.0]]))
    np.testing.assert_allclose(principal_curvatures(crest), [[1 / 0.06, 0.0]], atol=1e-12)
    mesh, plate = shipped("plate_two_holes"), part("plate_two_holes")
    assert mesh.euler_number == -2  # a ball with two handles
    assert min(hole.radius for hole in plate.holes) > PlanConfig().bridge_m / 2
    openings = sum(np.pi * hole.radius**2 for hole in plate.holes)
    top = mesh.area_faces[mesh.face_normals[:, 2] > 0.999].sum()
    assert top == pytest.approx(0.2 * 0.16 - openings, rel=1e-4)


def test_freeform_rises_to_a_sixtieth_in_six_places_of_every_outer_turn_and_is_nowhere_tighter_than_the_pad():
    angle = np.arange(3600) * 2 * np.pi / 3600
    outwards = np.column_stack([np.cos(angle), np.sin(angle)])
    along = np.column_stack([-outwards[:, 1], outwards[:, 0]])
    for radius in np.arange(0.041, 0.0961, 0.005):
        curvature = normal_curvature(part("freeform").shape.evaluate(radius * outwards), along)
        peak = (curvature > np.roll(curvature, 1)) & (curvature >= np.roll(curvature, -1))
        crests = peak & (curvature > 1 / 0.2)
        if radius > 0.065:
            assert crests.sum() == 6
            np.testing.assert_allclose(curvature[crests], 1 / 0.060, rtol=0.035)
        to_crest = np.abs(angle[:, None] - angle[crests])
        between = radius * np.minimum(to_crest, 2 * np.pi - to_crest).min(axis=1) > 0.015
        assert between.any()
        assert np.abs(curvature[between]).max() < 1 / 0.300
    n = np.linspace(-0.1, 0.1, 401)
    xy = np.stack(np.meshgrid(n, n), axis=-1).reshape(-1, 2)
    graph = part("freeform").shape.evaluate(xy[np.linalg.norm(xy, axis=1) <= 0.1])
    curvatures = principal_curvatures(graph)
    assert curvatures.max() < 1 / 0.050
    assert curvatures.min() > -1 / 0.300
