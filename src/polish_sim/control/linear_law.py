"""Control laws of the force loop as linear systems: by formula, or measured on the law itself (layer 7)."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import ControllerConfig

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


class LinearLaw(Protocol):
    """Speed along the tool axis that a law answers to a small change of what it reads, at points z."""

    def by_force(self, z: Complex) -> Complex:
        """Of the force reading [m/(s N)]."""

    def by_motion(self, z: Complex) -> Complex:
        """Of the tool's velocity, its place moving with it [-]."""


class PiLaw(NamedTuple):
    """State space of a filtered PI law on the force reading r: s' = A s + B r, speed = C s + D r."""

    A: Array
    """Shape (n, n)."""
    B: Array
    """Shape (n,)."""
    C: Array
    """Shape (n,)."""
    D: float

    def by_force(self, z: Complex) -> Complex:
        """Of the force reading [m/(s N)]."""
        systems = z[:, None, None] * np.eye(len(self.B)) - self.A
        states = np.linalg.solve(systems, np.broadcast_to(self.B[:, None], (len(z), len(self.B), 1)))
        return states[:, :, 0] @ self.C + self.D

    def by_motion(self, z: Complex) -> Complex:
        """Of the tool's velocity: nothing."""
        return np.zeros_like(z)


def pi_law(p: float, i: float, filter_hz: float, dt: float) -> PiLaw:
    """The law of ``control.force.force_pi`` within its limits.

    Args:
        p: [m/(s N)].
        i: [m/(s^2 N)].
        filter_hz: Corner of the low-pass on the reading [Hz].
        dt: Control cycle [s].

    Returns:
        Its state space; states are the filtered reading and its sum over time.
    """
    blend = 1.0 - math.exp(-2.0 * math.pi * filter_hz * dt)
    A = np.array([[1.0 - blend, 0.0], [dt * (1.0 - blend), 1.0]])
    B = np.array([blend, dt * blend])
    C = np.array([-p, -i])
    return PiLaw(A, B, C @ A, float(C @ B))


def hybrid_pi_linear(config: ControllerConfig, dt: float) -> PiLaw:
    """The force loop of ``hybrid-pi`` (paper 1, eq. 5 behind a low-pass)."""
    return pi_law(config.force_p_m_sn, config.force_i_m_s2n, config.force_filter_hz, dt)
