"""Position control by tool velocity (paper 1, eq. 5 and 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

# First-order low-pass, in the exact discrete form.


@njit(cache=True)
def low_pass_step(state: float, value: float, corner_hz: float, dt: float) -> float:
    """Next output of a first-order low-pass whose input is held over the step ``dt`` [s]."""
    return state + (1.0 - math.exp(-2.0 * math.pi * corner_hz * dt)) * (value - state)


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


# Orientation control by equivalent rotation vectors (paper 1, eq. 7, fig. 9).


class OrientationGains(NamedTuple):
    """PID gains on the angular velocity error, eq. 7."""

    look_ahead: float
    """T_a [s]."""
    p: float
    """[-]."""
    i: float
    """[1/s]."""
    d: float
    """[s]."""


@njit(cache=True)
def add_axis_rotation(n0: Array, n1: Array, spare: Array, out: Array) -> None:
    """Add the rotation vector that turns unit axis ``n0`` into ``n1`` the short way to ``out`` [rad].

    Parallel axes add nothing. For opposite ones every perpendicular axis is right: ``spare``, a unit vector
    perpendicular to ``n0``, is taken.
    """
    c0 = n0[1] * n1[2] - n0[2] * n1[1]
    c1 = n0[2] * n1[0] - n0[0] * n1[2]
    c2 = n0[0] * n1[1] - n0[1] * n1[0]
    sine = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
    cosine = n0[0] * n1[0] + n0[1] * n1[1] + n0[2] * n1[2]
    if sine > 1e-12:
        scale = math.atan2(sine, cosine) / sine
        out[0] += scale * c0
        out[1] += scale * c1
        out[2] += scale * c2
    elif cosine < 0.0:
        for i in range(3):
            out[i] += math.pi * spare[i]


@njit(cache=True)
def rotation_error(R_actual: Array, R_wanted: Array, out: Array) -> None:
    """Rotation vector from one frame to another by the paper's sum over the three axes, halved [rad].

    Summed over the axes a small rotation ``theta a`` counts twice, ``sum theta (a - (a.n_k) n_k) = 2 theta a``;
    exact to third order in the angle, and zero only where the frames agree or are a half turn apart.
    """
    out[0] = out[1] = out[2] = 0.0
    for k in range(3):
        add_axis_rotation(R_actual[:, k], R_wanted[:, k], R_actual[:, (k + 1) % 3], out)
    for i in range(3):
        out[i] *= 0.5


@njit(cache=True)
def angular_pid(wanted: Array, actual: Array, gains: OrientationGains, dt: float, state: Array, out: Array) -> None:
    """Angular velocity command f = f01 + PID(f01 - f0) (paper 1, eq. 7).

    Args:
        wanted: f01, planned turning rate plus error over the look-ahead [rad/s], shape (3,).
        actual: Measured angular velocity [rad/s], shape (3,).
        gains: The gains.
        dt: Control cycle [s].
        state: Integral, last error, low-passed derivative and a started flag, shape (10,).
        out: The command [rad/s], shape (3,).
    """
    for i in range(3):
        error = wanted[i] - actual[i]
        rate = (error - state[3 + i]) / dt if state[9] > 0.0 else 0.0
        state[6 + i] = low_pass_step(state[6 + i], rate, 10.0, dt)
        state[3 + i] = error
        state[i] += error * dt
        out[i] = wanted[i] + gains.p * error + gains.i * state[i] + gains.d * state[6 + i]
    state[9] = 1.0


# Force and moment control by tool velocity (paper 1, eq. 5, lower half).


class PiGains(NamedTuple):
    """Gains of a PI law, the largest rate it may ask for and the low-pass before it."""

    p: float
    """kfp: [m/(s N)] for a force, [rad/(s N m)] for a moment."""
    i: float
    """kfi: [m/(s^2 N)] or [rad/(s^2 N m)]."""
    limit: float
    """Largest rate [m/s] or [rad/s]."""
    filter_hz: float
    """Corner of the low-pass on the measurement [Hz].

    The sensor feels the tool's own inertia: without the filter a proportional gain kfp feeds kfp m d/dt of the
    command back, which beyond about kfp m 2 pi (sensor bandwidth) = 1 is a limit cycle, whatever the part.
    """


@njit(cache=True)
def force_pi(wanted: float, measured: float, gains: PiGains, dt: float, state: Array) -> float:
    """Rate kfp (Fd - Fe) + kfi integral (Fd - Fe) dt, limited, without wind-up (paper 1, eq. 5).

    Args:
        wanted: Fd [N] or [N m].
        measured: Fe [N] or [N m].
        gains: The gains.
        dt: Control cycle [s].
        state: The integral, the filtered measurement and a started flag, shape (3,). The integral rests while the
            rate is at its limit and would grow further.

    Returns:
        The rate [m/s] or [rad/s].
    """
    state[1] = low_pass_step(state[1], measured, gains.filter_hz, dt) if state[2] > 0.0 else measured
    state[2] = 1.0
    error = wanted - state[1]
    grown = state[0] + error * dt
    rate = gains.p * error + gains.i * grown
    if -gains.limit <= rate <= gains.limit:
        state[0] = grown
        return rate
    if rate * error < 0.0:
        state[0] = grown
    return min(max(rate, -gains.limit), gains.limit)
