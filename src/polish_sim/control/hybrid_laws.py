"""The paper's controllers and position control alone: each one compiled law composed of the loops (layer 7)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numba import carray, cfunc, njit
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.compiled import LAW_SIGNATURE, CompiledController
from polish_sim.control.force import PiGains
from polish_sim.control.hybrid import (
    STATE_SIZE,
    HybridState,
    hybrid_state_of,
    level_about_y,
    position_by_error,
    position_by_velocity,
    press_along_z,
    turn_to_target,
)
from polish_sim.control.orientation import OrientationGains
from polish_sim.control.position import PositionGains, PositionRateGains
from polish_sim.control.signals import (
    ANSWER_SIZE,
    MEASUREMENT_SIZE,
    TARGET_SIZE,
    Measurement,
    Target,
    measurement_of,
    target_of,
)

Array = NDArray[np.float64]

GAINS_SIZE = 16
CONTEXT_SIZE = GAINS_SIZE + STATE_SIZE


@njit(cache=True)
def step_hybrid_pi(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``hybrid-pi``: eq. 6 and 7 with force along tool z and moment about tool y in contact."""
    g, dt = context, m.clock[1]
    state = hybrid_state_of(context[GAINS_SIZE:])
    position_by_velocity(m, t, position_gains(g), dt, state, twist)
    _turn_and_press(g, dt, m, t, state, twist)


@njit(cache=True)
def step_hybrid_pi_position(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``hybrid-pi-position``: as ``hybrid-pi`` with the position loop of eq. 5."""
    g, dt = context, m.clock[1]
    state = hybrid_state_of(context[GAINS_SIZE:])
    position_by_error(m, t, PositionRateGains(g[3], g[4]), twist)
    _turn_and_press(g, dt, m, t, state, twist)


@njit(cache=True)
def step_position(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Controller ``position``: eq. 6 and 7 on all six axes, no force control."""
    g, dt = context, m.clock[1]
    state = hybrid_state_of(context[GAINS_SIZE:])
    position_by_velocity(m, t, position_gains(g), dt, state, twist)
    turn_to_target(m, t, orientation_gains(g), dt, np.zeros(3), state, twist)


@njit(cache=True)
def _turn_and_press(g, dt, m, t, state, twist):  # type: ignore[no-untyped-def]
    turn_and_level(g, dt, m, t, state, twist)
    if t.contact[0] > 0.0:
        press_along_z(m, t, PiGains(g[8], g[9], g[10], g[15]), dt, state, twist)
    else:
        for i in range(3):
            state.force[i] = 0.0


@njit(cache=True)
def turn_and_level(g: Array, dt: float, m: Measurement, t: Target, state: HybridState, twist: Array) -> None:
    """Angular part of the twist: eq. 7, and in contact the moment loop about tool y.

    Args:
        g: Gains, see ``gains_of``, shape (16,).
        dt: Control cycle [s].
        m: Measurement.
        t: Target.
        state: Memory.
        twist: The twist; its angular part is written.
    """
    turning = orientation_gains(g)
    if t.contact[0] == 0.0:
        for i in range(3):
            state.moment[i] = 0.0
        turn_to_target(m, t, turning, dt, np.zeros(3), state, twist)
        return
    turn_to_target(m, t, turning, dt, m.rotation[:, 1].copy(), state, twist)
    level_about_y(m, t, PiGains(g[11], g[12], g[13], g[15]), g[14], g[0], dt, state, twist)


@njit(cache=True)
def position_gains(g: Array) -> PositionGains:
    """Gains of eq. 6 among a law's gains, see ``gains_of``, shape (16,)."""
    return PositionGains(g[0], g[1], g[2])


@njit(cache=True)
def orientation_gains(g: Array) -> OrientationGains:
    """Gains of eq. 7 among a law's gains, see ``gains_of``, shape (16,)."""
    return OrientationGains(g[0], g[5], g[6], g[7])


@cache
def hybrid_pi_law() -> Any:
    """Compiled entry of ``hybrid-pi``, made at first use."""

    @cfunc(LAW_SIGNATURE, cache=True)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_hybrid_pi(carray(context, CONTEXT_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


@cache
def hybrid_pi_position_law() -> Any:
    """Compiled entry of ``hybrid-pi-position``, made at first use."""

    @cfunc(LAW_SIGNATURE, cache=True)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_hybrid_pi_position(carray(context, CONTEXT_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


@cache
def position_law() -> Any:
    """Compiled entry of ``position``, made at first use."""

    @cfunc(LAW_SIGNATURE, cache=True)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_position(carray(context, CONTEXT_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


def gains_of(config: ControllerConfig) -> Array:
    """Gains in the order the compiled laws read them, shape (16,)."""
    return np.array(
        [
            config.look_ahead_s,
            config.position_p,
            config.position_d_s,
            config.position_rate_p,
            config.position_rate_d,
            config.orientation_p,
            config.orientation_i_hz,
            config.orientation_d_s,
            config.force_p_m_sn,
            config.force_i_m_s2n,
            config.force_limit_m_s,
            config.moment_p_rad_snm,
            config.moment_i_rad_s2nm,
            config.moment_limit_rad_s,
            config.moment_tilt_limit_rad,
            config.force_filter_hz,
        ]
    )


def hybrid_pi(config: ControllerConfig) -> CompiledController:
    """Paper 1's controller for a speed-commanded robot (eq. 6, 7; fig. 10, 11)."""
    return CompiledController(gains_of(config), STATE_SIZE, step_hybrid_pi, hybrid_pi_law)


def hybrid_pi_position(config: ControllerConfig) -> CompiledController:
    """The sister of hybrid-pi, with the position loop of eq. 5."""
    return CompiledController(gains_of(config), STATE_SIZE, step_hybrid_pi_position, hybrid_pi_position_law)


def position(config: ControllerConfig) -> CompiledController:
    """Position control alone: what a pressed-in path gives without a force loop."""
    return CompiledController(gains_of(config), STATE_SIZE, step_position, position_law)
