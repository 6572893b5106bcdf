"""Orientation control by equivalent rotation vectors (paper 1, eq. 7, fig. 9)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.filters import low_pass_step

Array = NDArray[np.float64]


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
