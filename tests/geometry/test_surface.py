"""The surface: closest points are exact on the patches; properties looked for by hypothesis, which tries the
same examples in every run."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from benchmarks.random_draw import RandomPart, draw_part
from benchmarks.random_parts import exact_mesh
from polish_sim.geometry import Region, fit_surface, select_region
from polish_sim.geometry.bezier import from_corners
from polish_sim.geometry.cut import clip
from polish_sim.geometry.fit import fit_triangles
from polish_sim.geometry.surface import Surface
from tests.geometry.shapes import cylinder, fit, grid_faces, sphere, torus


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


def test_distances_agree_with_brute_force_over_all_patches_to_1e_10_m_whatever_the_hint():
    surface = fit(torus(8, major=0.05, minor=0.02, jitter=0.3))
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (8, 3)) * [0.08, 0.08, 0.03]
    for point, position in zip(points, surface.closest(points).positions, strict=True):
        coarse = np.linalg.norm(surface.control - point, axis=2).min(axis=1)
        brute = min(search_patch(surface, int(facet), point) for facet in np.argsort(coarse)[:25])
        assert np.linalg.norm(position - point) == pytest.approx(brute, abs=1e-10)
    surface, rng = fit(torus(48, jitter=0.3)), np.random.default_rng(1)
    points = rng.uniform(-1.5, 1.5, (500, 3)) * [1.0, 1.0, 0.4]
    wild = rng.integers(0, len(surface.faces), len(points)).astype(np.int32)
    away = np.linalg.norm(surface.closest(points).positions - points, axis=1)
    hinted = np.linalg.norm(surface.closest(points, hint=wild).positions - points, axis=1)
    assert np.abs(away - hinted).max() < 1e-12


def test_on_a_restricted_surface_only_that_part_is_found_where_it_was_before():
    surface = fit(sphere(3))
    upper = np.flatnonzero(surface.vertices[surface.faces][:, :, 2].min(axis=1) > 0.2).astype(np.int32)
    cap = surface.restrict(upper)
    assert (cap.is_open, surface.is_open) == (True, False)
    points = np.random.default_rng(2).normal(size=(500, 3))
    found, over = cap.closest(points), surface.closest(points)
    assert found.positions[:, 2].min() > 0.199
    both = np.isin(over.facets, upper)
    assert both.sum() > 100
    assert np.abs(over.positions[both] - found.positions[both]).max() < 1e-12


def test_a_part_of_a_part_of_a_surface_bends_as_the_whole_to_the_last_bit():
    surface, rng = fit(cylinder(128)), np.random.default_rng(3)
    first = rng.permutation(len(surface.faces))[: len(surface.faces) // 2].astype(np.int32)
    second = rng.permutation(len(first))[: len(first) // 2].astype(np.int32)
    piece, facets = surface.restrict(first).restrict(second), first[second]
    at, numbers = rng.dirichlet([1, 1, 1], len(facets)), np.arange(len(facets), dtype=np.int32)
    assert np.array_equal(piece.evaluate(numbers, at), surface.evaluate(facets, at))
    assert np.array_equal(piece.shape_operators(numbers, at), surface.shape_operators(facets, at))
    assert np.array_equal(piece.normal_control, surface.normal_control[facets])
    assert np.array_equal(piece.shape, surface.shape[facets])
    assert np.abs(surface.shape[facets]).max() > 0.0


# Properties of the geometry, looked for counterexamples by hypothesis; every run tries the same ones.

CHECKED = settings(
    max_examples=6,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)

seeds = st.integers(0, 10_000)


def bumpy(seed: int, cells: int = 8) -> Surface:
    """An uneven patch of gentle bumps, turned anywhere; unit size."""
    rng = np.random.default_rng(seed)
    steps = np.linspace(-0.5, 0.5, cells + 1)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    x[1:-1, 1:-1] += 0.3 / cells * rng.uniform(-1.0, 1.0, (cells - 1, cells - 1))
    a, b = rng.uniform(-0.1, 0.1, 2)
    z = a * np.cos(4.0 * x + rng.uniform(0.0, 6.3)) + b * np.cos(3.0 * y + rng.uniform(0.0, 6.3))
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return fit_triangles(Rotation.random(random_state=rng).apply(vertices), grid_faces(cells + 1, cells + 1))


def places(surface: Surface, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    return rng.integers(0, len(surface.faces), count).astype(np.int32), rng.dirichlet([1.0, 1.0, 1.0], count)


@CHECKED
@given(seeds)
def test_no_place_of_the_surface_is_nearer_than_the_closest_point(seed):
    surface, rng = bumpy(seed), np.random.default_rng(seed)
    points = rng.uniform(-0.8, 0.8, (60, 3))
    found = surface.closest(points)
    distance = np.linalg.norm(found.positions - points, axis=1)
    every = surface.evaluate(*places(surface, 4000, rng)).positions
    others = np.linalg.norm(every[None] - points[:, None], axis=2).min(axis=1)
    assert (distance <= others + 1e-9).all()


@CHECKED
@given(seeds, st.floats(-0.3, 0.3))
def test_both_sides_of_a_cut_are_the_whole_surface_in_two(seed, level):
    surface, rng = bumpy(seed), np.random.default_rng(seed)
    across = rng.normal(size=3)
    across /= np.linalg.norm(across)
    values = surface.control @ across - level
    sides = [clip(surface, sign * values).surface for sign in (1.0, -1.0)]
    for side in sides:
        # Positions and normals stay what they were.
        some = side.evaluate(*places(side, 100, rng))
        whole = surface.closest(some.positions)
        assert np.abs(whole.positions - some.positions).max() < 1e-12
        assert np.abs(whole.normals - some.normals).max() < 1e-9
    area = sum(float(side.facet_areas.sum()) for side in sides if len(side.faces))
    # Cut lines are chords in each patch's domain; the strips between them and the plane change sides.
    assert area == pytest.approx(float(surface.facet_areas.sum()), rel=1e-6)


@CHECKED
@given(seeds)
def test_pieces_of_a_cut_share_their_corners_even_across_creases(seed):
    """What is cut may differ from side to side of a crease; neighbours still meet in the same points."""
    surface, rng = bumpy(seed, 5), np.random.default_rng(seed)
    values = from_corners(rng.uniform(-1.0, 1.0, (len(surface.faces), 3, 1)))[..., 0]
    rest = clip(surface, values).surface
    facet, edge = np.nonzero(rest.neighbours >= 0)
    other, back = rest.neighbours[facet, edge], rest.neighbour_edges[facet, edge]
    assert np.abs(rest.control[facet, edge] - rest.control[other, (back + 1) % 3]).max(initial=0.0) < 1e-12
    assert np.abs(rest.control[:, :3] - rest.vertices[rest.faces]).max(initial=0.0) < 1e-12


@CHECKED
@given(seeds)
def test_a_renumbered_part_has_the_same_surface_and_region(seed):
    part = draw_part(seed % 100, region="auto")
    found = [_region_of(part, order) for order in (None, np.random.default_rng(seed))]
    assert found[1].area_m2 == pytest.approx(found[0].area_m2, rel=1e-9)
    some = found[0].surface.evaluate(*places(found[0].surface, 300, np.random.default_rng(1)))
    again = found[1].surface.closest(some.positions)
    size = float(np.ptp(part.solid.vertices, axis=0).max())
    assert np.linalg.norm(again.positions - some.positions, axis=1).max() < 1e-9 * size


def _region_of(part: RandomPart, rng: np.random.Generator | None) -> Region:
    vertices, faces = part.solid.vertices, part.solid.faces
    if rng is not None:
        order = rng.permutation(len(vertices))
        place = np.argsort(order)
        turned = (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3
        faces = np.take_along_axis(place[faces], turned, axis=1)
        vertices, faces = vertices[order], faces[rng.permutation(len(faces))]
    mesh = exact_mesh(vertices, faces, part.up)
    return select_region(fit_surface(mesh), mesh)
