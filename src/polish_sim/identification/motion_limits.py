"""What an exciting motion must respect, and by how much it does not (layer 8d)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.identification.torque_model import States

Array = NDArray[np.float64]


class Clearance(NamedTuple):
    """How far the robot is from itself and its surroundings."""

    distance: Array
    """Distance of each pair of bodies that could touch [m], negative inside, shape (m, pairs)."""
    slope: Array
    """Its derivatives by the joints [m/rad], shape (m, pairs, n)."""


ClearanceCheck = Callable[[Array], Clearance]
"""From poses (m, n) [rad] to clearances; the cell has one that asks MuJoCo."""


@dataclass(frozen=True)
class MotionLimits:
    """Limits of position, speed, acceleration and torque of n joints, and of clearance."""

    position: Array
    """Lowest and highest [rad], shape (n, 2)."""
    speed: Array
    """[rad/s], shape (n,)."""
    acceleration: Array
    """[rad/s^2], shape (n,)."""
    torque: Array
    """[N m], shape (n,)."""
    clearance: float = 0.02
    """[m]."""

    def excess(self, states: States) -> States:
        """By how much positions, speeds and accelerations go beyond, in shares of the limits, signed; 0 inside."""
        center, half = self.position.mean(axis=1), 0.5 * np.ptp(self.position, axis=1)
        return States(
            _beyond((states.q - center) / half), _beyond(states.qd / self.speed),
            _beyond(states.qdd / self.acceleration),
        )  # fmt: skip

    def holds(self, states: States, torque: Array, clearance: Array | None) -> bool:
        """Whether a motion respects everything at every sample."""
        over = any(np.any(part) for part in self.excess(states))
        over |= bool(np.any(np.abs(torque) > self.torque))
        return not over and (clearance is None or bool(np.all(clearance >= self.clearance)))


def _beyond(ratio: Array) -> Array:
    return np.asarray(np.sign(ratio) * np.maximum(np.abs(ratio) - 1.0, 0.0))
