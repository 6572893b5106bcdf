"""Bends laid in a time law: they fit together exactly, and their loads are the true ones."""

import math

import numpy as np
import pytest

from polish_sim.motion.certified.connector import Peaks
from polish_sim.motion.certified.kernel import PIECES, measure_peaks, new_kernel, runs_forwards, side_of
from polish_sim.motion.certified.line import (
    Motion,
    fill_bend_kernel,
    fill_law,
    gone_at,
    law_at,
    new_law,
    time_at,
    turn_at,
)


def _law(speed=0.03, acceleration=0.2):
    law = new_law()
    durations, jerks = np.zeros(7), np.zeros(7)
    durations[:4] = 0.05, 0.02, 0.05, 0.1
    jerks[:3] = 2.0, 0.0, -3.0
    fill_law(law, Motion(0.0, speed, acceleration, 0.0), durations, jerks)
    return law


def test_a_place_is_passed_when_the_law_says():
    law = _law()
    assert law_at(law, time_at(law, 4e-3)).way == pytest.approx(4e-3, rel=1e-12)


def test_a_bend_ends_with_the_law_s_way_speed_and_acceleration():
    law = _law()
    turning = turn_at(law, 4e-3, 1.5e-3, 1e-3, 1e-3)
    end = turning.begin + turning.duration
    line, gone = law_at(law, end), gone_at(turning, end)
    assert gone.way == pytest.approx(line.way - 4e-3, rel=1e-9)
    assert gone.speed == pytest.approx(line.speed, rel=1e-12)
    assert gone.acceleration == pytest.approx(line.acceleration, rel=1e-9)


def test_a_bend_keeps_to_its_room():
    law = _law()
    turning = turn_at(law, 4e-3, 1.5e-3, 0.7e-3, 0.7e-3)
    assert 4e-3 - law_at(law, turning.begin).way <= 0.7e-3
    assert law_at(law, turning.begin + turning.duration).way - 4e-3 <= 0.7e-3


def test_a_bend_s_load_is_the_largest_of_the_tip_s_motion():
    law, angle = _law(), 0.1
    turning = turn_at(law, 4e-3, 1.5e-3, 1e-3, 1e-3)
    kernel = new_kernel()
    nearest = fill_bend_kernel(law, turning, 4e-3, kernel)
    load = measure_peaks(side_of(1.0, 1.0, math.cos(angle), Peaks(1.0, 1.0, 1.0), 1.0, False), kernel, PIECES)
    old, new = np.array([1.0, 0.0]), np.array([math.cos(angle), math.sin(angle)])
    peaks, off = np.zeros(2), 0.0
    for time in np.linspace(turning.begin, turning.begin + turning.duration, 3000)[1:-1]:
        line, gone = law_at(law, time), gone_at(turning, time)
        motion = (line.acceleration - gone.acceleration) * old + gone.acceleration * new
        off = max(off, min(gone.way, 4e-3 + gone.way - line.way))
        peaks = np.maximum(peaks, [np.hypot(*motion), np.hypot(*((line.jerk - gone.jerk) * old + gone.jerk * new))])
    assert load.acceleration == pytest.approx(peaks[0], rel=1e-3)
    assert load.jerk == pytest.approx(peaks[1], rel=1e-9)
    assert 0.95 * nearest < off <= nearest * (1.0 + 1e-9)
    assert runs_forwards(kernel)
