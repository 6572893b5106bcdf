"""The measuring stick: figures of paths whose spacing is known."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from polish_sim.planning.quality.spacing import measure_stepover
from tests.planning.shapes import level

STEP = 0.008


def archimedes(turns, count=6000):
    angle = np.linspace(2.0 * np.pi, 2.0 * np.pi * (turns + 1), count)
    radius = STEP * angle / (2.0 * np.pi)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[::-1]


def zigzag(lines, spacing, length=0.2):
    rows = []
    for k in range(lines):
        x = np.linspace(0.0, length, 200)
        rows.append(np.stack([x if k % 2 == 0 else x[::-1], np.full(200, k * spacing)], axis=1))
    return np.concatenate(rows)


def test_an_archimedean_spiral_has_the_spacing_of_its_pitch():
    """The nearest distance between turns of pitch p at radius r is p cos(p / 2 pi r), a little below p."""
    found = measure_stepover([level(archimedes(12))], STEP)
    assert found.mean_m == pytest.approx(STEP, rel=0.01)
    assert found.p5_m > 0.98 * STEP
    assert found.p95_m < 1.002 * STEP
    assert found.excluded < 0.05


def test_lines_of_uneven_spacing_show_it():
    points = zigzag(9, 0.008)
    points[:, 1] += 0.2 * np.maximum(points[:, 1] - 0.032, 0.0)
    found = measure_stepover([level(points)], STEP)
    assert found.p95_m == pytest.approx(0.0096, rel=0.01)
    assert found.p5_m == pytest.approx(0.008, rel=0.01)


def test_separate_runs_are_each_others_neighbours_and_a_single_one_has_none():
    x = np.linspace(0.0, 0.2, 300)
    runs = [level(np.stack([x, np.full(300, y)], axis=1)) for y in (0.0, 0.007, 0.014)]
    assert measure_stepover(runs, STEP).mean_m == pytest.approx(0.007, abs=1e-9)
    assert np.isnan(measure_stepover(runs[:1], STEP).mean_m)


def test_the_corners_of_a_square_spiral_are_left_out():
    corners = [
        (0, 0), (10, 0), (10, 10), (0, 10), (0, 1), (9, 1), (9, 9), (1, 9), (1, 2), (8, 2), (8, 8), (2, 8),
    ]  # fmt: skip
    points = STEP * np.concatenate([np.linspace(a, b, 300) for a, b in pairwise(corners)])
    found = measure_stepover([level(points)], STEP)
    assert found.p95_m == pytest.approx(STEP, rel=0.03)
    assert 0.05 < found.excluded < 0.4


def test_only_the_turn_around_a_spirals_end_is_left_out_not_a_path_that_ends_beside_its_beginning():
    """In along one arm, out along another between its turns: the end lies beside the beginning, like all the
    rest."""
    arm = archimedes(12)
    radius = np.linalg.norm(arm, axis=1, keepdims=True)
    inward = arm[radius[:, 0] > 3.0 * STEP]
    between = (arm * (1.0 - 0.5 * STEP / radius))[radius[:, 0] > 3.0 * STEP]
    both = measure_stepover([level(np.concatenate([inward, between[::-1]]))], 0.5 * STEP)
    alone = measure_stepover([level(arm)], STEP)
    assert both.excluded < 0.02
    assert 0.0 < alone.excluded < 0.02
    assert measure_stepover([level(zigzag(3, STEP))], STEP).excluded < 0.15
