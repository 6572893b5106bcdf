"""Hybrid position/force control: the loops of paper 1 composed axis by axis in the tool frame (fig. 10, 11)."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import carray
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.loops import (
    OrientationGains,
    PiGains,
    PositionGains,
    PositionRateGains,
    angular_pid,
    force_pi,
    position_pd,
    rotation_error,
    velocity_pd,
    velocity_toward,
)
from polish_sim.control.signals import (
    ANSWER_SIZE,
    LAW_SIGNATURE,
    MEASUREMENT_SIZE,
    TARGET_SIZE,
    CompiledController,
    Measurement,
    Target,
    measurement_of,
    target_of,
)
from polish_sim.kernel_cache import cfunc, njit

Array = NDArray[np.float64]

STATE_SIZE = 32


class HybridState(NamedTuple):
    """Memory of the loops, all zero after a reset."""

    position: Array
    orientation: Array
    force: Array
    moment: Array
    wanted: Array
    error: Array


@njit(cache=True)
def hybrid_state_of(flat: Array) -> HybridState:
    """Named views of a flat state, shape (32,)."""
    return HybridState(flat[0:7], flat[7:17], flat[17:20], flat[20:23], flat[23:26], flat[26:29])


@njit(cache=True)
def position_by_velocity(
    m: Measurement, t: Target, gains: PositionGains, dt: float, state: HybridState, out: Array
) -> None:
    """Linear part of the twist by eq. 6: PD on the velocity error, position through the look-ahead."""
    velocity_toward(m.position, t.position, t.twist[0:3], gains.look_ahead, state.wanted)
    velocity_pd(state.wanted, m.twist[0:3], gains, dt, state.position, out[0:3])


@njit(cache=True)
def position_by_error(m: Measurement, t: Target, gains: PositionRateGains, out: Array) -> None:
    """Linear part of the twist by eq. 5: PD on the position error."""
    position_pd(m.position, t.position, m.twist[0:3], t.twist[0:3], gains, out[0:3])


@njit(cache=True)
def turn_to_target(
    m: Measurement, t: Target, gains: OrientationGains, dt: float, moment_axis: Array, state: HybridState, out: Array
) -> None:
    """Angular part of the twist by eq. 7; an axis left to the moment loop takes no part in it.

    Args:
        m: Measurement.
        t: Target.
        gains: PID gains.
        dt: Control cycle [s].
        moment_axis: Axis not controlled here, unit vector or zero, shape (3,).
        state: Memory; ``state.error`` is left holding the rotation error [rad].
        out: The twist, shape (6,).
    """
    rotation_error(m.rotation, t.rotation, state.error)
    surplus = 0.0
    for i in range(3):
        state.wanted[i] = t.twist[3 + i] + state.error[i] / gains.look_ahead
        surplus += moment_axis[i] * (state.wanted[i] - m.twist[3 + i])
    for i in range(3):
        state.wanted[i] -= surplus * moment_axis[i]
    angular_pid(state.wanted, m.twist[3:6], gains, dt, state.orientation, out[3:6])


@njit(cache=True)
def press_along_z(m: Measurement, t: Target, gains: PiGains, dt: float, state: HybridState, out: Array) -> None:
    """Replace the twist's part along tool z by the force loop: v' = v_xy + v_Fz z (fig. 10)."""
    replace_along_z(m, force_pi(t.force[0], m.wrench[2], gains, dt, state.force), out)


@njit(cache=True)
def replace_along_z(m: Measurement, rate: float, out: Array) -> None:
    """Give the twist's part along tool z a value of its own [m/s]."""
    z = m.rotation[:, 2]
    along = z[0] * out[0] + z[1] * out[1] + z[2] * out[2]
    for i in range(3):
        out[i] += (rate - along) * z[i]


@njit(cache=True)
def level_about_y(
    m: Measurement,
    t: Target,
    gains: PiGains,
    tilt_limit: float,
    look_ahead: float,
    dt: float,
    state: HybridState,
    out: Array,
) -> None:
    """Replace the twist's part about tool y by the moment loop: f' = f_xz + f_Fy y (fig. 11).

    The loop works about the planned turning rate: from the moment alone the tool would lag behind every bend of the
    part. The tilt away from the planned axis stays within ``tilt_limit`` [rad]: at the border of a part the pad's
    moment would otherwise roll the tool over the edge.
    """
    y = m.rotation[:, 1]
    rate = force_pi(t.force[1], m.wrench[4], gains, dt, state.moment)
    tilt = along = planned = 0.0
    for i in range(3):
        tilt += y[i] * state.error[i]
        along += y[i] * out[3 + i]
        planned += y[i] * t.twist[3 + i]
    lowest = planned + (tilt - tilt_limit) / look_ahead
    highest = planned + (tilt + tilt_limit) / look_ahead
    rate = min(max(planned + rate, lowest), highest)
    for i in range(3):
        out[3 + i] += (rate - along) * y[i]


# The paper's controllers and position control alone: each one compiled law composed of the loops.

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

    @cfunc(LAW_SIGNATURE)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_hybrid_pi(carray(context, CONTEXT_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


@cache
def hybrid_pi_position_law() -> Any:
    """Compiled entry of ``hybrid-pi-position``, made at first use."""

    @cfunc(LAW_SIGNATURE)
    def law(context, measurement, target, twist):  # type: ignore[no-untyped-def]
        m = measurement_of(carray(measurement, MEASUREMENT_SIZE))
        t = target_of(carray(target, TARGET_SIZE))
        step_hybrid_pi_position(carray(context, CONTEXT_SIZE), m, t, carray(twist, ANSWER_SIZE))

    return law


@cache
def position_law() -> Any:
    """Compiled entry of ``position``, made at first use."""

    @cfunc(LAW_SIGNATURE)
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
