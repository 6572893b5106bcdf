"""Settling, rise and averages against closed forms."""

from __future__ import annotations

import math

import numpy as np

from polish_sim.analysis.metrics import first_contact, moving_average, rise_time, settling_time

TIME = np.arange(0.0, 3.0, 1e-3)
TAU = 0.2


def test_a_first_order_response_settles_after_tau_times_the_log_of_step_over_band() -> None:
    error = -20.0 * np.exp(-TIME / TAU)
    assert abs(settling_time(TIME, error, 3.0) - TAU * math.log(20.0 / 3.0)) <= 1e-3


def test_settling_counts_from_the_last_excursion_not_the_first_entry() -> None:
    error = np.where((TIME > 1.0) & (TIME < 1.5), 5.0, 0.0)
    assert abs(settling_time(TIME, error, 3.0) - 1.5) <= 1e-3


def test_settling_is_zero_when_the_error_never_leaves_the_band() -> None:
    assert settling_time(TIME, np.full_like(TIME, 3.0), 3.0) == 0.0


def test_settling_is_undefined_when_the_error_ends_outside_or_is_not_a_number() -> None:
    assert math.isnan(settling_time(TIME, np.linspace(0.0, 10.0, len(TIME)), 3.0))
    assert math.isnan(settling_time(TIME, np.full_like(TIME, math.nan), 3.0))
    assert math.isnan(settling_time(np.empty(0), np.empty(0), 3.0))


def test_a_first_order_response_rises_in_tau_times_the_log_of_nine() -> None:
    value = 20.0 * (1.0 - np.exp(-TIME / TAU))
    assert abs(rise_time(TIME, value, 20.0) - TAU * math.log(9.0)) <= 2e-3


def test_a_response_that_stays_below_90_percent_has_no_rise_time() -> None:
    assert math.isnan(rise_time(TIME, np.full_like(TIME, 17.9), 20.0))


def test_first_contact_is_the_first_sample_above_half_a_newton() -> None:
    assert first_contact(np.array([0.0, 0.5, 0.6, 0.0])) == 2
    assert first_contact(np.array([0.0, 0.5])) is None


def test_a_sine_averaged_over_its_period_vanishes_and_over_a_window_shrinks_by_sinc() -> None:
    wave = np.sin(2 * np.pi * 20.0 * TIME)
    assert np.abs(moving_average(TIME, wave, 0.05)).max() < 1e-12
    assert abs(moving_average(TIME, wave, 0.025).max() - 2.0 / np.pi) < 2e-3


def test_the_average_of_a_signal_shorter_than_the_window_is_empty() -> None:
    assert moving_average(TIME[:20], TIME[:20], 0.05).size == 0
