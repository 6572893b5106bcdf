"""The fitted surface against closed forms; creases stay sharp, flat faces flat, the skin closed."""

from functools import partial

import numpy as np
import pytest
import trimesh

from polish_sim.geometry.features import facet_normals
from tests.geometry.shapes import cylinder, fit, prism, sphere, torus

# Least orders (of the rms error) of position, normal and curvature.
LADDERS = {
    "sphere": (sphere, (2, 3, 4), (3.8, 2.8, 1.9)),
    "cylinder": (cylinder, (32, 64, 128), (3.8, 4.5, 1.9)),
    "torus": (torus, (16, 32, 64), (3.0, 1.9, 1.9)),
    "uneven torus": (partial(torus, jitter=0.4), (16, 32, 64), (3.0, 1.9, 1.9)),
}


def errors(shape):
    """Errors of the fit and of the flat facets at random places."""
    surface, rng = fit(shape), np.random.default_rng(0)
    facets = rng.integers(0, len(shape.faces), 3000).astype(np.int32)
    barycentric = rng.dirichlet([1.0, 1.0, 1.0], 3000)
    positions, normals = surface.evaluate(facets, barycentric)
    feet, curvature = shape.foot(positions), surface.curvature(facets, barycentric)
    flat = np.einsum("nc,ncj->nj", barycentric, shape.vertices[shape.faces[facets]])
    flat_normals, true_normals = facet_normals(shape.vertices, shape.faces)[0][facets], shape.normal(feet)
    bends = np.column_stack([curvature.k1, curvature.k2])
    return {
        "position": np.linalg.norm(positions - feet, axis=1),
        "flat position": np.linalg.norm(flat - shape.foot(flat), axis=1),
        "normal": np.linalg.norm(normals - true_normals, axis=1),
        "flat normal": np.linalg.norm(flat_normals - true_normals, axis=1),
        "curvature": np.abs(bends - shape.curvatures(feet)).max(axis=1),
    }


@pytest.mark.parametrize("name", LADDERS)
def test_the_fit_converges_to_the_true_surface_faster_than_flat_facets(name):
    make, sizes, (position, normal, curvature) = LADDERS[name]
    ladder = [errors(make(size)) for size in sizes]
    rms = [{key: np.sqrt(np.mean(values**2)) for key, values in found.items()} for found in ladder]
    orders = {key: np.log2(rms[0][key] / rms[-1][key]) / 2.0 for key in rms[0]}
    worst = {key: values.max() for key, values in ladder[-1].items()}
    assert orders["position"] > position > orders["flat position"]
    assert orders["normal"] > normal > orders["flat normal"]
    assert orders["curvature"] > curvature
    assert worst["position"] < worst["flat position"] / 25.0
    assert worst["normal"] < worst["flat normal"] / 25.0
    if name == "sphere":  # of 1280 facets
        assert ladder[1]["position"].max() < ladder[1]["flat position"].max() / 250.0


def test_normals_are_continuous_and_curvatures_those_of_ball_and_torus():
    surface, facets = fit(sphere(4, radius=0.05)), np.arange(100, dtype=np.int32)
    middle = np.full((100, 3), 1.0 / 3.0)
    directions = np.random.default_rng(5).normal(size=(100, 3))
    assert surface.normal_curvature(facets, middle, directions) == pytest.approx(20.0, rel=0.005)

    surface = fit(torus(48))
    at = surface.closest(np.array([[0.6, 0.0, 0.0]]))
    for angle in np.linspace(0.0, np.pi, 7):
        direction = np.array([[0.0, np.cos(angle), np.sin(angle)]])
        # Round the hole the torus is hollow, so negative; across it convex.
        expected = -(np.cos(angle) ** 2) / 0.6 + np.sin(angle) ** 2 / 0.4
        found = surface.normal_curvature(at.facets, at.barycentric, direction)
        assert found == pytest.approx(expected, abs=0.02)
    surface = fit(torus(16, jitter=0.4))
    facet, edge = np.nonzero(surface.smooth)
    facet, edge = facet.astype(np.int32), edge.astype(np.int32)
    for t in (0.0, 0.3, 0.5):
        here, there = np.zeros((len(facet), 3)), np.zeros((len(facet), 3))
        row = np.arange(len(facet))
        other, other_edge = surface.neighbours[facet, edge], surface.neighbour_edges[facet, edge]
        here[row, edge], here[row, (edge + 1) % 3] = 1.0 - t, t
        there[row, other_edge], there[row, (other_edge + 1) % 3] = t, 1.0 - t
        a, b = surface.evaluate(facet, here), surface.evaluate(other, there)
        assert np.abs(a.positions - b.positions).max() < 1e-12
        assert np.abs(a.normals - b.normals).max() < 1e-12


