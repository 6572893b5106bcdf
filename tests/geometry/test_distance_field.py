"""Signed distances: exact ones beside edges and corners, and the trilinear field against closed forms."""

from functools import cache

import numpy as np
import pytest
import shapely
import trimesh

from polish_sim.errors import ConfigError
from polish_sim.geometry import DistanceField, build_distance_field, field_distance
from polish_sim.geometry.distance_field import bend_field, signed_distances
from polish_sim.geometry.field_lookup import look_up as distance_and_slope
from polish_sim.geometry.surface import Surface
from tests.geometry.shapes import fit, saddle, sphere, torus

H, BAND = 1e-3, 6e-3


def look_up(field, points):
    return np.array([field_distance(field, x, y, z) for x, y, z in points])


@cache
def fitted(shape) -> tuple[Surface, DistanceField]:
    return fit(shape), build_distance_field(fit(shape), H, BAND)


def box(size) -> Surface:
    return fit(trimesh.creation.box(size))


def distance_to_box(points, size):
    beyond = np.abs(points) - 0.5 * np.asarray(size)
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def test_signed_distances_are_exact_beside_edges_of_a_box_and_their_signs_beside_those_of_a_star():
    size = (0.1, 0.06, 0.02)
    points = np.random.default_rng(0).uniform(-0.08, 0.08, (5000, 3))
    assert np.abs(signed_distances(box(size), points) - distance_to_box(points, size)).max() < 1e-12
    # Closed prism over a star: reflex and sharp edges, where the nearest facet's own normal errs.
    angle = np.linspace(0.0, 2.0 * np.pi, 10, endpoint=False)
    radius = np.where(np.arange(10) % 2 == 0, 0.05, 0.015)
    outline = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    star = shapely.Polygon(outline)
    surface = fit(trimesh.creation.extrude_polygon(star, 0.02), sunk=0.01)
    points = np.random.default_rng(1).uniform(-0.06, 0.06, (5000, 3)) * [1.0, 1.0, 0.4]
    inside = shapely.contains_xy(star, *points[:, :2].T) & (np.abs(points[:, 2]) < 0.01)
    assert 300 < inside.sum() < 4000
    assert np.array_equal(signed_distances(surface, points) < 0.0, inside)


SPHERE, TORUS = sphere(4, radius=0.05), torus(48, major=0.03, minor=0.012)


def distance_to_torus(points):
    return np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.03, points[:, 2]) - 0.012


@pytest.mark.parametrize(
    ("shape", "distance", "curvature"),
    [
        (SPHERE, lambda points: np.linalg.norm(points, axis=1) - 0.05, 2.0 / 0.044),
        (TORUS, distance_to_torus, 1.0 / 0.006 + 1.0 / 0.012),
    ],
    ids=["sphere", "torus"],
)
def test_the_field_is_the_closed_form_within_its_trilinear_error(shape, distance, curvature):
    """Between nodes the error is at most h^2 (|k1| + |k2|) / 8 with the curvatures of the level sets."""
    rng, (_, field) = np.random.default_rng(2), fitted(shape)
    near = shape.vertices[rng.integers(0, len(shape.vertices), 5000)] + rng.uniform(-1e-3, 1e-3, (5000, 3))
    feet = shape.foot(near)
    points = feet + rng.uniform(-5e-3, 5e-3, (5000, 1)) * shape.normal(feet)
    fit_error = 2e-6
    assert np.abs(look_up(field, points) - distance(points)).max() < H**2 * curvature / 8.0 + fit_error
    nodes, per_metre = field.bricks.reshape(-1), 1.0 / field.spacing
    slopes = np.array([distance_and_slope(field, nodes, per_metre, x, y, z)[1:] for x, y, z in points])
    assert np.linalg.norm(slopes - shape.normal(feet), axis=1).max() < H * curvature
    # The slope is the derivative of the distance, but where a step of 0.1 um leaves the cell.
    for axis, step in enumerate(1e-7 * np.eye(3)):
        slope = (look_up(field, points[:500] + step) - look_up(field, points[:500] - step)) / 2e-7
        assert np.quantile(np.abs(slope - slopes[:500, axis]), 0.98) < 1e-6


def test_far_from_the_surface_the_field_still_knows_inside_from_outside():
    size = (0.1, 0.08, 0.06)
    field = build_distance_field(box(size), H, BAND)
    points = np.random.default_rng(3).uniform(-0.07, 0.07, (15000, 3))
    true = distance_to_box(points, size)
    found = look_up(field, points)
    far = np.abs(true) > BAND + H
    assert found[far] == pytest.approx(BAND * np.sign(true[far]), rel=1e-6)
    assert (true[far] < 0.0).sum() > 500
    # At creases the error is of first order, elsewhere the faces are exact.
    assert np.abs(found - np.clip(true, -BAND, BAND)).max() < 0.5 * H
    over_a_face = (np.abs(points[:, 0]) < 0.04) & (np.abs(points[:, 1]) < 0.03) & (np.abs(true) < BAND - H)
    assert over_a_face.sum() > 400
    assert np.abs(found - true)[over_a_face].max() < 1e-9
    # Beside a plate thinner than the band everything is outside.
    thin = build_distance_field(box((0.1, 0.06, 0.002)), H, BAND)
    beside = np.random.default_rng(4).uniform([0.0515, -0.03, -0.004], [0.055, 0.03, 0.004], (2000, 3))
    assert look_up(thin, beside).min() > 0.0


def test_beyond_the_border_of_an_open_surface_there_is_nothing_to_touch():
    surface = fit(saddle(24, radius=0.3, half_width=0.05))
    points = np.array([[0.0, 0.0, -0.002], [0.0, 0.0, 0.002], [0.06, 0.0, -0.002], [0.0, 0.056, -0.01]])
    assert np.sign(signed_distances(surface, points)).tolist() == [-1.0, 1.0, 1.0, 1.0]
    with pytest.raises(ConfigError, match="at least twice the spacing"):
        build_distance_field(surface, 2e-3, 3e-3)


def test_an_offset_moves_the_surface_outward():
    _, plain = fitted(SPHERE)

    def bend(points):
        return 2e-4 * np.cos(40.0 * points[:, 0])

    bent = bend_field(plain, lambda corners, steps: np.array([bend(corner + steps) for corner in corners]))
    points = sphere(3, radius=0.05).vertices * 1.01
    difference = look_up(plain, points) - look_up(bent, points)
    assert difference == pytest.approx(bend(points), abs=2e-4 * 40.0**2 * H**2)


def test_bounds_limit_the_memory_but_not_the_answer():
    surface, whole = fitted(SPHERE)
    cap = build_distance_field(surface, H, BAND, bounds=np.array([[-0.02, -0.02, 0.03], [0.02, 0.02, 0.06]]))
    assert cap.bricks.size < 0.2 * whole.bricks.size
    points = np.random.default_rng(6).uniform([-0.02, -0.02, 0.035], [0.02, 0.02, 0.06], (5000, 3))
    assert np.abs(look_up(cap, points) - look_up(whole, points)).max() < H**2 / 0.044 / 4.0
    assert look_up(cap, np.array([[0.0, 0.0, -0.05]]))[0] == BAND
