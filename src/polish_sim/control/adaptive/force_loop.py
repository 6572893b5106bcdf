"""The force loop: crossover and observer from stiffness, delay, noise and unknown mass; the observer itself (layer 7).

The tool's travel z is known at once and almost exactly, the force late and noisy. Between two readings the force
changes by k z, so the observer keeps what the travel does not explain, b (where the part is, in newtons), and its
rate r (a part that rises or sinks):

    F = b + k z,    e = reading - own forces - (b + k z as sensed),    db/dt = r + 2 w_o e,    dr/dt = w_o^2 e.

The command is u = w_c ((F_set - F) / k - travel under way) - r / k. With the right k the loop is an integrator on the
encoders, w_c / s with the command's delay taken out by the travel under way. A resting part leaves no error; one that
rises at a speed v leaves k v T, T the lags of command and sensor (0.2 N at 4 mm/s): to extrapolate it costs a tenth
more noise and half the damping on soft springs at 20 ms. A limited command winds nothing up, because the observer sees
the travel that was really done.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.adaptive.inertia import unknown_mass
from polish_sim.control.adaptive.memory import AGE, AT_NO_TRAVEL, LANDED, RATE, STIFFNESS, TRAVEL, PressMemory

_MASS_SHARE = 0.5  # of its command the loop may feed back through unknown inertia
_NOISE_POWER = 0.6  # the observer slows with noise to this power
_FIRST_CORNER = 100.0  # of the observer at first touch [rad/s]
_FIRST_TIME = 0.03  # in which it comes down [s]


class Pace(NamedTuple):
    """How fast the loop may be."""

    crossover: float
    """w_c [rad/s]."""
    observer: float
    """w_o [rad/s]."""


@njit(cache=True)
def pace_of(g: AdaptiveGains, stiffness: float, delay: float, noise: float, age: float) -> Pace:
    """Crossover and observer corner the loop can afford.

    w_c delay <= ``delay_share``; 2 w_c w_o m / k <= 1/2 for a mass m that may be unaccounted for; w_o falls with noise.

    Args:
        g: Gains.
        stiffness: k [N/m].
        delay: Of the command [s].
        noise: Deviation of a reading in the air [N].
        age: Time since contact [s]; at first the observer is quick.
    """
    crossover = min(g.crossover, g.delay_share / delay)
    observer = g.observer * min(1.0, (g.noise / max(noise, 1e-3)) ** _NOISE_POWER)
    most = 0.5 * _MASS_SHARE * stiffness / unknown_mass(g)
    slower = math.sqrt(min(1.0, most / (crossover * observer)))
    crossover, observer = slower * crossover, slower * observer
    if g.touch_down > 0.0:
        observer += (slower * _FIRST_CORNER - observer) * math.exp(-age / _FIRST_TIME)
    return Pace(crossover, observer)


@njit(cache=True)
def begin_contact(memory: PressMemory, stiffness: float, path: float, force: float) -> None:
    """Start the observer at what is read: travel ``path`` [m] as sensed, ``force`` [N]."""
    state = memory.force
    state[AT_NO_TRAVEL], state[STIFFNESS] = force - stiffness * path, stiffness
    state[RATE] = state[LANDED] = state[AGE] = 0.0


@njit(cache=True)
def change_stiffness(memory: PressMemory, stiffness: float, path: float) -> None:
    """Believe another stiffness [N/m] without a jump of what the sensor should show at travel ``path`` [m]."""
    memory.force[AT_NO_TRAVEL] -= (stiffness - memory.force[STIFFNESS]) * path
    memory.force[STIFFNESS] = stiffness


@njit(cache=True)
def observe_force(memory: PressMemory, corner: float, path: float, reading: float, landed: float, dt: float) -> float:
    """Take in one reading and return the force pressed with now [N].

    Args:
        memory: The observer's.
        corner: w_o [rad/s].
        path: Travel as sensed [m].
        reading: Without the tool's own forces [N].
        landed: Weight of the rate's learning, 0 to 1 [-].
        dt: Control cycle [s].
    """
    state = memory.force
    surprise = reading - (state[AT_NO_TRAVEL] + state[STIFFNESS] * path)
    state[AT_NO_TRAVEL] += dt * (state[RATE] + 2.0 * corner * surprise)
    state[RATE] += dt * landed * corner * corner * surprise
    return float(state[AT_NO_TRAVEL] + state[STIFFNESS] * state[TRAVEL])
