"""Tracking errors of two rules are compared on the same stretch of the path, where the reference's jerk peaks."""

from __future__ import annotations

import numpy as np
import pytest

from polish_sim.smoothing.tracking import PlayedRule, at_peaks, compare_tracking, jerk_peaks, measure_tracking

LIMITS = np.full(6, 10.0)
LENGTH = 0.1


def played(rule: str, duration: float, heights: dict[int, float], jerk: float = 30.0) -> PlayedRule:
    """Constant speed; a bump of error and jerk at the middle of the path for the joints named."""
    time = np.arange(0.0, duration, 0.001)
    place = LENGTH * time / duration
    bump = np.exp(-(((time - 0.5 * duration) / 0.01) ** 2))
    error, jerks = np.full((len(time), 6), 1e-6), np.zeros((len(time), 6))
    for joint, height in heights.items():
        error[:, joint] += height * bump
        jerks[:, joint] = jerk * bump
    return PlayedRule(rule, time, place, error, jerks)


def test_a_jerk_peak_is_found_once_and_only_where_the_limit_breaks() -> None:
    play = played("joint-acceleration", 4.0, {2: 1e-4})
    rows = jerk_peaks(play, 2, 10.0)
    np.testing.assert_allclose(play.time[rows], [2.0], atol=0.002)
    calm = played("joint-acceleration", 4.0, {2: 1e-4}, jerk=8.0)
    assert len(jerk_peaks(calm, 2, 10.0)) == 1  # none breaks it: the largest counts


def test_half_the_error_at_the_same_place_is_a_reduction_of_a_half_whatever_the_time() -> None:
    reference = played("joint-acceleration", 4.0, {1: 1e-4 - 1e-6})
    for duration in (3.0, 4.0, 6.0):
        other = played("certified", duration, {1: 5e-5 - 1e-6})
        (peak,) = [found for found in at_peaks(other, reference, LIMITS) if found.joint == 1]
        assert peak.place == pytest.approx(0.5 * LENGTH, abs=1e-4)
        assert peak.reduction == pytest.approx(0.5, abs=0.02)


def test_the_largest_reduction_names_its_joint_and_rises_are_told() -> None:
    reference = played("joint-acceleration", 4.0, {0: 1e-4, 3: 1e-4, 5: 1e-4})
    other = played("certified", 4.0, {0: 0.9e-4, 3: 0.2e-4, 5: 1.3e-4})
    figures = compare_tracking(other, reference, LIMITS)
    assert figures["jerk_peaks"] == 3
    assert figures["reduction_largest_joint"] == 4
    assert figures["reduction_largest"] == pytest.approx(0.79, abs=0.01)
    assert figures["reduction_median"] == pytest.approx(0.099, abs=0.01)
    assert figures["rise_largest"] == pytest.approx(0.297, abs=0.01)
    assert figures["peaks_reduced"] == pytest.approx(2 / 3)
    assert figures["reduction_max"][3] == pytest.approx(0.79, abs=0.01)


def test_largest_and_rms_are_of_the_whole_path() -> None:
    play = played("certified", 4.0, {4: 1e-4})
    figures = measure_tracking(play)
    assert figures["tracking_error_max_rad"][4] == pytest.approx(1.01e-4, rel=1e-3)
    assert figures["tracking_error_rms_rad"][0] == pytest.approx(1e-6)
