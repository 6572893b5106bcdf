"""Chords in place of way points: distances with known truths."""

import math

import numpy as np
import pytest

from polish_sim.motion.certified.merge import chord_deviation, empty_run


def _run(tips, tilts):
    run = empty_run()
    for i, (tip, tilt) in enumerate(zip(tips, tilts, strict=True)):
        run.tips[i] = tip
        c, s = math.cos(tilt), math.sin(tilt)
        run.rotations[i] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    return run


def test_an_arc_lies_its_sagitta_off_the_chord():
    angles = np.linspace(-0.02, 0.02, 11)
    run = _run(0.05 * np.column_stack([np.sin(angles), np.cos(angles), 0 * angles]), np.zeros(11))
    assert chord_deviation(run, 10)[0] == pytest.approx(0.05 * (1 - math.cos(0.02)), rel=1e-9)


def test_an_axis_that_turns_evenly_does_not_deviate():
    along = np.linspace(0.0, 1.0, 6)
    run = _run(np.column_stack([along, 0 * along, 0 * along]) * 1e-3, 0.3 * along)
    assert chord_deviation(run, 5)[1] < 1e-12


def test_an_axis_ahead_of_the_tip_deviates_by_its_lead():
    run = _run([[0, 0, 0], [0.5e-3, 0, 0], [1e-3, 0, 0]], [0.0, 0.06, 0.1])
    assert chord_deviation(run, 2)[1] == pytest.approx(0.01, rel=5e-3)


def test_a_way_point_behind_the_one_before_is_no_part_of_a_chord():
    run = _run([[0, 0, 0], [0.6e-3, 0, 0], [0.5e-3, 0, 0], [1e-3, 0, 0]], np.zeros(4))
    assert math.isinf(chord_deviation(run, 3)[0])
