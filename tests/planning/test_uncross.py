"""Runs that cross are cut at the crossing: constructed figures on a plane, crossings counted before and after."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.moves.uncross import uncross
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.quality.crossings import count_self_crossings
from tests.planning.shapes import Floor

STEPOVER = 0.008
FLOOR = Floor()


def run_along(points):
    """A run of points half a millimetre apart on the plane z = 0."""
    points = np.column_stack([points, np.zeros(len(points))])
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    even = np.linspace(0.0, s[-1], int(s[-1] / 5e-4) + 2)
    line = np.stack([np.interp(even, s, points[:, k]) for k in range(3)], axis=1)
    return SurfaceRun(FLOOR.closest(line), np.zeros(len(line), dtype=np.int64))


def uncrossed(*lines):
    return uncross([(run_along(np.asarray(line)), FLOOR) for line in lines], STEPOVER)


def crossings(runs):
    return count_self_crossings([Curve(run.positions, run.points.normals, False) for run in runs])


def eight(size):
    t = np.linspace(-0.5, 2.0 * np.pi - 0.6, 400)
    return size * np.column_stack([np.sin(t), np.sin(t) * np.cos(t)])


T = np.linspace(0.0, 1.0, 400)
WAVE = np.column_stack([0.2 * T, 0.012 * np.sin(30.0 * T)])
LINE = [(-0.01, 0.0), (0.21, 0.0)]
FIGURES = {
    "a figure of eight": [eight(0.06)],
    "an eight smaller than the step-over": [eight(0.003)],
    "two lines": [[(-0.1, 0.0), (0.1, 0.0)], [(0.0, -0.1), (0.013, 0.1)]],
    "two lines that meet at four degrees": [[(-0.1, 0.0), (0.1, 0.0)], [(-0.1, -0.007), (0.1, 0.007)]],
    "a wave over a line": [WAVE, LINE],
    "a five-pointed star": [[(0.1 * np.cos(a), 0.1 * np.sin(a)) for a in 0.1 + np.arange(6) * 0.8 * np.pi]],
    "a grid": [
        *[[(x, -0.05), (x, 0.05)] for x in (-0.02, 0.001, 0.02)],
        *[[(-0.05, y), (0.05, y)] for y in (-0.02, 0.0, 0.02)],
    ],
}


@pytest.mark.parametrize("figure", FIGURES)
def test_nothing_crosses_after_the_cuts_and_no_place_is_far_from_what_is_left(figure):
    before = [run_along(np.asarray(line)) for line in FIGURES[figure]]
    assert crossings(before) > 0
    done = uncross([(run, FLOOR) for run in before], STEPOVER)
    assert crossings([item.run for item in done.runs]) == 0
    assert len(done.cuts) >= crossings(before)
    left = np.concatenate([item.run.positions for item in done.runs])
    gone = cKDTree(left).query(np.concatenate([run.positions for run in before]))[0]
    assert gone.max() < 0.55 * STEPOVER


def test_runs_that_do_not_cross_stay_what_they_are():
    runs = [run_along([(0.0, y), (0.1, y)]) for y in (0.0, 0.01)]
    done = uncross([(run, FLOOR) for run in runs], STEPOVER)
    assert [item.run for item in done.runs] == runs
    assert len(done.cuts) == 0


def test_a_cut_is_a_fraction_of_a_stepover_wide():
    done = uncrossed([(-0.1, 0.0), (0.1, 0.0)], [(0.0, -0.05), (0.0, 0.05)])
    assert sorted(item.origin for item in done.runs) == [0, 1, 1]
    ends = [item.run.positions[[0, -1], 1] for item in done.runs if item.origin == 1]
    assert ends[1][0] - ends[0][1] == pytest.approx(2.0 * 0.15 * STEPOVER, rel=1e-6)
    assert done.cuts == pytest.approx(np.zeros((1, 3)), abs=1e-12)


def test_a_dead_end_beyond_a_crossing_is_dropped_where_others_cover_it():
    """A comb of lines a step-over apart, and one that goes over the last of them and ends on its far side."""
    lines = [[(-0.05, y), (0.05, y)] for y in STEPOVER * np.arange(-3, 4)]
    done = uncrossed(*lines, [(0.0, -0.06), (0.0, -2.5 * STEPOVER)])
    assert [item.origin for item in done.runs] == list(range(8))
    assert crossings([item.run for item in done.runs]) == 0


def test_a_short_end_beyond_a_crossing_is_kept_where_nothing_else_covers_it():
    done = uncrossed([(-0.05, 0.0), (0.05, 0.0)], [(0.0, -0.06), (0.0, 0.02)])
    assert sorted(item.origin for item in done.runs) == [0, 1, 1]
