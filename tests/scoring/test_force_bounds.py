"""Bounds of force control against closed forms and against a filter that was run."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.force_theory import drift_bound, step_bound, tracking_bound
from polish_sim.experiments import default_scenario
from polish_sim.scenario_file import override
from polish_sim.scoring.force_bench import judge_rest

FORCE = default_scenario("force")
WAVES = (0.04, 0.15)


def test_without_noise_and_latency_the_step_is_the_time_optimal_move() -> None:
    perfect = override(
        FORCE, ["sensor.force_noise_n=0", "sensor.latency_s=0", "robot.command_latency_s=0", "sensor.rate_hz=10000"]
    )
    bound = step_bound(perfect, 1e-9, band=1e-9)
    assert bound.settling == pytest.approx(2.0 * math.sqrt(0.004 / 1.2), rel=0.01)  # half speeding up, half braking


def test_force_of_a_touch_grows_with_speed_and_latency() -> None:
    slow, fast = step_bound(FORCE, 0.005), step_bound(FORCE, 0.02)
    late = step_bound(override(FORCE, ["robot.command_latency_s=0.018"]), 0.02)
    assert slow.peak < fast.peak < late.peak
    assert late.reaction - fast.reaction == pytest.approx(0.012)


def test_contact_is_told_at_the_stated_separation() -> None:
    bound = step_bound(FORCE, 0.02)
    ramp = 5000.0 * 0.02 * 0.001 * np.arange(1, round(1e3 * bound.detection) + 1)
    assert math.sqrt(np.sum(ramp**2)) / 0.5 == pytest.approx(4.5, rel=0.15)


def test_quicker_feed_more_noise_and_later_readings_all_cost() -> None:
    usual = tracking_bound(FORCE, 0.03, WAVES)
    assert usual < tracking_bound(FORCE, 0.1, WAVES)
    assert usual < tracking_bound(override(FORCE, ["sensor.force_noise_n=2"]), 0.03, WAVES)
    assert usual < tracking_bound(override(FORCE, ["robot.command_latency_s=0.05"]), 0.03, WAVES)


def test_a_filter_tuned_by_hand_does_not_beat_the_bound() -> None:
    feed, h, rng = 0.03, 0.005, np.random.default_rng(0)
    bound, errors = tracking_bound(override(FORCE, ["part.displacement_m=0", "part.rotation_rad=0"]), feed, WAVES), []
    for _ in range(40):
        t = np.arange(2400) * h
        numbers = 2.0 * math.pi / rng.uniform(*WAVES, 8) * rng.uniform(-1.0, 1.0, 8)
        phases = rng.uniform(0.0, 2.0 * math.pi, 8)
        height = np.sin(feed * t[:, None] * numbers + phases).sum(axis=1) / 2.0 * (0.0003 / 4.5)
        reading = 5000.0 * height + rng.normal(0.0, 0.5 * math.sqrt(0.001 / h), len(t))
        place, rate = 0.0, 0.0
        for k in range(len(t) - 2):
            miss = reading[k] - place
            place, rate = place + h * rate + 0.06 * miss, rate + 0.3 * miss * h
            if k > 1200:
                errors.append(5000.0 * height[k + 2] - place - 2 * h * rate)
    assert bound < float(np.std(errors)) < 4.0 * bound


def test_drift_bound_is_what_a_kalman_filter_ends_with() -> None:
    walk, noise, variance = 0.002**2 * 0.001, 0.5**2, 1.0
    for _ in range(200_000):
        variance = 1.0 / (1.0 / (variance + walk) + 1.0 / noise)
    assert drift_bound(FORCE) == pytest.approx(math.sqrt(variance), rel=0.01)


def test_a_dying_swing_is_rest_and_a_lasting_one_is_not() -> None:
    t = np.arange(0.0, 4.0, 0.001)
    dying = judge_rest(20.0 + 5.0 * np.exp(-t) * np.sin(30.0 * t), 20.0, 0.001)
    lasting = judge_rest(20.0 + 5.0 * np.sin(30.0 * t), 20.0, 0.001)
    small = judge_rest(20.0 + 0.5 * np.sin(30.0 * t), 20.0, 0.001)
    assert dying.resting
    assert not lasting.stable
    assert small.stable
    assert not small.resting
    assert lasting.frequency == pytest.approx(30.0, rel=0.04)
