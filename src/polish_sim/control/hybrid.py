"""Hybrid position/force control: the loops of paper 1 composed axis by axis in the tool frame (fig. 10, 11)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.force import PiGains, force_pi
from polish_sim.control.orientation import OrientationGains, angular_pid, rotation_error
from polish_sim.control.position import PositionGains, PositionRateGains, position_pd, velocity_pd, velocity_toward
from polish_sim.control.signals import Measurement, Target

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