def everywhere(surface):
    places = np.random.default_rng(0).dirichlet([1.0, 1.0, 1.0], 20)
    count = len(surface.faces)
    return np.repeat(np.arange(count, dtype=np.int32), 20), np.tile(places, (count, 1))


def rounded_plate():
    """A 100 x 60 x 20 mm block whose upper edges along y are rounded with 5 mm."""
    angle = np.linspace(0.0, np.pi / 2.0, 7)
    right = np.column_stack([45.0 + 5.0 * np.sin(angle), 15.0 + 5.0 * np.cos(angle)])[::-1]
    outline = np.concatenate([[[50.0, 0.0]], right, right[::-1] * [-1.0, 1.0], [[-50.0, 0.0]]])
    mesh = prism(outline, 60.0)
    return trimesh.Trimesh(1e-3 * (mesh.vertices - [0.0, 30.0, 0.0]), mesh.faces, process=False)


SOLIDS = {
    "box": trimesh.creation.box((0.1, 0.06, 0.02)),
    "cylinder": trimesh.creation.cylinder(radius=0.03, height=0.02, sections=24),
    "cone": trimesh.creation.cone(radius=0.03, height=0.02, sections=24),
    "ring": trimesh.creation.annulus(r_min=0.01, r_max=0.03, height=0.02, sections=20),
    "rounded plate": rounded_plate(),
}


def test_creases_stay_sharp_and_flat_faces_flat_also_beside_a_rounding():
    surface = fit(SOLIDS["box"])
    positions, normals = surface.evaluate(*everywhere(surface))
    inside = np.abs(positions) / [0.05, 0.03, 0.01]
    assert np.abs(inside.max(axis=1) - 1.0).max() < 1e-14
    assert np.abs(np.abs(normals).max(axis=1) - 1.0).max() < 1e-14
    assert np.abs(surface.curvature(*everywhere(surface)).k1).max() == 0.0
    # Each of the 12 edges of the box is a crease seen from both sides; the 6 diagonals are smooth.
    assert (~surface.smooth).sum() == 24
    with pytest.raises(ValueError, match="read-only"):
        surface.control[0, 0, 0] = 1.0
    mesh = SOLIDS["rounded plate"]
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


@pytest.mark.parametrize("name", SOLIDS)
def test_the_skin_is_watertight_both_sides_of_every_edge_are_one_curve(name):
    surface = fit(SOLIDS[name])
    assert (surface.neighbours >= 0).all()
    facet, edge = np.nonzero(surface.neighbours >= 0)
    other, other_edge = surface.neighbours[facet, edge], surface.neighbour_edges[facet, edge]
    assert np.array_equal(surface.control[facet, 3 + edge], surface.control[other, 3 + other_edge])


def test_the_rim_of_a_hole_is_round_and_a_cone_a_cone_up_to_its_tip():
    ring = fit(SOLIDS["ring"])
    facet, edge = np.nonzero(~ring.smooth & (ring.neighbours >= 0))
    places = np.full((len(facet), 3), 0.5)
    places[np.arange(len(facet)), (edge + 2) % 3] = 0.0
    middles = ring.evaluate(facet.astype(np.int32), places).positions
    radii = np.hypot(middles[:, 0], middles[:, 1])
    sagitta = 0.03 * (1.0 - np.cos(np.pi / 20.0))
    assert np.minimum(np.abs(radii - 0.01), np.abs(radii - 0.03)).max() < sagitta / 100.0
    assert np.abs(np.abs(middles[:, 2]) - 0.01).max() < 1e-15
    # Its facets follow each other smoothly; one normal for all at the tip would be a dome 7 mm higher.
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
