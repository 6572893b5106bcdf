"""Steps and offset curves keep their distance (paper 1, fig. 4, 5); crossings are counted and cut."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from polish_sim.arrays import foot_on_chord, unit
from polish_sim.errors import PlanError
from polish_sim.geometry.surface import ClosestPoints
from polish_sim.planning.curve import Curve, step_on_surface
from polish_sim.planning.ground import bridge_holes, triangulate
from polish_sim.planning.offset_curve import LevelLine, adapted_spacing, level_lines, offset_curve
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.planner import uncross
from polish_sim.planning.quality.crossings import find_crossings
from polish_sim.planning.turns import border_curves
from tests.geometry import shapes as geometry
from tests.planning.shapes import UP, circle, level, plate, region_of, square

LINE = [(0, 0), (1, 0), (2, 0)]
LONG = [*LINE, (3, 0)]
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]
STEP = 0.008


class Known:
    """A surface whose closest points and normals are formulas of points (n, 3)."""

    def __init__(self, foot, normal):
        self.foot, self.normal = foot, normal

    def closest(self, points, hint=None):
        foot, count = self.foot(points), len(points)
        return ClosestPoints(foot, self.normal(foot), np.zeros(count, np.int32), np.tile(UP, (count, 1)))


def ball(radius):
    return Known(lambda points: radius * unit(points), unit)


FLOOR = Known(lambda points: points * [1.0, 1.0, 0.0], lambda points: np.tile(UP, (len(points), 1)))
ACROSS, ALONG = np.array([1.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
BAR = Known(lambda points: 0.03 * unit(points * ACROSS) + points * ALONG, lambda foot: unit(foot * ACROSS))


def test_an_offset_keeps_its_distance_on_a_sphere_beside_a_square_and_as_an_arc_round_a_notch():
    radius, low = 0.1, np.arccos(0.5)
    ring = circle(radius * np.sin(low), radius * np.cos(low), 4000)
    high = low - 2.0 * np.arcsin(0.5 * STEP / radius)
    guess = circle(radius * np.sin(high), radius * np.cos(high))
    trial = LevelLine(guess, guess / radius, np.zeros(len(guess), np.int64), True)
    found = offset_curve(ball(radius), [Curve(ring, ring / radius, True)], trial, STEP)
    assert found.positions[:, 2] == pytest.approx(radius * np.cos(high), abs=1e-7)
    old = level(square(0.05), closed=True)
    rough = square(0.042) + np.random.default_rng(0).normal(scale=2e-4, size=(800, 3)) * [1.0, 1.0, 0.0]
    trial = LevelLine(rough, np.tile(UP, (800, 1)), np.zeros(800, np.int64), True)
    found = offset_curve(FLOOR, [old], trial, STEP)
    assert old.nearest(found.positions).distances == pytest.approx(STEP, abs=1e-9)
    # Round a corner that points into the region the offset is an arc about the corner.
    corner = np.array([0.0, 0.0, 0.0])
    arms = [np.linspace([-0.05, -0.05, 0.0], corner, 200), np.linspace(corner, [0.05, -0.05, 0.0], 200)]
    outline = np.concatenate([*arms, [[0.05, 0.05, 0.0], [-0.05, 0.05, 0.0]]])
    angle = np.linspace(0.75 * np.pi, 0.25 * np.pi, 40)
    trial = 0.0085 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    guess = LevelLine(trial, np.tile(UP, (40, 1)), np.zeros(40, np.int64), False)
    found = offset_curve(FLOOR, [level(outline, closed=True)], guess, STEP)
    assert np.linalg.norm(found.positions, axis=1) == pytest.approx(STEP, abs=1e-9)


@pytest.mark.parametrize("radius", [0.004, 0.02, 0.3])
def test_control_points_stand_so_that_the_chord_error_is_the_same(radius):
    """Chord error of a chord c on a circle is c^2 / 8 R, limited on nearly straight and very tight curves."""
    chords = adapted_spacing(level(circle(radius, count=4000), closed=True), STEP)
    wanted = np.clip(np.sqrt(8.0 * radius * STEP / 4000.0), STEP / 40.0, STEP / 8.0)
    assert chords == pytest.approx(wanted, rel=0.06)
    assert chords.sum() == pytest.approx(2.0 * np.pi * radius, rel=1e-5)


@pytest.mark.parametrize("surface", [ball(0.05), ball(0.3), BAR, FLOOR])
def test_a_step_has_the_asked_length_to_a_picometre_ahead_in_the_plane_of_direction_and_normal(surface):
    """To the point exactly one step away (paper 1, fig. 4)."""
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


OUTLINE = shapely.box(-80, -80, 80, 80)
COARSE = geometry.region_of(plate(OUTLINE))


def test_edges_are_short_borders_closed_vertices_on_the_surface_and_a_flood_is_refused():
    mesh = triangulate(COARSE.surface, 0.003)
    a, b = mesh.vertices[mesh.edges[:, 0]], mesh.vertices[mesh.edges[:, 1]]
    assert np.linalg.norm(a - b, axis=1).max() <= 0.003
    assert mesh.areas.sum() == pytest.approx(0.16**2, rel=1e-12)
    assert mesh.vertex_areas.sum() == pytest.approx(0.16**2, rel=1e-12)
    # Euler's formula of a disc: no cracks.
    assert len(mesh.vertices) - len(mesh.edges) + len(mesh.triangles) == 1
    (border,) = border_curves(mesh)
    assert border.length == pytest.approx(0.64)
    assert geometry.enclosed(border.positions, UP) == pytest.approx(0.16**2, rel=1e-9)
    with pytest.raises(PlanError, match="too large for so fine a step-over"):
        triangulate(COARSE.surface, 2e-5)
    mesh = triangulate(region_of("sphere_50").surface, 0.001)
    middle = np.array([0.0, 0.0, mesh.vertices[:, 2].max() - 0.05])
    assert np.linalg.norm(mesh.vertices - middle, axis=1) == pytest.approx(0.05, abs=2e-6)
    assert (mesh.normals * (mesh.vertices - middle)).sum(axis=1).min() > 0.05 * (1.0 - 1e-4)


def test_a_level_line_of_the_distance_from_a_point_is_a_circle_with_the_higher_side_on_its_left():
    mesh = triangulate(COARSE.surface, 0.002)
    (line,) = level_lines(mesh, -np.linalg.norm(mesh.vertices[:, :2], axis=1), -0.05)
    assert line.closed
    assert np.linalg.norm(line.positions[:, :2], axis=1) == pytest.approx(0.05, abs=2e-5)
    assert geometry.enclosed(line.positions, UP) == pytest.approx(np.pi * 0.05**2, rel=1e-3)
    (line,) = level_lines(mesh, mesh.vertices[:, 1], 0.0123)
    assert not line.closed
    assert np.linalg.norm(np.diff(line.positions, axis=0), axis=1).sum() == pytest.approx(0.16, rel=1e-9)


def test_a_bridged_hole_is_flat_in_a_plate_and_follows_a_sphere():
    region = geometry.region_of(plate(OUTLINE - shapely.box(35, -5, 45, 5)))
    bridged, holes = bridge_holes(region, 0.02)
    assert holes == 1
    assert len(bridged.boundary_loops) == 1
    assert bridged.surface.facet_areas.sum() == pytest.approx(0.16**2, rel=1e-9)
    over = bridged.surface.closest(np.array([[0.04, 0.001, 0.02]]))
    assert over.positions[0] == pytest.approx([0.04, 0.001, 0.01], abs=1e-9)
    assert over.facets[0] >= len(region.surface.faces)
    assert bridge_holes(region, 0.01)[1] == 0
    # A hole of 16 mm in a sphere of 100 mm would be 0.32 mm deep if closed flat.
    region = region_of("sphere_100")
    surface = region.surface
    middles = geometry.at_middle(surface).positions
    holed = surface.restrict(np.flatnonzero(np.linalg.norm(middles[:, :2], axis=1) > 0.008))
    bridged, holes = bridge_holes(replace(region, surface=holed), 0.03)
    assert holes == 1
    wanted = surface.closest(np.array([[0.002, 0.003, 0.04]])).positions[0]
    found = bridged.surface.closest(wanted[None])
    assert found.facets[0] >= len(holed.faces)
    assert np.linalg.norm(found.positions[0] - wanted) < 2e-5


def flat(points, height=0.0):
    return level(np.column_stack([0.01 * np.asarray(points, dtype=float), np.full(len(points), height)]))


CASES = {
    "through a waypoint of both": ([LINE, [(1, -1), (1, 0), (1, 1)]], 1),
    "through a waypoint of one": ([[(0, 0), (2, 0)], [(1, -1), (1, 0), (1, 1)]], 1),
    "a tip that touches from the left": ([LINE, [(0, 1), (1, 0), (2, 1)]], 0),
    "a tip that touches from the right": ([LINE, [(0, -1), (1, 0), (2, -1)]], 0),
    "a path that ends on another": ([LINE, [(1, 1), (1, 0)]], 0),
    "along each other, then to the other side": ([LONG, [(0, 1), (1, 0), (1.5, 0), (2, 0), (3, -1)]], 1),
    "along each other, then back": ([LONG, [(0, 1), (1, 0), (1.5, 0), (2, 0), (3, 1)]], 0),
    "there and back on the same line": ([[(0, 0), (1, 0), (2, 0), (1.3, 0), (0.4, 0)]], 0),
    "a square closed": ([SQUARE], 0),
    "one long chord over many short ones": ([[(0, 0), (90, 0)], np.linspace((33.3, -1), (33.3, 1), 999)], 1),
}


@pytest.mark.parametrize("case", CASES)
def test_paths_cross_as_often_as_one_counts_by_eye(case):
    paths, number = CASES[case]
    assert len(find_crossings([flat(path) for path in paths]).places) == number


def test_crossings_are_found_where_they_are_and_only_on_one_sheet_of_the_part():
    places = find_crossings([flat([(0, 0), (4, 2)]), flat([(0, 2), (4, 0)])]).places
    assert places == pytest.approx(np.array([[0.02, 0.01, 0.0]]), abs=1e-12)
    across = [(1, -1), (1, 1)]
    assert len(find_crossings([flat(LINE), flat(across, height=0.004)]).places) == 0
    lower = flat(across, height=-2e-4)
    assert len(find_crossings([flat(LINE), Curve(lower.positions, -lower.normals, False)]).places) == 0


def test_a_lissajous_figure_on_a_sphere_crosses_2ab_minus_a_minus_b_times():
    """In angles x = cos(a t), y = cos(b t + pi / 2b) the closed curve has 2ab - a - b double points."""
    a, b = 3, 4
    t = np.linspace(0.1, 0.1 + 2.0 * np.pi, 901)
    phase = np.pi / (2.0 * b)
    east, north = 0.6 * np.cos(a * t), 0.6 * np.cos(b * t + phase)
    normals = np.stack([np.sin(east) * np.cos(north), np.sin(north), np.cos(east) * np.cos(north)], axis=1)
    assert len(find_crossings([Curve(0.1 * normals, normals, False)]).places) == 2 * a * b - a - b


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_random_walks_cross_as_every_pair_tried_in_turn_says_in_any_frame(seed):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(120, 2)) * rng.choice([0.1, 1.0, 5.0], size=(120, 1)), axis=0)
    # Closer than a micron would be the same place.
    assume(_closest_waypoint(points) > 1e-3)
    path = flat(points)
    turned = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    moved = Curve(path.positions @ turned.T + rng.normal(size=3), path.normals @ turned.T, False)
    assert len(find_crossings([path]).places) == len(find_crossings([moved]).places) == _every_pair(points)


def _closest_waypoint(points):
    """Smallest distance from a waypoint to a segment that does not begin or end there."""
    _, gap = foot_on_chord(points[:, None] - points[:-1], np.diff(points, axis=0))
    k = np.arange(len(points) - 1)
    gap[k, k] = gap[k + 1, k] = np.inf
    return gap.min()


def _every_pair(points):
    start, way = points[:-1], np.diff(points, axis=0)
    i, j = np.triu_indices(len(start), 2)

    def turn(a, b):
        return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

    def parted(k, m):
        return turn(way[k], start[m] - start[k]) * turn(way[k], start[m] + way[m] - start[k]) < 0.0

    return int((parted(i, j) & parted(j, i)).sum())


def run_along(points, number=0):
    """A run of points half a millimetre apart on the plane z = 0."""
    curve = level(np.asarray(points))
    line = curve.points(np.linspace(0.0, curve.length, int(curve.length / 5e-4) + 2))
    return SurfaceRun(FLOOR, FLOOR.closest(line), np.full(len(line), number))


def uncrossed(*lines):
    """What is left of lines, and the number of the line each piece was a part of."""
    runs, cuts = uncross([run_along(line, number) for number, line in enumerate(lines)], STEP)
    return runs, cuts, [int(run.pass_index[0]) for run in runs]


def crossings(runs):
    return len(find_crossings([run.curve for run in runs]).places)


def eight(size):
    t = np.linspace(-0.5, 2.0 * np.pi - 0.6, 400)
    return size * np.column_stack([np.sin(t), np.sin(t) * np.cos(t)])


SHARE = np.linspace(0.0, 1.0, 400)
WAVE = np.column_stack([0.2 * SHARE, 0.012 * np.sin(30.0 * SHARE)])
FIGURES = {
    "a figure of eight": [eight(0.06)],
    "an eight smaller than the step-over": [eight(0.003)],
    "two lines that meet at four degrees": [[(-0.1, 0.0), (0.1, 0.0)], [(-0.1, -0.007), (0.1, 0.007)]],
    "a wave over a line": [WAVE, [(-0.01, 0.0), (0.21, 0.0)]],
    "a grid": [
        *[[(x, -0.05), (x, 0.05)] for x in (-0.02, 0.001, 0.02)],
        *[[(-0.05, y), (0.05, y)] for y in (-0.02, 0.0, 0.02)],
    ],
}


@pytest.mark.parametrize("figure", FIGURES)
def test_nothing_crosses_after_the_cuts_and_no_place_is_far_from_what_is_left(figure):
    before = [run_along(line) for line in FIGURES[figure]]
    assert crossings(before) > 0
    runs, cuts = uncross(before, STEP)
    assert crossings(runs) == 0
    assert len(cuts) >= crossings(before)
    left = np.concatenate([run.positions for run in runs])
    gone = cKDTree(left).query(np.concatenate([run.positions for run in before]))[0]
    assert gone.max() < 0.55 * STEP


def test_a_cut_is_a_fraction_of_a_stepover_wide_and_a_dead_end_is_dropped_only_where_others_cover_it():
    runs, cuts, lines = uncrossed([(-0.1, 0.0), (0.1, 0.0)], [(0.0, -0.05), (0.0, 0.05)])
    assert lines == [0, 1, 1]
    ends = [run.positions[[0, -1], 1] for run in runs[1:]]
    assert 0.0 <= ends[1][0] - ends[0][1] - 2.0 * 0.15 * STEP < 1e-3  # its points are 0.5 mm apart
    assert cuts == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert len(uncross(runs, STEP)[1]) == 0
    # A comb of lines a step-over apart, and one that goes over the last of them and ends on its far side.
    lines = [[(-0.05, y), (0.05, y)] for y in STEP * np.arange(-3, 4)]
    assert uncrossed(*lines, [(0.0, -0.06), (0.0, -2.5 * STEP)])[2] == list(range(8))
    assert uncrossed([(-0.05, 0.0), (0.05, 0.0)], [(0.0, -0.06), (0.0, 0.02)])[2] == [0, 1, 1]
