"""Runs that cross are cut at the crossing: constructed figures on a plane, crossings counted before and after."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from polish_sim.planning.moves.uncross import uncross
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.quality.crossings import find_crossings
from tests.planning.shapes import Floor, level

STEPOVER = 0.008
FLOOR = Floor()


def run_along(points, number=0):
    """A run of points half a millimetre apart on the plane z = 0."""
    curve = level(points)
    line = curve.at(np.linspace(0.0, curve.length, int(curve.length / 5e-4) + 2))[0]
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
    done = uncross(before, STEPOVER)
    assert crossings(done.runs) == 0
    assert len(done.cuts) >= crossings(before)
    left = np.concatenate([run.positions for run in done.runs])
    gone = cKDTree(left).query(np.concatenate([run.positions for run in before]))[0]
    assert gone.max() < 0.55 * STEPOVER


def test_runs_that_do_not_cross_stay_what_they_are():
    runs = [run_along([(0.0, y), (0.1, y)]) for y in (0.0, 0.01)]
    done = uncross(runs, STEPOVER)
    assert done.runs == runs
    assert len(done.cuts) == 0


def test_a_cut_is_a_fraction_of_a_stepover_wide():
    done, lines = uncrossed([(-0.1, 0.0), (0.1, 0.0)], [(0.0, -0.05), (0.0, 0.05)])
    assert lines == [0, 1, 1]
    ends = [run.positions[[0, -1], 1] for run in done.runs[1:]]
    assert ends[1][0] - ends[0][1] == pytest.approx(2.0 * 0.15 * STEPOVER, rel=1e-6)
    assert done.cuts == pytest.approx(np.zeros((1, 3)), abs=1e-12)


def test_a_dead_end_beyond_a_crossing_is_dropped_where_others_cover_it():
    """A comb of lines a step-over apart, and one that goes over the last of them and ends on its far side."""
    lines = [[(-0.05, y), (0.05, y)] for y in STEPOVER * np.arange(-3, 4)]
    done, left = uncrossed(*lines, [(0.0, -0.06), (0.0, -2.5 * STEPOVER)])
    assert left == list(range(8))
    assert crossings(done.runs) == 0


def test_a_short_end_beyond_a_crossing_is_kept_where_nothing_else_covers_it():
    assert uncrossed([(-0.05, 0.0), (0.05, 0.0)], [(0.0, -0.06), (0.0, 0.02)])[1] == [0, 1, 1]
