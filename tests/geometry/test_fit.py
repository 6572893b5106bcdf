"""Creases stay sharp, flat faces flat, the skin closed."""

import numpy as np
import pytest
import trimesh

from polish_sim.geometry.fit import fit_triangles
from polish_sim.geometry.surface import Surface
from tests.geometry.shapes import prism


def fit(mesh: trimesh.Trimesh) -> Surface:
    return fit_triangles(np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int32))


def everywhere(surface: Surface) -> tuple[np.ndarray, np.ndarray]:
    places = np.random.default_rng(0).dirichlet([1.0, 1.0, 1.0], 20)
    count = len(surface.faces)
    return np.repeat(np.arange(count, dtype=np.int32), 20), np.tile(places, (count, 1))


def rounded_plate(division: int) -> trimesh.Trimesh:
    """A 100 x 60 x 20 mm block whose upper edges along y are rounded with 5 mm."""
    angle = np.linspace(0.0, np.pi / 2.0, division + 1)
    right = np.column_stack([45.0 + 5.0 * np.sin(angle), 15.0 + 5.0 * np.cos(angle)])[::-1]
    outline = np.concatenate([[[50.0, 0.0]], right, right[::-1] * [-1.0, 1.0], [[-50.0, 0.0]]])
    mesh = prism(outline, 60.0)
    return trimesh.Trimesh(1e-3 * (mesh.vertices - [0.0, 30.0, 0.0]), mesh.faces, process=False)


def test_a_box_keeps_its_creases_and_flat_faces_exactly():
    surface = fit(trimesh.creation.box((0.1, 0.06, 0.02)))
    positions, normals = surface.evaluate(*everywhere(surface))
    inside = np.abs(positions) / [0.05, 0.03, 0.01]
    assert np.abs(inside.max(axis=1) - 1.0).max() < 1e-14
    assert np.abs(np.abs(normals).max(axis=1) - 1.0).max() < 1e-14
    curvature = surface.curvature(*everywhere(surface))
    assert np.abs(curvature.k1).max() == 0.0
    # Each of the 12 edges of the box is a crease seen from both sides; the 6 diagonals are smooth.
    assert (~surface.smooth).sum() == 24
    with pytest.raises(ValueError, match="read-only"):
        surface.control[0, 0, 0] = 1.0


def test_a_flat_face_stays_flat_where_it_runs_into_a_rounding():
    mesh = rounded_plate(6)
    surface = fit(mesh)
    facets, places = everywhere(surface)
    positions, normals = surface.evaluate(facets, places)
    top = mesh.face_normals[facets] @ [0.0, 0.0, 1.0] > 0.9999
    assert top.sum() == 40
    assert np.abs(positions[top, 2] - 0.02).max() < 1e-15
    assert np.abs(normals[top, 2] - 1.0).max() < 1e-14
    # And the rounding is the cylinder of 5 mm it stands for, far closer than its facets.
    around = np.hypot(np.abs(positions[:, 0]) - 0.045, positions[:, 2] - 0.015)
    in_rounding = (np.abs(positions[:, 0]) > 0.0451) & (positions[:, 2] > 0.0151)
    rounding = in_rounding & (np.abs(mesh.face_normals[facets][:, 1]) < 0.5)
    assert rounding.sum() > 200
    sagitta = 0.005 * (1.0 - np.cos(np.pi / 24.0))
    assert np.abs(around[rounding] - 0.005).max() < sagitta / 20.0


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box((0.1, 0.06, 0.02)),
        trimesh.creation.cylinder(radius=0.03, height=0.02, sections=24),
        trimesh.creation.annulus(r_min=0.01, r_max=0.03, height=0.02, sections=20),
        trimesh.creation.cone(radius=0.03, height=0.02, sections=24),
        rounded_plate(6),
    ],
    ids=["box", "cylinder", "ring", "cone", "rounded plate"],
)
def test_the_skin_is_watertight_both_sides_of_every_edge_are_one_curve(mesh):
    surface = fit(mesh)
    assert (surface.neighbours >= 0).all()
    facet, edge = np.nonzero(surface.neighbours >= 0)
    other, other_edge = surface.neighbours[facet, edge], surface.neighbour_edges[facet, edge]
    assert np.array_equal(surface.control[facet, 3 + edge], surface.control[other, 3 + other_edge])


def test_the_rim_of_a_drilled_hole_is_round_on_both_sides_of_the_crease():
    surface = fit(trimesh.creation.annulus(r_min=0.01, r_max=0.03, height=0.02, sections=20))
    facet, edge = np.nonzero(~surface.smooth & (surface.neighbours >= 0))
    places = np.zeros((len(facet), 3))
    places[np.arange(len(facet)), edge] = 0.5
    places[np.arange(len(facet)), (edge + 1) % 3] = 0.5
    middles = surface.evaluate(facet.astype(np.int32), places).positions
    radii = np.hypot(middles[:, 0], middles[:, 1])
    sagitta = 0.03 * (1.0 - np.cos(np.pi / 20.0))
    assert np.minimum(np.abs(radii - 0.01), np.abs(radii - 0.03)).max() < sagitta / 100.0
    assert np.abs(np.abs(middles[:, 2]) - 0.01).max() < 1e-15


def test_a_cone_is_a_cone_up_to_its_tip():
    """Its facets follow each other smoothly; one normal for all of them at the tip would make it a dome 7 mm
    higher."""
    radius, height = 0.07, 0.06
    surface = fit(trimesh.creation.cone(radius, height, sections=96))
    found = surface.evaluate(*everywhere(surface))
    side = found.normals[:, 2] > 0.1
    x, y, z = found.positions[side].T
    away = np.hypot(x, y)
    slant = np.hypot(radius, height)
    assert np.abs((z - height * (1.0 - away / radius)) * radius / slant).max() < 1e-5
    true = np.stack([height * x / away, height * y / away, np.full(len(x), radius)], axis=1) / slant
    # Facets 3.75 deg wide: half of that between their edge and their middle, seen along the slant.
    assert np.degrees(np.arccos(np.minimum((found.normals[side] * true).sum(axis=1), 1.0))).max() < 1.875
