"""The loops against their closed forms: force and its low-pass, position, orientation."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.control import loops

STIFFNESS = 5000.0  # of head and pad in series [N/m]
FORCE = 20.0  # [N]
UNFILTERED = 1e9  # corner of the low-pass [Hz]


def test_ten_seconds_in_the_air_do_not_wind_the_integral_up_and_a_loaded_one_unwinds_at_the_limit():
    gains, state = loops.PiGains(0.004, 0.012, 0.05, UNFILTERED), loops.PiMemory()
    for _ in range(10_000):
        assert loops.force_pi(FORCE, 0.0, 1e9, gains, 0.001, state) == gains.limit
    assert state.integral == 0.0
    state = loops.PiMemory(20.0)
    assert loops.force_pi(FORCE, FORCE + 5.0, 1e9, gains, 0.001, state) == gains.limit
    assert state.integral == pytest.approx(20.0 - 5.0 * 0.001)


@pytest.mark.parametrize(("dt", "corner_hz"), [(1e-4, 80.0), (0.02, 1.0)])
def test_the_low_pass_answers_a_step_exactly_and_starts_at_the_first_reading(dt, corner_hz):
    first = loops.force_pi(FORCE, 18.0, 1e9, loops.PiGains(0.004, 0.0, 1.0, corner_hz), dt, loops.PiMemory())
    assert first == pytest.approx(0.004 * 2.0)
    output = 0.0
    for n in range(1, 200):
        output = loops.low_pass_step(output, 1.0, corner_hz, dt)
        assert output == pytest.approx(1.0 - math.exp(-2.0 * math.pi * corner_hz * n * dt), abs=1e-12)
    assert np.isfinite(loops.low_pass_step(0.0, 1.0, 1e9, 1.0))


def felt(stiffness: float, tool=0.02, part=0.0, state=None) -> Array:
    """Shares of the gains while tool and part come together at these speeds [m/s], to 1.2 times the force."""
    state = loops.FeltMemory() if state is None else state
    shares, force, measured, dt = [], 0.0, 0.0, 0.001
    while force < 1.2 * FORCE:
        force += stiffness * (tool + part) * dt
        measured = loops.low_pass_step(measured, force, 5.0, dt)
        shares.append(loops.felt_share(FORCE, measured, tool, 1.5 * STIFFNESS, 5.0, dt, state))
    return np.array(shares)


@pytest.mark.parametrize("times", [0.2, 1.4, 2.0, 8.0])
def test_on_stiffer_springs_the_gains_fall_to_one_and_a_half_times_the_drawn_crossover(times):
    """On springs as drawn or softer they are as set."""
    shares = felt(times * STIFFNESS, tool=0.005 if times > 1.5 else 0.02)
    assert shares[0] == 1.0
    if times > 1.5:
        assert shares[-1] * times == pytest.approx(1.5, rel=0.02)
    else:
        assert (shares == 1.0).all()


def test_a_part_that_comes_towards_a_tool_at_rest_leaves_the_least_share_and_after_landing_all():
    assert felt(STIFFNESS, tool=0.0, part=0.02)[-1] == loops.LEAST_SHARE
    state = loops.FeltMemory()
    felt(STIFFNESS, state=state)
    while not state.landed:
        loops.felt_share(FORCE, 1.01 * FORCE, 0.0, 1.5 * STIFFNESS, 5.0, 0.001, state)
    assert loops.felt_share(FORCE, 1.5 * FORCE, 0.0, 1.5 * STIFFNESS, 5.0, 0.001, state) == 1.0


def test_equations_6_and_7_add_the_pid_of_the_velocity_error():
    gains, dt = loops.VelocityGains(0.1, p=0.2, d=0.01, i=0.5), 0.001
    state, out = loops.VelocityMemory(), np.zeros(3)
    wanted, *actual = np.random.default_rng(3).normal(size=(3, 3))
    one, two = (wanted - velocity for velocity in actual)
    loops.velocity_pid(wanted, actual[0], gains, dt, state, out)
    np.testing.assert_allclose(out, wanted + 0.2 * one + 0.5 * one * dt, rtol=1e-12)
    loops.velocity_pid(wanted, actual[1], gains, dt, state, out)
    derivative = np.array([loops.low_pass_step(0.0, rate, 10.0, dt) for rate in (two - one) / dt])
    expected = wanted + 0.2 * two + 0.5 * (one + two) * dt + 0.01 * derivative
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def error_between(R_actual: np.ndarray, R_wanted: np.ndarray) -> np.ndarray:
    out = np.zeros(3)
    loops.rotation_error(np.ascontiguousarray(R_actual), np.ascontiguousarray(R_wanted), out)
    return out


def random_axes(n: int, seed: int = 0) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(n, 3))
    return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def test_small_errors_are_the_exact_rotation_vector_to_third_order_and_exact_about_an_own_axis():
    frames, axes, worst = Rotation.random(50, random_state=0).as_matrix(), random_axes(50), []
    for angle in (0.2, 0.1):
        turned = Rotation.from_rotvec(angle * axes).as_matrix() @ frames
        found = np.array([error_between(*pair) for pair in zip(frames, turned, strict=True)])
        worst.append(np.linalg.norm(found - angle * axes, axis=1).max())
    assert worst[1] < 0.1**3
    assert worst[0] / worst[1] == pytest.approx(8.0, rel=0.1)
    R = Rotation.random(random_state=4).as_matrix()
    for turn in np.outer([1e-9, 0.3, 3.1], R.T).reshape(-1, 3):
        found = error_between(R, Rotation.from_rotvec(turn).as_matrix() @ R)
        np.testing.assert_allclose(found, turn, rtol=1e-6, atol=1e-15)


def test_an_axis_turns_into_the_other_the_short_way_and_onto_its_opposite_about_a_perpendicular():
    for first, second in zip(random_axes(50), random_axes(50, seed=1), strict=True):
        spare, out, half = np.cross(first, second), np.zeros(3), np.zeros(3)
        loops.add_axis_rotation(first, second, np.zeros(3), out)
        np.testing.assert_allclose(Rotation.from_rotvec(out).apply(first), second, atol=1e-12)
        assert np.linalg.norm(out) == pytest.approx(math.acos(first @ second), abs=1e-7)
        loops.add_axis_rotation(first, -first, spare / np.linalg.norm(spare), half)
        assert np.linalg.norm(half) == pytest.approx(math.pi)
        assert abs(half @ first) < 1e-12
        np.testing.assert_allclose(Rotation.from_rotvec(half).apply(first), -first, atol=1e-12)


def test_turning_by_the_error_brings_any_two_frames_together():
    """From random frames, and from frames exactly half a turn away."""
    half_turns = [Rotation.from_rotvec(math.pi * axis).as_matrix() for axis in [*np.eye(3), *random_axes(5)]]
    for R in (*Rotation.random(20, random_state=2).as_matrix(), *half_turns):
        for _ in range(600):
            R = Rotation.from_rotvec(0.1 * error_between(R, np.eye(3))).as_matrix() @ R
        assert Rotation.from_matrix(R).magnitude() < 1e-6
