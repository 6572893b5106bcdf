"""What the baselines share: a virtual mass pushed by the force error, and the loops around it (layer 7)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig
from polish_sim.control.hybrid import STATE_SIZE, hybrid_state_of, position_by_velocity
from polish_sim.control.hybrid_laws import GAINS_SIZE, gains_of, position_gains, turn_and_level
from polish_sim.control.signals import Measurement, Target

Array = NDArray[np.float64]

OWN_GAINS, OWN_MEMORY = 8, 8
MEMORY = STATE_SIZE + OWN_MEMORY
BASELINE_SIZE = GAINS_SIZE + OWN_GAINS + MEMORY
"""Length of a baseline's context: gains of the loops around it, its own, memory of the loops, its own."""

VELOCITY, OFFSET, STARTED = 0, 1, 2


class VirtualMass(NamedTuple):
    """M dv/dt + D v + K x = Fd - Fe: velocity v and offset x answer the force error."""

    mass: float
    """M [kg]."""
    damping: float
    """D [N s/m]."""
    stiffness: float
    """K [N/m], 0 for none."""
    limit: float
    """Largest speed [m/s]."""


def baseline_gains(config: ControllerConfig, own: tuple[float, ...]) -> Array:
    """Gains of the loops around the law and its own, shape (24,)."""
    return np.concatenate([gains_of(config), own, np.zeros(OWN_GAINS - len(own))])


@njit(cache=True)
def own_gains(context: Array) -> Array:
    """A law's own gains, shape (8,)."""
    return context[GAINS_SIZE : GAINS_SIZE + OWN_GAINS]


@njit(cache=True)
def virtual_mass(context: Array) -> VirtualMass:
    """The virtual mass of a law whose own gains it is."""
    own = own_gains(context)
    return VirtualMass(own[0], own[1], own[2], own[3])


@njit(cache=True)
def own_memory(context: Array) -> Array:
    """A law's own memory, all zero after a reset, shape (8,)."""
    return context[GAINS_SIZE + OWN_GAINS + STATE_SIZE :]


@njit(cache=True)
def speed_along_z(m: Measurement) -> float:
    """The tool's measured speed along its axis [m/s]: a virtual mass starts with it."""
    z = m.rotation[:, 2]
    return float(z[0] * m.twist[0] + z[1] * m.twist[1] + z[2] * m.twist[2])


@njit(cache=True)
def push(body: VirtualMass, error: float, dt: float, memory: Array) -> float:
    """Push a virtual mass by the force error for one step.

    The damper is taken at the end of the step, so that no damping is too much for it.

    Args:
        body: The mass.
        error: Fd - Fe [N].
        dt: Step [s].
        memory: Its velocity [m/s] and offset [m] first.

    Returns:
        Its velocity [m/s].
    """
    speed = (body.mass * memory[VELOCITY] + (error - body.stiffness * memory[OFFSET]) * dt) / (
        body.mass + body.damping * dt
    )
    memory[VELOCITY] = min(max(speed, -body.limit), body.limit)
    memory[OFFSET] += memory[VELOCITY] * dt
    return float(memory[VELOCITY])


@njit(cache=True)
def move_around(context: Array, m: Measurement, t: Target, twist: Array) -> None:
    """Everything but tool z as ``hybrid-pi`` does it: position by eq. 6, orientation by eq. 7, moment about tool y."""
    state = hybrid_state_of(context[GAINS_SIZE + OWN_GAINS :])
    dt = m.clock[1]
    position_by_velocity(m, t, position_gains(context), dt, state, twist)
    turn_and_level(context, dt, m, t, state, twist)
