"""The position and orientation loops against their equations."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.control import loops


def test_equations_6_and_7_add_the_pid_of_the_velocity_error():
    gains, dt = loops.VelocityGains(0.1, p=0.2, d=0.01, i=0.5), 0.001
    state, out = loops.VelocityMemory(), np.zeros(3)
    wanted, first, second = np.random.default_rng(3).normal(size=(3, 3))
    loops.velocity_pid(wanted, first, gains, dt, state, out)
    one = wanted - first
    np.testing.assert_allclose(out, wanted + 0.2 * one + 0.5 * one * dt, rtol=1e-12)
    loops.velocity_pid(wanted, second, gains, dt, state, out)
    two = wanted - second
    derivative = np.array([loops.low_pass_step(0.0, rate, 10.0, dt) for rate in (two - one) / dt])
    np.testing.assert_allclose(
        out, wanted + 0.2 * two + 0.5 * (one + two) * dt + 0.01 * derivative, rtol=1e-12
    )


def error_between(R_actual: np.ndarray, R_wanted: np.ndarray) -> np.ndarray:
    out = np.zeros(3)
    loops.rotation_error(np.ascontiguousarray(R_actual), np.ascontiguousarray(R_wanted), out)
    return out


def random_axes(n: int, seed: int = 0) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(n, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def test_small_errors_are_the_exact_rotation_vector_to_third_order():
    frames = Rotation.random(50, random_state=0).as_matrix()
    worst = []
    for angle in (0.2, 0.1):
        difference = [
            np.linalg.norm(error_between(R, Rotation.from_rotvec(angle * a).as_matrix() @ R) - angle * a)
            for R, a in zip(frames, random_axes(50), strict=True)
        ]
        worst.append(max(difference))
    assert worst[1] < 0.1**3
    assert worst[0] / worst[1] == pytest.approx(8.0, rel=0.1)


@pytest.mark.parametrize("angle", [1e-9, 0.3, 3.1])
def test_turns_about_an_own_axis_are_exact_at_any_angle(angle):
    R = Rotation.random(random_state=4).as_matrix()
    for turn in angle * R.T:
        found = error_between(R, Rotation.from_rotvec(turn).as_matrix() @ R)
        np.testing.assert_allclose(found, turn, rtol=1e-6, atol=1e-15)


def test_an_axis_onto_its_opposite_takes_half_a_turn_about_a_perpendicular():
    for axis in random_axes(20):
        spare = np.cross(axis, random_axes(1, seed=9)[0])
        spare /= np.linalg.norm(spare)
        out = np.zeros(3)
        loops.add_axis_rotation(axis, -axis, spare, out)
        assert np.linalg.norm(out) == pytest.approx(math.pi)
        assert abs(out @ axis) < 1e-12
        np.testing.assert_allclose(Rotation.from_rotvec(out).apply(axis), -axis, atol=1e-12)


def test_an_axis_turns_into_the_other_the_short_way():
    for first, second in zip(random_axes(50), random_axes(50, seed=1), strict=True):
        out = np.zeros(3)
        loops.add_axis_rotation(first, second, np.zeros(3), out)
        np.testing.assert_allclose(Rotation.from_rotvec(out).apply(first), second, atol=1e-12)
        assert np.linalg.norm(out) == pytest.approx(math.acos(first @ second), abs=1e-7)


def test_turning_by_the_error_brings_any_two_frames_together():
    """From random frames, and from frames exactly half a turn away."""
    half_turns = [Rotation.from_rotvec(math.pi * axis).as_matrix() for axis in [*np.eye(3), *random_axes(5)]]
    for R in (*Rotation.random(20, random_state=2).as_matrix(), *half_turns):
        for _ in range(600):
            R = Rotation.from_rotvec(0.1 * error_between(R, np.eye(3))).as_matrix() @ R
        assert Rotation.from_matrix(R).magnitude() < 1e-6
