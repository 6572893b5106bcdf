"""Crossings of constructed paths, counted by hand: through, touching, along each other, over and under."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.quality.crossings import find_crossings
from tests.planning.shapes import level

LINE = [(0, 0), (1, 0), (2, 0)]
T = np.linspace(0.05, 2.0 * np.pi + 0.03, 1001)
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)]


def flat(points, height=0.0):
    return level(np.column_stack([0.01 * np.asarray(points, dtype=float), np.full(len(points), height)]))


CASES = {
    "through a waypoint of both": ([LINE, [(1, -1), (1, 0), (1, 1)]], 1),
    "through a waypoint of one": ([[(0, 0), (2, 0)], [(1, -1), (1, 0), (1, 1)]], 1),
    "a tip that touches from the left": ([LINE, [(0, 1), (1, 0), (2, 1)]], 0),
    "a tip that touches from the right": ([LINE, [(0, -1), (1, 0), (2, -1)]], 0),
    "a path that ends on another": ([LINE, [(1, 1), (1, 0)]], 0),
    "along each other, then to the other side": ([[*LINE, (3, 0)], [(0, 1), (1, 0), (1.5, 0), (2, 0), (3, -1)]], 1),
    "along each other, then back": ([[*LINE, (3, 0)], [(0, 1), (1, 0), (1.5, 0), (2, 0), (3, 1)]], 0),
    "there and back on the same line": ([[(0, 0), (1, 0), (2, 0), (1.3, 0), (0.4, 0)]], 0),
    "a square closed": ([SQUARE], 0),
    "a square run twice": ([SQUARE + SQUARE[1:]], 0),
    "a five-pointed star": ([[(np.cos(a), np.sin(a)) for a in np.arange(6) * 0.8 * np.pi]], 5),
    "one long chord over many short ones": ([[(0, 0), (90, 0)], [(33.3, y) for y in np.linspace(-1, 1, 999)]], 1),
    "a figure of eight": ([np.stack([np.sin(2 * T), np.sin(T)], axis=1)], 1),
    "a spiral": ([(T * [np.cos(9 * T), np.sin(9 * T)]).T], 0),
    "a comb of teeth": ([[(0, 0), (10, 0)], [(x, (-1) ** x) for x in range(10)]], 9),
}


@pytest.mark.parametrize("case", CASES)
def test_paths_cross_as_often_as_one_counts_by_eye(case):
    paths, number = CASES[case]
    assert len(find_crossings([flat(path) for path in paths])) == number


def test_crossings_are_found_where_they_are():
    places = find_crossings([flat([(0, 0), (4, 2)]), flat([(0, 2), (4, 0)])])
    assert places == pytest.approx(np.array([[0.02, 0.01, 0.0]]), abs=1e-12)


def test_a_path_over_another_sheet_of_the_part_does_not_cross():
    assert len(find_crossings([flat(LINE), flat([(1, -1), (1, 1)], height=0.004)])) == 0


def test_paths_on_both_sides_of_a_thin_plate_do_not_cross():
    upper, lower = flat(LINE), flat([(1, -1), (1, 1)], height=-2e-4)
    assert len(find_crossings([upper, Curve(lower.positions, -lower.normals, False)])) == 0


@pytest.mark.parametrize(("a", "b"), [(1, 2), (2, 3), (3, 4)])
def test_a_lissajous_figure_on_a_sphere_crosses_2ab_minus_a_minus_b_times(a, b):
    """In angles x = cos(a t), y = cos(b t + pi / 2b) the closed curve has 2ab - a - b double points."""
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
