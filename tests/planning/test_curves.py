"""Steps and offset curves keep their distance everywhere (paper 1, fig. 4, 5); the fine triangulation."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from polish_sim.errors import PlanError
from polish_sim.geometry import fit_surface, load_part, select_region
from polish_sim.geometry.surface import boundary_loops
from polish_sim.planning.curve import Curve, step_on_surface
from polish_sim.planning.ground import bridge_holes, triangulate
from polish_sim.planning.offset_curve import LevelLine, adapted_spacing, level_lines, offset_curve
from polish_sim.planning.turns import border_curves
from tests.planning.shapes import UP, Ball, Bar, Floor, circle, level, plate, region_of, square

STEP = 0.008


def roughly(points, noise=0.0):
    points = points + noise * np.random.default_rng(0).normal(size=points.shape) * [1.0, 1.0, 0.0]
    return LevelLine(points, np.tile(UP, (len(points), 1)), np.zeros(len(points), np.int64), True)


def test_an_offset_keeps_its_distance_on_a_sphere_beside_a_square_and_as_an_arc_round_a_notch():
    radius, step = 0.1, 0.008
    low = np.arccos(0.5)
    ring = circle(radius * np.sin(low), radius * np.cos(low), 4000)
    high = low - 2.0 * np.arcsin(0.5 * step / radius)
    guess = circle(radius * np.sin(high), radius * np.cos(high))
    trial = LevelLine(guess, guess / radius, np.zeros(len(guess), np.int64), True)
    found = offset_curve(Ball(radius), [Curve(ring, ring / radius, True)], trial, step)
    assert found.positions[:, 2] == pytest.approx(
        np.full(len(found.positions), radius * np.cos(high)), abs=1e-7
    )
    old = level(square(0.05), closed=True)
    found = offset_curve(Floor(), [old], roughly(square(0.042), noise=2e-4), STEP)
    distance = old.nearest(found.positions).distances
    assert distance == pytest.approx(np.full(len(distance), STEP), abs=1e-9)
    # Round a corner that points into the region the offset is an arc about the corner.
    corner = np.array([0.0, 0.0, 0.0])
    arms = [np.linspace([-0.05, -0.05, 0.0], corner, 200), np.linspace(corner, [0.05, -0.05, 0.0], 200)]
    outline = np.concatenate([*arms, [[0.05, 0.05, 0.0], [-0.05, 0.05, 0.0]]])
    angle = np.linspace(0.75 * np.pi, 0.25 * np.pi, 40)
    trial = 0.0085 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    guess = LevelLine(trial, np.tile(UP, (40, 1)), np.zeros(40, np.int64), False)
    found = offset_curve(Floor(), [level(outline, closed=True)], guess, STEP)
    assert np.linalg.norm(found.positions, axis=1) == pytest.approx(
        np.full(len(found.positions), STEP), abs=1e-9
    )


@pytest.mark.parametrize("radius", [0.004, 0.02, 0.3])
def test_control_points_stand_so_that_the_chord_error_is_the_same(radius):
    """Chord error of a chord c on a circle is c^2 / 8 R, limited on nearly straight and very tight curves."""
    chords = adapted_spacing(level(circle(radius, count=4000), closed=True), STEP)
    wanted = np.clip(np.sqrt(8.0 * radius * STEP / 4000.0), STEP / 40.0, STEP / 8.0)
    assert chords == pytest.approx(np.full(len(chords), wanted), rel=0.06)
    assert chords.sum() == pytest.approx(2.0 * np.pi * radius, rel=1e-5)


# From a point on the surface to the point exactly one step away (paper 1, fig. 4).


@pytest.mark.parametrize("surface", [Ball(0.05), Ball(0.3), Bar(0.03), Floor()])
def test_a_step_has_the_asked_length_to_a_picometre_ahead_in_the_plane_of_direction_and_normal(surface):
    rng = np.random.default_rng(0)
    foot = surface.closest(rng.normal(size=(200, 3)))
    along = np.cross(foot.normals, rng.normal(size=(200, 3)))
    lengths = np.linspace(0.0, STEP, 200)
    end = step_on_surface(surface, foot.positions, foot.normals, along, lengths)
    way = end.positions - foot.positions
    assert np.linalg.norm(way, axis=1) == pytest.approx(lengths, abs=1e-12)
    assert surface.closest(end.positions).positions == pytest.approx(end.positions, abs=1e-12)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    assert (way * np.cross(foot.normals, along)).sum(axis=1) == pytest.approx(np.zeros(200), abs=1e-11)
    assert ((way * along).sum(axis=1) >= 0.9 * lengths).all()


def coarse_plate(tmp_path, hole=None):
    outline = shapely.box(-80, -80, 80, 80)
    plate(outline if hole is None else outline - hole).export(tmp_path / "plate.stl")
    mesh = load_part(tmp_path / "plate.stl", "mm", "z")
    return select_region(fit_surface(mesh), mesh)


def enclosed(loop):
    """Area within a level loop, positive counter-clockwise."""
    return 0.5 * np.cross(loop, np.roll(loop, -1, axis=0)).sum(axis=0)[2]


def test_edges_are_short_borders_closed_vertices_on_the_surface_and_a_flood_is_refused(tmp_path):
    mesh = triangulate(coarse_plate(tmp_path).surface, 0.003)
    a, b = mesh.vertices[mesh.edges[:, 0]], mesh.vertices[mesh.edges[:, 1]]
    assert np.linalg.norm(a - b, axis=1).max() <= 0.003
    assert mesh.areas.sum() == pytest.approx(0.16**2, rel=1e-12)
    assert mesh.vertex_areas.sum() == pytest.approx(0.16**2, rel=1e-12)
    # Euler's formula of a disc: no cracks.
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.triangles) == 1
    (border,) = border_curves(mesh)
    assert border.length == pytest.approx(0.64)
    # It has the region on its left.
    assert enclosed(border.positions) == pytest.approx(0.16**2, rel=1e-9)
    with pytest.raises(PlanError, match="too large for so fine a step-over"):
        triangulate(coarse_plate(tmp_path).surface, 2e-5)
    region = region_of("sphere_50")
    mesh = triangulate(region.surface, 0.001)
    middle = np.array([0.0, 0.0, mesh.vertices[:, 2].max() - 0.05])
    radius = np.linalg.norm(mesh.vertices - middle, axis=1)
    assert radius == pytest.approx(np.full(len(radius), 0.05), abs=2e-6)
    assert (mesh.normals * (mesh.vertices - middle)).sum(axis=1).min() > 0.05 * (1.0 - 1e-4)


def test_a_level_line_of_the_distance_from_a_point_is_a_circle_with_the_higher_side_on_its_left(tmp_path):
    mesh = triangulate(coarse_plate(tmp_path).surface, 0.002)
    (line,) = level_lines(mesh, -np.linalg.norm(mesh.vertices[:, :2], axis=1), -0.05)
    assert line.closed
    assert np.linalg.norm(line.positions[:, :2], axis=1) == pytest.approx(
        np.full(len(line.positions), 0.05), abs=2e-5
    )
    assert enclosed(line.positions) == pytest.approx(np.pi * 0.05**2, rel=1e-3)
    # One that meets the border is open.
    (line,) = level_lines(mesh, mesh.vertices[:, 1], 0.0123)
    assert not line.closed
    assert np.linalg.norm(np.diff(line.positions, axis=0), axis=1).sum() == pytest.approx(0.16, rel=1e-9)


def test_a_bridged_hole_is_flat_in_a_plate_and_follows_a_sphere(tmp_path):
    region = coarse_plate(tmp_path, shapely.box(35, -5, 45, 5))
    bridged = bridge_holes(region, 0.02)
    assert bridged.holes == 1
    assert len(bridged.region.boundary_loops) == 1
    assert bridged.region.surface.facet_areas.sum() == pytest.approx(0.16**2, rel=1e-9)
    over = bridged.region.surface.closest(np.array([[0.04, 0.001, 0.02]]))
    assert over.positions[0] == pytest.approx([0.04, 0.001, 0.01], abs=1e-9)
    assert over.facets[0] >= bridged.facets
    assert bridge_holes(region, 0.01).holes == 0
    # A hole of 16 mm in a sphere of 100 mm would be 0.32 mm deep if closed flat.
    region = region_of("sphere_100")
    surface, count = region.surface, len(region.surface.faces)
    middles = surface.evaluate(np.arange(count), np.full((count, 3), 1 / 3)).positions
    holed = surface.restrict(np.flatnonzero(np.linalg.norm(middles[:, :2], axis=1) > 0.008))
    bridged = bridge_holes(replace(region, surface=holed, boundary_loops=boundary_loops(holed)), 0.03)
    assert bridged.holes == 1
    wanted = surface.closest(np.array([[0.002, 0.003, 0.04]])).positions[0]
    found = bridged.region.surface.closest(wanted[None])
    assert found.facets[0] >= bridged.facets
    assert np.linalg.norm(found.positions[0] - wanted) < 2e-5
