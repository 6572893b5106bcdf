"""Properties of the geometry, looked for counterexamples by hypothesis; every run tries the same ones."""

from __future__ import annotations

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
from tests.geometry.shapes import grid_faces

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
        faces = np.take_along_axis(
            place[faces], (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3, axis=1
        )
        vertices, faces = vertices[order], faces[rng.permutation(len(faces))]
    mesh = exact_mesh(vertices, faces, part.up)
    return select_region(fit_surface(mesh), mesh)
