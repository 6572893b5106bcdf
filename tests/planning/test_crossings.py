"""Crossings of constructed paths, counted by hand: through, touching, along, over and under; then cut."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from polish_sim.planning.curve import Curve
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.planner import uncross
from polish_sim.planning.quality.crossings import find_crossings
from tests.planning.shapes import Floor, level

LINE = [(0, 0), (1, 0), (2, 0)]
LONG = [*LINE, (3, 0)]
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]


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
    "one long chord over many short ones": (
        [[(0, 0), (90, 0)], [(33.3, y) for y in np.linspace(-1, 1, 999)]],
        1,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_paths_cross_as_often_as_one_counts_by_eye(case):
    paths, number = CASES[case]
    assert len(find_crossings([flat(path) for path in paths])) == number


def test_crossings_are_found_where_they_are_and_only_on_one_sheet_of_the_part():
    places = find_crossings([flat([(0, 0), (4, 2)]), flat([(0, 2), (4, 0)])])
    assert places == pytest.approx(np.array([[0.02, 0.01, 0.0]]), abs=1e-12)
    across = [(1, -1), (1, 1)]
    assert len(find_crossings([flat(LINE), flat(across, height=0.004)])) == 0
    # Nor on both sides of a thin plate.
    lower = flat(across, height=-2e-4)
    assert len(find_crossings([flat(LINE), Curve(lower.positions, -lower.normals, False)])) == 0


def test_a_lissajous_figure_on_a_sphere_crosses_2ab_minus_a_minus_b_times():
    """In angles x = cos(a t), y = cos(b t + pi / 2b) the closed curve has 2ab - a - b double points."""
    a, b = 3, 4
    t = np.linspace(0.1, 0.1 + 2.0 * np.pi, 901)
    phase = np.pi / (2.0 * b)
    east, north = 0.6 * np.cos(a * t), 0.6 * np.cos(b * t + phase)
    normals = np.stack([np.sin(east) * np.cos(north), np.sin(north), np.cos(east) * np.cos(north)], axis=1)
    assert len(find_crossings([Curve(0.1 * normals, normals, False)])) == 2 * a * b - a - b


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
    assert len(find_crossings([path])) == len(find_crossings([moved])) == _every_pair(points)


def _closest_waypoint(points):
    """Smallest distance from a waypoint to a segment that does not begin or end there."""
    start, way = points[:-1], np.diff(points, axis=0)
    away = points[:, None] - start
    share = np.clip((away * way).sum(axis=2) / (way**2).sum(axis=1), 0.0, 1.0)
    gap = np.linalg.norm(away - share[:, :, None] * way, axis=2)
    k = np.arange(len(start))
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


STEPOVER = 0.008
FLOOR = Floor()


def run_along(points, number=0):
    """A run of points half a millimetre apart on the plane z = 0."""
    curve = level(points)
    line = curve.points(np.linspace(0.0, curve.length, int(curve.length / 5e-4) + 2))
    return SurfaceRun(FLOOR, FLOOR.closest(line), np.full(len(line), number))


def uncrossed(*lines):
    """What is left of lines, and the number of the line each piece was a part of."""
    done = uncross([run_along(np.asarray(line), number) for number, line in enumerate(lines)], STEPOVER)
    return done, [int(run.pass_index[0]) for run in done.runs]


def crossings(runs):
    return len(find_crossings([run.curve for run in runs]))


def eight(size):
    t = np.linspace(-0.5, 2.0 * np.pi - 0.6, 400)
    return size * np.column_stack([np.sin(t), np.sin(t) * np.cos(t)])


SHARE = np.linspace(0.0, 1.0, 400)
WAVE = np.column_stack([0.2 * SHARE, 0.012 * np.sin(30.0 * SHARE)])
LINE = [(-0.01, 0.0), (0.21, 0.0)]
FIGURES = {
    "a figure of eight": [eight(0.06)],
    "an eight smaller than the step-over": [eight(0.003)],
    "two lines that meet at four degrees": [[(-0.1, 0.0), (0.1, 0.0)], [(-0.1, -0.007), (0.1, 0.007)]],
    "a wave over a line": [WAVE, LINE],
    "a grid": [
        *[[(x, -0.05), (x, 0.05)] for x in (-0.02, 0.001, 0.02)],
        *[[(-0.05, y), (0.05, y)] for y in (-0.02, 0.0, 0.02)],
    ],
}


@pytest.mark.parametrize("figure", FIGURES)
def test_nothing_crosses_after_the_cuts_and_no_place_is_far_from_what_is_left(figure):
    before = [run_along(np.asarray(line)) for line in FIGURES[figure]]
    assert crossings(before) > 0
    done = uncross(before, STEPOVER)
    assert crossings(done.runs) == 0
    assert len(done.cuts) >= crossings(before)
    left = np.concatenate([run.positions for run in done.runs])
    gone = cKDTree(left).query(np.concatenate([run.positions for run in before]))[0]
    assert gone.max() < 0.55 * STEPOVER


def test_a_cut_is_a_fraction_of_a_stepover_wide_and_a_dead_end_is_dropped_only_where_others_cover_it():
    done, lines = uncrossed([(-0.1, 0.0), (0.1, 0.0)], [(0.0, -0.05), (0.0, 0.05)])
    assert lines == [0, 1, 1]
    ends = [run.positions[[0, -1], 1] for run in done.runs[1:]]
    assert ends[1][0] - ends[0][1] == pytest.approx(2.0 * 0.15 * STEPOVER, rel=1e-6)
    assert done.cuts == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    # What does not cross stays what it is.
    assert len(uncross(done.runs, STEPOVER).cuts) == 0
    # A comb of lines a step-over apart, and one that goes over the last of them and ends on its far
    # side.
    lines = [[(-0.05, y), (0.05, y)] for y in STEPOVER * np.arange(-3, 4)]
    assert uncrossed(*lines, [(0.0, -0.06), (0.0, -2.5 * STEPOVER)])[1] == list(range(8))
    assert uncrossed([(-0.05, 0.0), (0.05, 0.0)], [(0.0, -0.06), (0.0, 0.02)])[1] == [0, 1, 1]
