"""The position laws of eq. 5 and 6 as printed, and against the closed forms of an ideal velocity-commanded robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from polish_sim.control.loops import (
    PositionGains,
    PositionMemory,
    PositionRateGains,
    low_pass_step,
    position_pd,
    velocity_pd,
    velocity_toward,
)

RNG_SEED = 3


def vectors(count: int) -> list[np.ndarray]:
    return list(np.random.default_rng(RNG_SEED).normal(size=(count, 3)))


def test_the_wanted_velocity_is_feed_plus_error_over_the_look_ahead() -> None:
    position, target, feed = vectors(3)
    out = np.zeros(3)
    velocity_toward(position, target, feed, 0.1, out)
    np.testing.assert_allclose(out, feed + (target - position) / 0.1, rtol=1e-15)


def test_equation_6_adds_p_and_d_of_the_velocity_error() -> None:
    gains, dt = PositionGains(0.1, 0.3, 0.02), 0.001
    state, out = PositionMemory(), np.zeros(3)
    wanted, first, second = vectors(3)
    velocity_pd(wanted, first, gains, dt, state, out)
    np.testing.assert_allclose(out, wanted + 0.3 * (wanted - first), rtol=1e-14)
    velocity_pd(wanted, second, gains, dt, state, out)
    derivative = [low_pass_step(0.0, rate, 10.0, dt) for rate in (first - second) / dt]
    np.testing.assert_allclose(out, wanted + 0.3 * (wanted - second) + 0.02 * np.array(derivative), rtol=1e-12)


def test_equation_5_is_feed_plus_p_of_the_error_plus_d_of_its_derivative() -> None:
    position, target, velocity, feed = vectors(4)
    out = np.zeros(3)
    position_pd(position, target, velocity, feed, PositionRateGains(10.0, 0.1), out)
    np.testing.assert_allclose(out, feed + 10.0 * (target - position) + 0.1 * (feed - velocity), rtol=1e-14)


def follow_ramp(p: float, dt: float, seconds: float) -> np.ndarray:
    """Errors of an ideal robot under eq. 6 that starts 10 mm behind a target moving at 50 mm/s [m], shape (n, 3)."""
    gains, state = PositionGains(0.1, p, 0.0), PositionMemory()
    position, velocity, feed = np.zeros(3), np.zeros(3), np.array([0.05, 0.0, -0.02])
    wanted, out, errors = np.zeros(3), np.zeros(3), []
    for n in range(round(seconds / dt)):
        target = np.array([0.01, 0.0, 0.0]) + feed * n * dt
        errors.append(target - position)
        velocity_toward(position, target, feed, gains.look_ahead, wanted)
        velocity_pd(wanted, velocity, gains, dt, state, out)
        velocity = out.copy()
        position = position + velocity * dt
    return np.array(errors)


def test_without_p_an_error_dies_as_exp_of_minus_t_over_the_look_ahead() -> None:
    dt = 1e-4
    errors = follow_ramp(0.0, dt, 0.5)
    expected = 0.01 * np.exp(-dt * np.arange(len(errors)) / 0.1)
    np.testing.assert_allclose(errors[:, 0], expected, atol=2e-3 * 0.01)
    np.testing.assert_allclose(errors[:, 1:], 0.0, atol=1e-15)


def test_p_on_the_velocity_error_leaves_no_error_on_a_ramp() -> None:
    errors = follow_ramp(0.2, 0.001, 2.0)
    assert np.abs(errors[-1]).max() < 1e-9


@pytest.mark.parametrize("delay", [1, 3, 8, 40])
def test_p_below_one_is_safe_at_any_delay_and_above_one_it_is_not(delay: int) -> None:
    def response(p: float) -> float:
        state, out, wanted = PositionMemory(), np.zeros(3), np.array([0.01, 0.0, 0.0])
        line = [np.zeros(3)] * delay
        for _ in range(400 * delay):
            velocity_pd(wanted, line[0], PositionGains(0.1, p, 0.0), 0.001, state, out)
            line = [*line[1:], out.copy()]
        return float(abs(line[-1][0] - wanted[0]))

    assert response(0.95) < 1e-9
    assert response(1.05) > 1.0


def test_equation_5_takes_an_error_back_at_its_rate_over_one_plus_d() -> None:
    gains, dt = PositionRateGains(10.0, 0.25), 1e-4
    position, velocity, out = np.zeros(3), np.zeros(3), np.zeros(3)
    for _ in range(2000):
        position_pd(position, np.array([0.01, 0.0, 0.0]), velocity, np.zeros(3), gains, out)
        velocity = out.copy()
        position = position + velocity * dt
    assert 0.01 - position[0] == pytest.approx(0.01 * math.exp(-0.2 * 10.0 / 1.25), rel=2e-3)
