"""Position control by tool velocity (paper 1, eq. 5 and 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.filters import low_pass_step

Array = NDArray[np.float64]


class PositionGains(NamedTuple):
    """Gains of the velocity-error law, eq. 6; position enters through the look-ahead."""

    look_ahead: float
    """T_a [s]."""
    p: float
    """kpp [-]; below 1 it is stable at any delay."""
    d: float
    """kpd [s], on a low-passed acceleration."""


class PositionRateGains(NamedTuple):
    """Gains of the position-error law, eq. 5."""

    p: float
    """kpp [1/s]."""
    d: float
    """kpd [-]."""


@njit(cache=True)
def velocity_toward(position: Array, target: Array, feed: Array, look_ahead: float, out: Array) -> None:
    """Desired velocity v01 = feed + (Xd - Xe) / T_a [m/s] (paper 1, eq. 6; the reading of ``v01`` is ours)."""
    for i in range(3):
        out[i] = feed[i] + (target[i] - position[i]) / look_ahead


@njit(cache=True)
def velocity_pd(wanted: Array, actual: Array, gains: PositionGains, dt: float, state: Array, out: Array) -> None:
    """Command v = v01 + kpp v_err + kpd d/dt v_err (paper 1, eq. 6).

    Args:
        wanted: v01 [m/s], shape (3,).
        actual: Measured tool velocity [m/s], shape (3,).
        gains: The gains.
        dt: Control cycle [s].
        state: Last velocity error, its low-passed derivative and a started flag, shape (7,).
        out: The command [m/s], shape (3,).
    """
    for i in range(3):
        error = wanted[i] - actual[i]
        rate = (error - state[i]) / dt if state[6] > 0.0 else 0.0
        state[3 + i] = low_pass_step(state[3 + i], rate, 10.0, dt)
        state[i] = error
        out[i] = wanted[i] + gains.p * error + gains.d * state[3 + i]
    state[6] = 1.0


@njit(cache=True)
def position_pd(
    position: Array, target: Array, velocity: Array, feed: Array, gains: PositionRateGains, out: Array
) -> None:
    """Command Xp_dot = Xd_dot + kpp (Xd - Xe) + kpd d/dt (Xd - Xe) [m/s] (paper 1, eq. 5)."""
    for i in range(3):
        error_rate = feed[i] - velocity[i]
        out[i] = feed[i] + gains.p * (target[i] - position[i]) + gains.d * error_rate
