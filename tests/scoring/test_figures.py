"""Figures of a scorecard row on runs whose force is a formula."""

import math

import numpy as np
import pytest

from polish_sim.scoring.figures import DEFINITIONS, measure_score, oscillation
from tests.analysis.synthetic import DT, force_trace, trace_of


def held(force, before_s=1.0):
    """In the air, then this force, the first 0.35 s of it touch-down."""
    air = np.zeros(round(before_s / DT))
    landing = round(0.35 / DT)
    phase = np.concatenate([0 * air, np.ones(landing), np.full(len(force) - landing, 2.0)]).astype(np.int8)
    return trace_of(phase, normal_force_n=np.concatenate([air, force]))


def scored(trace, moving=False, whole=True, wanted=20.0):
    return measure_score(trace, np.full(len(trace.time_s), wanted), moving, whole)


def seconds(length):
    return np.arange(0.0, length, DT)


def test_a_first_order_rise_a_steady_offset_and_a_sine_have_their_closed_figures():
    row = scored(force_trace(tau=0.1))
    contact = -0.1 * math.log(1.0 - 0.5 / 20.0)  # above 0.5 N
    assert row["settling_1n_s"] == pytest.approx(0.1 * math.log(20.0) - contact, abs=2 * DT)
    assert row["overshoot_n"] == 0.0
    assert row["peak_force_n"] == pytest.approx(20.0, abs=1e-6)
    assert row["max_error_n"] == pytest.approx(20.0 * math.exp(-5.0) * math.exp(-contact / 0.1), rel=0.02)
    assert row["stable"]
    assert set(row) <= set(DEFINITIONS)
    stopped = scored(force_trace(tau=0.1), whole=False)
    assert (stopped["stable"], stopped["settling_1n_s"]) == (False, None)
    row = scored(held(np.full(4000, 23.0)))
    for figure in ("rms_error_n", "p95_error_n", "max_error_n", "mean_error_n", "overshoot_n"):
        assert row[figure] == pytest.approx(3.0)
    assert row["std_n"] == pytest.approx(0.0, abs=1e-9)
    assert row["settling_1n_s"] is None
    assert row["stable"]
    t = seconds(4.5)
    row = scored(held(20.0 + 1.5 * np.sin(2.0 * np.pi * 2.0 * t)))
    assert row["rms_error_n"] == pytest.approx(1.5 / math.sqrt(2.0), rel=1e-3)
    assert row["p95_error_n"] == pytest.approx(1.5 * math.sin(0.95 * math.pi / 2.0), rel=1e-2)
    assert row["max_error_n"] == pytest.approx(1.5, rel=1e-4)


def test_contact_lost_counts_from_the_end_of_touch_down_and_without_contact_nothing_is_defined():
    bounce = np.full(4000, 20.0)
    bounce[100:200] = 0.0
    assert scored(held(bounce))["contact_lost_s"] == 0.0
    assert scored(held(bounce))["stable"]
    bounce[2000:2050] = 0.4
    row = scored(held(bounce))
    assert row["contact_lost_s"] == pytest.approx(0.05)
    assert not row["stable"]
    row = scored(held(np.zeros(1000)))
    assert row.pop("stable") is False
    assert set(row.values()) == {None}
    assert all(map(math.isnan, oscillation(seconds(0.2), seconds(0.2))))  # too short to judge


def test_a_limit_cycle_and_a_growing_oscillation_are_not_stable_but_following_a_slow_part_is():
    t = seconds(4.5)
    for hertz in (5.0, 40.0):
        wave = np.sin(2.0 * np.pi * hertz * t)
        small, large = (scored(held(20.0 + size * wave)) for size in (1.5, 3.0))
        assert large["oscillation_n"] == pytest.approx(3.0, rel=0.2)  # a moving mean takes some of 5 Hz
        assert (small["stable"], large["stable"]) == (True, False)
        assert scored(held(50.0 + 3.0 * wave), wanted=50.0)["stable"]
    wave = np.sin(2.0 * np.pi * 8.0 * t)
    growing = scored(held(20.0 + 0.02 * np.exp(1.0 * t) * wave))
    assert growing["oscillation_n"] < 2.0
    assert not growing["stable"]
    assert scored(held(20.0 + 1.8 * np.exp(-1.0 * t) * wave))["stable"]
    t = seconds(6.0)
    row = scored(held(20.0 + 4.0 * np.sin(2.0 * np.pi * 0.5 * t)))
    assert row["oscillation_n"] < 0.5
    assert row["stable"]


def test_the_steady_window_begins_half_a_second_after_contact_and_along_a_path_with_the_feed():
    force = np.full(4000, 20.0)
    force[300:499] = 28.0
    row = scored(held(force))
    assert (row["max_error_n"], row["overshoot_n"]) == (0.0, 8.0)
    force[501] = 25.0
    assert scored(held(force))["max_error_n"] == 5.0
    force = np.full(4000, 20.0)
    force[100], force[1000] = 26.0, 24.0
    row = scored(held(force), moving=True)
    assert (row["overshoot_n"], row["max_error_n"], row["peak_force_n"]) == (6.0, 4.0, 26.0)
    assert row["settling_1n_s"] is None
    trace = held(np.full(4000, 20.0))
    wanted = np.full(len(trace.time_s), 20.0)
    wanted[-500:] = 18.0  # at that place
    assert measure_score(trace, wanted, True, True)["max_error_n"] == 2.0
