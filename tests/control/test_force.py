"""The force loop and its low-pass against their closed forms."""

import cmath
import math

import numpy as np
import pytest

from polish_sim.arrays import Array
from polish_sim.control import loops

STIFFNESS = 5000.0  # of head and pad in series [N/m]
FORCE = 20.0  # [N]
UNFILTERED = 1e9  # corner of the low-pass [Hz]


def press(gains: loops.PiGains, dt: float, seconds: float, state: loops.PiMemory | None = None) -> Array:
    """Force [N] at every step of a spring pressed by a tool whose velocity is the law's rate."""
    state = loops.PiMemory() if state is None else state
    force, forces = 0.0, []
    for _ in range(round(seconds / dt)):
        rate = loops.force_pi(FORCE, force, 1e9, gains, dt, state)
        force += STIFFNESS * rate * dt
        forces.append(force)
    return np.array(forces)


def closed_form(t: Array, p: float, i: float) -> Array:
    """F(t) of F'' + k p F' + k i F = k i Fd with F(0) = 0, F'(0) = k p Fd."""
    a, b = STIFFNESS * p, STIFFNESS * i
    root = cmath.sqrt(a * a - 4.0 * b)
    r1, r2 = 0.5 * (-a + root), 0.5 * (-a - root)
    error = (r1 * np.exp(r1 * t) - r2 * np.exp(r2 * t)) / (r1 - r2)
    return FORCE * (1.0 - error.real)


@pytest.mark.parametrize(("p", "i"), [(0.004, 0.012), (0.001, 0.03), (0.002, 0.0)])
def test_a_step_of_force_follows_the_second_order_response(p, i):
    errors = []
    for dt in (2e-4, 1e-4):
        forces = press(loops.PiGains(p, i, 10.0, UNFILTERED), dt, 1.5)
        t = dt * np.arange(1, len(forces) + 1)
        errors.append(np.abs(forces - closed_form(t, p, i)).max())
    assert errors[1] < 0.002 * FORCE
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)  # first order in the step


def test_ten_seconds_in_the_air_do_not_wind_the_integral_up():
    gains, state = loops.PiGains(0.004, 0.012, 0.05, UNFILTERED), loops.PiMemory()
    for _ in range(10_000):
        assert loops.force_pi(FORCE, 0.0, 1e9, gains, 0.001, state) == gains.limit
    assert state.integral == 0.0
    np.testing.assert_array_equal(press(gains, 0.001, 1.0, state=state), press(gains, 0.001, 1.0))


def test_a_loaded_integral_unwinds_while_the_rate_is_still_at_its_limit():
    gains, state = loops.PiGains(0.004, 0.012, 0.05, UNFILTERED), loops.PiMemory(20.0)
    rate = loops.force_pi(FORCE, FORCE + 5.0, 1e9, gains, 0.001, state)
    assert rate == gains.limit
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


def felt(
    stiffness: float, tool: float = 0.02, part: float = 0.0, state: loops.FeltMemory | None = None
) -> Array:
    """Shares of the gains while tool and part come together at these speeds [m/s], to 1.2 times the force."""
    state = loops.FeltMemory() if state is None else state
    shares, force, measured, dt = [], 0.0, 0.0, 0.001
    while force < 1.2 * FORCE:
        force += stiffness * (tool + part) * dt
        measured = loops.low_pass_step(measured, force, 5.0, dt)
        shares.append(loops.felt_share(FORCE, measured, tool, 1.5 * STIFFNESS, 5.0, dt, state))
    return np.array(shares)


@pytest.mark.parametrize("times", [0.2, 1.4])
def test_on_springs_as_drawn_or_softer_the_gains_are_as_set(times):
    assert (felt(times * STIFFNESS) == 1.0).all()


@pytest.mark.parametrize("times", [2.0, 8.0])
def test_on_stiffer_springs_the_gains_fall_to_one_and_a_half_times_the_drawn_crossover(times):
    shares = felt(times * STIFFNESS, tool=0.005)
    assert shares[0] == 1.0
    assert shares[-1] * times == pytest.approx(1.5, rel=0.02)


def test_a_part_that_comes_towards_a_tool_at_rest_leaves_the_least_share():
    assert felt(STIFFNESS, tool=0.0, part=0.02)[-1] == loops.LEAST_SHARE


def test_after_landing_a_part_that_rises_is_no_stiffness():
    state = loops.FeltMemory()
    felt(STIFFNESS, state=state)
    while not state.landed:
        loops.felt_share(FORCE, 1.01 * FORCE, 0.0, 1.5 * STIFFNESS, 5.0, 0.001, state)
    assert loops.felt_share(FORCE, 1.5 * FORCE, 0.0, 1.5 * STIFFNESS, 5.0, 0.001, state) == 1.0
