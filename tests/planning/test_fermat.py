"""Connected Fermat spirals: one stroke over any region, covered, never crossing itself."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.planning.patterns.nested import without_tails
from tests.planning.shapes import circle, level, shipped_plan

STEP = 0.008


def ring(radius, **keys):
    return level(circle(radius, **keys), closed=True)


def test_a_fermat_spiral_ends_beside_its_beginning_on_the_border():
    path = shipped_plan("freeform", "fermat").path
    stroke = path.positions_work[path.process]
    radius = np.linalg.norm(stroke[:, :2], axis=1)
    assert radius[0] == pytest.approx(0.1 - 0.5 * STEP, abs=1e-3)
    assert radius[-1] == pytest.approx(0.1 - 1.5 * STEP, abs=1e-3)
    assert 0.4 < radius.argmin() / len(radius) < 0.6


def test_a_turn_loses_a_tail_that_runs_back_on_itself():
    out = np.column_stack([np.linspace(0.02, 0.04, 40), np.full(40, 2e-4), np.zeros(40)])
    body = circle(0.02)[5:-5]
    points = np.concatenate([body, out * [1.0, -1.0, 1.0], out[::-1]])
    tailed = level(points, closed=True)
    trimmed = without_tails(tailed, 0.3 * STEP)
    assert np.linalg.norm(trimmed.positions, axis=1).max() < 0.025
    assert trimmed.length == pytest.approx(2.0 * np.pi * 0.02, rel=0.05)
    assert without_tails(ring(0.02), 0.3 * STEP).length == ring(0.02).length
