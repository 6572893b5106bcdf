"""Connectors against known truths, integration and brute force."""

import math

import numpy as np
import pytest

from polish_sim.motion.certified.connector import (
    CONNECTOR_PIECES,
    Ends,
    Peaks,
    connector_time,
    fill_connector,
    least_distance,
    least_peak,
)

PAPER = Peaks(0.05, 0.5, 10.0)


def _pieces(ends, distance, limits):
    durations, jerks = np.zeros(CONNECTOR_PIECES), np.zeros(CONNECTOR_PIECES)
    fill_connector(ends, distance, limits, durations, jerks)
    return durations, jerks


def _run(ends, durations, jerks):
    """Positions, speeds and accelerations at the pieces' ends."""
    x, v, a = 0.0, ends.v0, ends.a0
    rows = [(x, v, a)]
    for t, j in zip(durations, jerks, strict=True):
        x, v, a = x + v * t + a * t * t / 2 + j * t**3 / 6, v + a * t + j * t * t / 2, a + j * t
        rows.append((x, v, a))
    return np.array(rows)


def _random_ends(rng, limits):
    def side():
        a = limits.acceleration * rng.uniform() * rng.integers(0, 2)
        return rng.uniform() ** 3 * (limits.speed - a * a / limits.jerk / 2), a

    return Ends(*side(), *side())


def test_a_short_rest_to_rest_run_takes_four_cube_roots():
    assert connector_time(Ends(0, 0, 0, 0), 5e-5, PAPER) == pytest.approx(4 * math.cbrt(5e-5 / 20), rel=1e-9)


def test_a_long_rest_to_rest_run_is_distance_over_speed_plus_both_ramps():
    assert connector_time(Ends(0, 0, 0, 0), 0.05, PAPER) == pytest.approx(1.0 + 0.1 + 0.05, rel=1e-9)


def test_pieces_lead_from_one_end_to_the_other_within_the_limits():
    rng = np.random.default_rng(1)
    for _ in range(2000):
        limits = Peaks(*(10 ** rng.uniform(-2, 1, 3)))
        limits = limits._replace(acceleration=min(limits.acceleration, math.sqrt(2 * limits.speed * limits.jerk)))
        ends = _random_ends(rng, limits)
        shortest = least_distance(ends, limits)
        distance = shortest * (1 + 10 ** rng.uniform(-16, 3)) + rng.integers(0, 2) * 10 ** rng.uniform(-9, -1)
        durations, jerks = _pieces(ends, distance, limits)
        rows = _run(ends, durations, jerks)
        assert (durations >= 0).all()
        assert rows[-1] == pytest.approx(
            (distance, ends.v1, -ends.a1), rel=1e-9, abs=1e-9 * max(distance, limits.speed)
        )
        assert rows[:, 1].max() <= limits.speed * (1 + 1e-12)
        assert rows[:, 1].min() >= -1e-12
        assert np.abs(rows[:, 2]).max() <= limits.acceleration * (1 + 1e-12)
        assert durations.sum() == pytest.approx(connector_time(ends, distance, limits), rel=1e-9)


def test_a_distance_equal_to_the_least_one_is_feasible():
    rng = np.random.default_rng(2)
    for _ in range(2000):
        ends = _random_ends(rng, PAPER)
        assert math.isfinite(connector_time(ends, least_distance(ends, PAPER), PAPER))


def test_less_than_the_least_distance_is_refused():
    ends = Ends(0.04, 0.1, 0.0, 0.0)
    assert math.isinf(connector_time(ends, 0.999 * least_distance(ends, PAPER), PAPER))


def test_time_falls_as_the_peak_rises():
    """Brute force over the peak speed: none that covers the distance is faster."""
    rng = np.random.default_rng(3)
    for _ in range(100):
        ends = _random_ends(rng, PAPER)
        distance = least_distance(ends, PAPER) + 10 ** rng.uniform(-6, -1)
        best = connector_time(ends, distance, PAPER)
        for speed in np.linspace(least_peak(ends, PAPER), PAPER.speed, 20)[1:]:
            assert connector_time(ends, distance, PAPER._replace(speed=speed)) >= best * (1 - 1e-9)
