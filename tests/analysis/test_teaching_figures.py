"""Distances between a taught path and what was meant, on lines where they are known."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.hand_guiding.figures import distance_to_line, measure_taught
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length


def straight(height: float, last: float = 0.1, tilt: float = 0.0) -> ToolPath:
    x = np.arange(0.0, last + 1e-9, 0.001)
    positions = np.stack([x, np.zeros_like(x), np.full_like(x, height)], axis=1)
    axes = np.tile([0.0, np.sin(tilt), np.cos(tilt)], (len(x), 1))
    n = len(x)
    codes = np.full(n, PROCESS, np.int8)
    return ToolPath(positions, axes, arc_length(positions), np.zeros(n, np.int64), codes, np.zeros(n))


def test_distance_to_a_line_is_square_to_it_and_round_its_ends() -> None:
    line = straight(0.0).positions_work
    points = np.array([[0.05037, 0.003, 0.004], [0.103, 0.004, 0.0], [0.02, 0.0, 0.0]])
    np.testing.assert_allclose(distance_to_line(points, line), [0.005, 0.005, 0.0], atol=1e-12)


def test_a_path_taught_two_millimetres_high_and_too_short() -> None:
    meant, taught = straight(0.0), straight(0.002, last=0.09, tilt=0.1)
    figures = measure_taught(taught.positions_work, taught, meant)
    assert figures["taught_deviation_max_m"] == pytest.approx(0.002)
    assert figures["recorded_deviation_rms_m"] == pytest.approx(0.002)
    assert figures["taught_missed_max_m"] == pytest.approx(np.hypot(0.01, 0.002))
    assert figures["taught_axis_error_max_rad"] == pytest.approx(0.1)
