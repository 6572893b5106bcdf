"""The spindle: its speed, and the pull of what is out of balance on it (layer 8a).

A rotor of balance grade G has its centre of mass off the axis by e = G / omega; it pulls with m e omega^2, turning with
the spindle. The physics sees the pull once a step, the sensor at its own rate: what a slow sensor makes of it (an
alias) comes out by itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.config import SpindleConfig

Array = NDArray[np.float64]

RUN_DOWN_S = 0.5  # from full speed to rest when the drive fails

ANGLE, SPIN, DRIVE = 0, 1, 2  # of the state


class Spindle(NamedTuple):
    """What turns and what pulls."""

    commanded: float
    """Speed it is meant to have [rad/s]."""
    imbalance: float
    """Mass times eccentricity m e [kg m]."""
    state: Array
    """Angle [rad], speed [rad/s] and share of the commanded speed it runs towards [-], shape (3,)."""


def build_spindle(config: SpindleConfig) -> Spindle:
    """A spindle at its speed, its heavy side along the head's x axis."""
    speed = 2.0 * math.pi * config.speed_rpm / 60.0
    imbalance = config.rotating_mass_kg * config.imbalance_m_s / speed if speed else 0.0
    return Spindle(speed, imbalance, np.array([0.0, speed, 1.0]))


@njit(cache=True, error_model="numpy", forceinline=True)
def turn_spindle(spindle: Spindle, dt: float) -> None:
    """Turn it on by one step; after a failure of its drive it runs down evenly."""
    state = spindle.state
    wanted = state[DRIVE] * spindle.commanded
    state[SPIN] = max(wanted, state[SPIN] - spindle.commanded * dt / RUN_DOWN_S)
    state[ANGLE] = (state[ANGLE] + state[SPIN] * dt) % (2.0 * math.pi)


@njit(cache=True, error_model="numpy", forceinline=True)
def pull_of_imbalance(spindle: Spindle, R_base_head: Array, force: Array) -> None:
    """Add the pull of the imbalance to a force on the head.

    Args:
        spindle: The spindle.
        R_base_head: Orientation of the head, its z axis the spindle's, shape (9,).
        force: Changed: force on the head's centre of mass [N], base, shape (3,).
    """
    pull = spindle.imbalance * spindle.state[SPIN] ** 2
    x, y = pull * math.cos(spindle.state[ANGLE]), pull * math.sin(spindle.state[ANGLE])
    for i in range(3):
        force[i] += R_base_head[3 * i] * x + R_base_head[3 * i + 1] * y
