"""The position and orientation loops against their equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.control.loops import (
    PositionRateGains,
    VelocityGains,
    VelocityMemory,
    add_axis_rotation,
    low_pass_step,
    position_pd,
    rotation_error,
    velocity_pid,
    velocity_toward,
)


def vectors(count: int) -> list[np.ndarray]:
    return list(np.random.default_rng(3).normal(size=(count, 3)))


def test_the_wanted_velocity_is_feed_plus_error_over_the_look_ahead() -> None:
    position, target, feed = vectors(3)
    out = np.zeros(3)
    velocity_toward(position, target, feed, 0.1, out)
    np.testing.assert_allclose(out, feed + (target - position) / 0.1, rtol=1e-15)


def test_equations_6_and_7_add_the_pid_of_the_velocity_error() -> None:
    gains, dt = VelocityGains(0.1, p=0.2, d=0.01, i=0.5), 0.001
    state, out = VelocityMemory(), np.zeros(3)
    wanted, first, second = vectors(3)
    velocity_pid(wanted, first, gains, dt, state, out)
    one = wanted - first
    np.testing.assert_allclose(out, wanted + 0.2 * one + 0.5 * one * dt, rtol=1e-12)
    velocity_pid(wanted, second, gains, dt, state, out)
    two = wanted - second
    derivative = np.array([low_pass_step(0.0, rate, 10.0, dt) for rate in (two - one) / dt])
    np.testing.assert_allclose(
        out, wanted + 0.2 * two + 0.5 * (one + two) * dt + 0.01 * derivative, rtol=1e-12
    )


def test_equation_5_is_feed_plus_p_of_the_error_plus_d_of_its_derivative() -> None:
    position, target, velocity, feed = vectors(4)
    out = np.zeros(3)
    position_pd(position, target, velocity, feed, PositionRateGains(10.0, 0.1), out)
    np.testing.assert_allclose(out, feed + 10.0 * (target - position) + 0.1 * (feed - velocity), rtol=1e-14)


def follow_ramp(p: float, dt: float, seconds: float) -> np.ndarray:
    """Errors of an ideal robot under eq. 6 that starts 10 mm behind a target moving at 50 mm/s [m], shape (n,
    3)."""
    gains, state = VelocityGains(0.1, p), VelocityMemory()
    position, velocity, feed = np.zeros(3), np.zeros(3), np.array([0.05, 0.0, -0.02])
    wanted, out, errors = np.zeros(3), np.zeros(3), []
    for n in range(round(seconds / dt)):
        target = np.array([0.01, 0.0, 0.0]) + feed * n * dt
        errors.append(target - position)
        velocity_toward(position, target, feed, gains.look_ahead, wanted)
        velocity_pid(wanted, velocity, gains, dt, state, out)
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
        state, out, wanted = VelocityMemory(), np.zeros(3), np.array([0.01, 0.0, 0.0])
        line = [np.zeros(3)] * delay
        for _ in range(400 * delay):
            velocity_pid(wanted, line[0], VelocityGains(0.1, p), 0.001, state, out)
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


def error_between(R_actual: np.ndarray, R_wanted: np.ndarray) -> np.ndarray:
    out = np.zeros(3)
    rotation_error(np.ascontiguousarray(R_actual), np.ascontiguousarray(R_wanted), out)
    return out


def random_axes(n: int, seed: int = 0) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(n, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def test_small_errors_are_the_exact_rotation_vector_to_third_order() -> None:
    frames = Rotation.random(50, random_state=0).as_matrix()
    worst = []
    for angle in (0.2, 0.1, 0.05):
        difference = [
            np.linalg.norm(error_between(R, Rotation.from_rotvec(angle * a).as_matrix() @ R) - angle * a)
            for R, a in zip(frames, random_axes(50), strict=True)
        ]
        worst.append(max(difference))
    assert worst[1] < 0.1**3
    assert worst[0] / worst[1] == pytest.approx(8.0, rel=0.1)
    assert worst[1] / worst[2] == pytest.approx(8.0, rel=0.1)


@pytest.mark.parametrize("angle", [1e-9, 0.3, 2.0, 3.1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turns_about_an_own_axis_are_exact_at_any_angle(axis: int, angle: float) -> None:
    R = Rotation.random(random_state=4).as_matrix()
    turn = angle * R[:, axis]
    np.testing.assert_allclose(
        error_between(R, Rotation.from_rotvec(turn).as_matrix() @ R), turn, rtol=1e-6, atol=1e-15
    )


def test_equal_frames_have_exactly_no_error() -> None:
    for R in Rotation.random(20, random_state=1).as_matrix():
        np.testing.assert_array_equal(error_between(R, R), 0.0)


def test_an_axis_onto_its_opposite_takes_half_a_turn_about_a_perpendicular() -> None:
    for axis in random_axes(20):
        spare = np.cross(axis, random_axes(1, seed=9)[0])
        spare /= np.linalg.norm(spare)
        out = np.zeros(3)
        add_axis_rotation(axis, -axis, spare, out)
        assert np.linalg.norm(out) == pytest.approx(math.pi)
        assert abs(out @ axis) < 1e-12
        np.testing.assert_allclose(Rotation.from_rotvec(out).apply(axis), -axis, atol=1e-12)


def test_an_axis_turns_into_the_other_the_short_way() -> None:
    for first, second in zip(random_axes(50), random_axes(50, seed=1), strict=True):
        out = np.zeros(3)
        add_axis_rotation(first, second, np.zeros(3), out)
        np.testing.assert_allclose(Rotation.from_rotvec(out).apply(first), second, atol=1e-12)
        assert np.linalg.norm(out) == pytest.approx(math.acos(first @ second), abs=1e-7)


def starts() -> list[np.ndarray]:
    """Random frames, and frames exactly half a turn away from the identity."""
    half_turns = [Rotation.from_rotvec(math.pi * axis).as_matrix() for axis in [*np.eye(3), *random_axes(5)]]
    return [*Rotation.random(30, random_state=2).as_matrix(), *half_turns]


@pytest.mark.parametrize("R", starts())
def test_turning_by_the_error_brings_any_two_frames_together(R: np.ndarray) -> None:
    dt, look_ahead = 0.01, 0.1
    for _ in range(600):
        R = Rotation.from_rotvec(dt / look_ahead * error_between(R, np.eye(3))).as_matrix() @ R
    assert Rotation.from_matrix(R).magnitude() < 1e-6


def test_the_integral_takes_a_constant_disturbance_out() -> None:
    gains, dt, disturbance = VelocityGains(0.1, p=0.2, d=0.0, i=5.0), 0.001, np.array([0.02, -0.01, 0.03])
    state, out, wanted = VelocityMemory(), np.zeros(3), np.zeros(3)
    turning = np.zeros(3)
    for _ in range(5000):
        velocity_pid(wanted, turning, gains, dt, state, out)
        turning = out + disturbance
    np.testing.assert_allclose(turning, 0.0, atol=1e-8)
