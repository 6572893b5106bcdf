"""What a pad takes off in a second at a place, against closed forms and against the removal of a run."""

import math

import numpy as np
import pytest

from polish_sim.cell.dwell import PadPoses, exposure_rates
from polish_sim.cell.removal import PressedNodes, expose_nodes
from tests.cell.test_removal import SPIN, STIFFNESS, R, level_nodes, steps

FORCE = 20.0


def pressed_at(x: float, lean: float = 0.0, force: float = FORCE) -> PadPoses:
    axis = np.array([[math.sin(lean), 0.0, math.cos(lean)]])
    return PadPoses(np.array([[x, 0.0, 0.0]]), axis, np.zeros((1, 3)), -SPIN * axis, np.array([force]))


def left_of_an_edge(spacing: float) -> PressedNodes:
    nodes = level_nodes(spacing)
    kept = nodes.positions[:, 0] < 0.0
    return PressedNodes(*(column[kept] for column in nodes))


def test_half_over_an_edge_the_pad_sinks_twice_as_deep_and_does_the_same_work_beyond_it_none():
    nodes = left_of_an_edge(0.0004)
    found = exposure_rates(nodes, pressed_at(0.0), R, STIFFNESS)
    assert found.depths[0] == pytest.approx(2.0 * FORCE / STIFFNESS, rel=0.02)
    assert (found.rates @ nodes.areas)[0] == pytest.approx(FORCE * SPIN * 2.0 / 3.0 * R, rel=5e-3)
    assert exposure_rates(nodes, pressed_at(1.1 * R), R, STIFFNESS).rates.sum() == 0.0


def test_rates_times_dwell_are_the_removal_of_a_run_at_that_pose():
    nodes, dwell, lean = level_nodes(0.001), 0.7, 0.01
    found = exposure_rates(nodes, pressed_at(0.004, lean), R, STIFFNESS)
    axis = np.array([math.sin(lean), 0.0, math.cos(lean)])
    sunk = np.array([[0.004, 0.0, 0.0]]) - found.depths[0] * axis
    run = steps(sunk, np.zeros(3), dwell)._replace(axes=axis[None], turning=-SPIN * axis[None])
    exposure = expose_nodes(nodes, run, R, STIFFNESS).exposure
    np.testing.assert_allclose(dwell * found.rates.toarray()[0], exposure, rtol=1e-9, atol=1e-6)
