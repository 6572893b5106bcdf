"""Closest points: exact on the patches, equal to the closed form on known shapes."""

import numpy as np
import pytest

from polish_sim.geometry.fit import fit_triangles
from polish_sim.geometry.surface import Surface
from tests.geometry.shapes import Shape, cylinder, sphere, torus

SHAPES = {"sphere": sphere(4), "cylinder": cylinder(128), "torus": torus(48, jitter=0.3)}


def points_beside(shape: Shape, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points up to 0.1 to either side, their true feet, away from the cylinder's rims, and heights."""
    rng = np.random.default_rng(11)
    corners = shape.vertices[shape.faces[rng.choice(len(shape.faces), count)]]
    feet = shape.foot(np.einsum("nc,ncj->nj", rng.dirichlet([1, 1, 1], count), corners))
    if shape is SHAPES["cylinder"]:
        feet = feet[np.abs(feet[:, 2] - 1.0) < 0.9]
    heights = rng.uniform(-0.1, 0.1, len(feet))
    return feet + heights[:, None] * shape.normal(feet), feet, heights


@pytest.mark.parametrize("name", SHAPES)
def test_closest_point_and_normal_are_those_of_the_closed_form(name):
    shape = SHAPES[name]
    surface = fit_triangles(shape.vertices, shape.faces)
    points, feet, heights = points_beside(shape, 2000)
    found = surface.closest(points)
    distances = np.linalg.norm(found.positions - points, axis=1)
    assert len(points) > 1000
    assert np.abs(distances - np.abs(heights)).max() < 2e-5
    assert np.linalg.norm(found.positions - feet, axis=1).max() < 2e-3 * np.abs(heights).max() + 2e-5
    assert np.linalg.norm(found.normals - shape.normal(feet), axis=1).max() < 2e-3


def search_patch(surface: Surface, facet: int, point: np.ndarray) -> float:
    """Distance to one patch by brute force: a grid of parameters that closes in on the best place."""
    center, size = np.array([1.0, 1.0]) / 3.0, 1.0
    for _ in range(40):
        steps = size * np.linspace(-1.0, 1.0, 21)
        u, v = np.meshgrid(*np.clip(center[:, None] + steps, 0.0, 1.0))
        over = 0.5 * np.maximum(u + v - 1.0, 0.0)
        u = np.clip(u - over, 0.0, 1.0).ravel()
        v = np.minimum(np.clip(v - over, 0.0, 1.0).ravel(), 1.0 - u)
        barycentric = np.column_stack([u, v, 1.0 - u - v])
        places = surface.evaluate(np.full(len(u), facet, dtype=np.int32), barycentric).positions
        distances = np.linalg.norm(places - point, axis=1)
        center, size = barycentric[distances.argmin(), :2], 0.6 * size
    return float(distances.min())


def test_distances_agree_with_brute_force_over_all_patches_to_1e_10_m():
    shape = torus(8, major=0.05, minor=0.02, jitter=0.3)
    surface = fit_triangles(shape.vertices, shape.faces)
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (8, 3)) * [0.08, 0.08, 0.03]
    for point, position in zip(points, surface.closest(points).positions, strict=True):
        coarse = np.linalg.norm(surface.control - point, axis=2).min(axis=1)
        brute = min(search_patch(surface, int(facet), point) for facet in np.argsort(coarse)[:25])
        assert np.linalg.norm(position - point) == pytest.approx(brute, abs=1e-10)


def test_a_hint_never_changes_the_distance():
    shape = SHAPES["torus"]
    surface = fit_triangles(shape.vertices, shape.faces)
    points, _, _ = points_beside(shape, 500)
    plain = surface.closest(points)
    wild = np.random.default_rng(1).integers(0, len(shape.faces), len(points)).astype(np.int32)
    hinted = surface.closest(points, hint=wild)
    assert np.abs(plain.positions - hinted.positions).max() < 1e-9


def test_on_a_restricted_surface_only_that_part_is_found_where_it_was_before():
    shape = sphere(3)
    surface = fit_triangles(shape.vertices, shape.faces)
    upper = np.flatnonzero(shape.vertices[shape.faces][:, :, 2].min(axis=1) > 0.2).astype(np.int32)
    cap = surface.restrict(upper)
    assert (cap.is_open, surface.is_open) == (True, False)
    points = np.random.default_rng(2).normal(size=(500, 3))
    found, over = cap.closest(points), surface.closest(points)
    assert found.positions[:, 2].min() > 0.199
    both = np.isin(over.facets, upper)
    assert both.sum() > 100
    assert np.abs(over.positions[both] - found.positions[both]).max() < 1e-12


def test_a_part_of_a_part_of_a_surface_bends_as_the_whole_to_the_last_bit():
    shape = SHAPES["cylinder"]
    surface = fit_triangles(shape.vertices, shape.faces)
    rng = np.random.default_rng(3)
    first = rng.permutation(len(shape.faces))[: len(shape.faces) // 2].astype(np.int32)
    second = rng.permutation(len(first))[: len(first) // 2].astype(np.int32)
    piece, facets = surface.restrict(first).restrict(second), first[second]
    at, numbers = rng.dirichlet([1, 1, 1], len(facets)), np.arange(len(facets), dtype=np.int32)
    assert np.array_equal(piece.evaluate(numbers, at), surface.evaluate(facets, at))
    assert np.array_equal(piece.shape_operators(numbers, at), surface.shape_operators(facets, at))
    assert np.array_equal(piece.normal_control, surface.normal_control[facets])
    assert np.array_equal(piece.shape, surface.shape[facets])
    assert np.abs(surface.shape[facets]).max() > 0.0
