"""A part that does not lie still: a sine along its mean normal, and shifts a fault may give it (layer 8a).

It moves without tilting, on top of what a robot does that carries it (``carrier``); its velocity enters the contact.
What the engine draws does not show it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.contact import RealPart
from polish_sim.config import PartConfig

Array = NDArray[np.float64]

SHIFT_SPEED = 0.02  # of a part that slips [m/s]


class PartMotion(NamedTuple):
    """How the part moves; base frame."""

    axis: Array
    """Unit direction of the sine, out of the polished region, shape (3,)."""
    rest: Array
    """Origin of the work frame when the part is at rest [m], shape (3,)."""
    place: Array
    """The same while a robot carries the part [m], shape (3,)."""
    swing: Array
    """Amplitude [m], angular frequency [rad/s] and start [s] of the sine, shape (3,)."""
    shift: Array
    """Displacement beside the sine [m], shape (3,)."""
    goal: Array
    """What ``shift`` moves to at ``SHIFT_SPEED`` [m], shape (3,)."""
    velocity: Array
    """Of its origin now [m/s], shape (3,)."""
    turning: Array
    """Its angular velocity [rad/s], shape (3,)."""


def build_part_motion(config: PartConfig, part: RealPart) -> PartMotion:
    """The motion a scenario asks for, from the start of the run on."""
    return PartMotion(
        np.array(part.normal),
        part.position.copy(),
        part.position.copy(),
        np.array([config.motion_m, 2.0 * math.pi * config.motion_hz, 0.0]),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def move_part(motion: PartMotion, t: float, dt: float, position: Array) -> None:
    """Place the part for this instant.

    Args:
        motion: How it moves; shift and velocity are written.
        t: Time [s].
        dt: Physics step [s].
        position: Written: origin of its work frame [m], shape (3,).
    """
    amplitude, frequency, start = motion.swing[0], motion.swing[1], motion.swing[2]
    phase = frequency * (t - start)
    height = amplitude * math.sin(phase)
    speed = amplitude * frequency * math.cos(phase)
    left = 0.0
    for i in range(3):
        left += (motion.goal[i] - motion.shift[i]) ** 2
    left = math.sqrt(left)
    share = 0.0 if left == 0.0 else min(SHIFT_SPEED * dt / left, 1.0)
    for i in range(3):
        step = share * (motion.goal[i] - motion.shift[i])
        motion.shift[i] += step
        motion.velocity[i] = speed * motion.axis[i] + step / dt
        position[i] = motion.place[i] + height * motion.axis[i] + motion.shift[i]
