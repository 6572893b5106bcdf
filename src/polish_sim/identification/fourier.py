"""Periodic joint motions as Fourier series.

    q = q0 + sum_k a_k / (k w) sin(k w t) - b_k / (k w) cos(k w t)          (paper 3)

a_k and b_k are amplitudes of the speed [rad/s]. The series is linear in its coefficients: `fourier_basis`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.identification.regressor import States

HARMONICS = 5
FREQUENCY = 0.1  #: Of the first harmonic [Hz]: a period of 10 s


def fourier_basis(t: Array, frequency: float = FREQUENCY, harmonics: int = HARMONICS) -> States:
    """Values and derivatives of one unit of each coefficient (1, a_1.., b_1..) at times t [s], (m, 1 + 2 k)
    each."""
    w = 2.0 * np.pi * frequency * np.arange(1, harmonics + 1)
    phase = np.outer(t, w)
    c, s = np.cos(phase), np.sin(phase)
    one = np.ones((len(t), 1))
    return States(
        np.hstack([one, s / w, -c / w]), np.hstack([0.0 * one, c, s]), np.hstack([0.0 * one, -w * s, w * c])
    )


@dataclass(frozen=True)
class FourierMotion:
    """A periodic motion of n joints."""

    coefficients: Array  #: q0, a_1.., b_1.. of each joint, shape (n, 1 + 2 k).
    frequency: float = FREQUENCY

    @property
    def harmonics(self) -> int:
        """Number of harmonics k."""
        return (self.coefficients.shape[1] - 1) // 2

    @property
    def period(self) -> float:
        """[s]."""
        return 1.0 / self.frequency

    def __call__(self, t: Array) -> States:
        """States at times t [s], shape (m,)."""
        return States(
            *(part @ self.coefficients.T for part in fourier_basis(t, self.frequency, self.harmonics))
        )

    def scaled(self, factor: float) -> FourierMotion:
        """The same motion with all amplitudes times a factor, about the same centre."""
        coefficients = self.coefficients.copy()
        coefficients[:, 1:] *= factor
        return FourierMotion(coefficients, self.frequency)


def fit_fourier(t: Array, q: Array, frequency: float, harmonics: int) -> FourierMotion:
    """Fit a series to measured positions (m, n) at times (m,), whose derivatives are then those of the fit.

    ``frequency``: of the first harmonic [Hz]; more ``harmonics`` than were commanded, because the servos add
    their own.
    """
    basis = fourier_basis(t, frequency, harmonics).q
    solution = np.linalg.solve(basis.T @ basis, basis.T @ q)
    return FourierMotion(np.ascontiguousarray(solution.T), frequency)


def started_and_stopped(motion: FourierMotion, t: Array, ramp: float, end: float) -> States:
    """The motion entered from rest and left to rest along its own path, its clock started and stopped
    smoothly.

    The clock runs at full speed from ``ramp``, the motion's time zero, to ``end - ramp``; at ``end`` [s] it
    stands.
    """
    up = np.clip(t / ramp, 0.0, 1.0)
    down = np.clip((end - t) / ramp, 0.0, 1.0)
    # The clock's speed rises as 3 x^2 - 2 x^3; its integral over the ramp is half the ramp.
    clock = np.where(
        t < ramp, ramp * (up**3 - 0.5 * up**4) - 0.5 * ramp,
        np.where(t > end - ramp, end - 1.5 * ramp - ramp * (down**3 - 0.5 * down**4), t - ramp),
    )  # fmt: skip
    speed = (3.0 * up**2 - 2.0 * up**3) * (3.0 * down**2 - 2.0 * down**3)
    change = (
        np.where(t < ramp, 6.0 * (up - up**2), np.where(t > end - ramp, -6.0 * (down - down**2), 0.0)) / ramp
    )
    states = motion(clock)
    rate = speed[:, None]
    rise = change[:, None]
    return States(states.q, states.qd * rate, states.qdd * rate**2 + states.qd * rise)


class Clearance(NamedTuple):
    """How far the robot is from itself and its surroundings."""

    #: Distance of each pair of bodies that could touch [m], negative inside, shape (m, pairs)
    distance: Array
    slope: Array  #: Its derivatives by the joints [m/rad], shape (m, pairs, n)


#: From poses (m, n) [rad] to clearances; the cell's one asks MuJoCo
ClearanceCheck = Callable[[Array], Clearance]


def beyond_one(ratio: Array) -> Array:
    """By how much shares of a limit go beyond it, signed; 0 inside."""
    return np.sign(ratio) * np.maximum(np.abs(ratio) - 1.0, 0.0)


@dataclass(frozen=True)
class MotionLimits:
    """Limits of position, speed, acceleration and torque of n joints, and of clearance."""

    position: Array  #: Lowest and highest [rad], shape (n, 2)
    speed: Array  #: [rad/s], shape (n,)
    acceleration: Array  #: [rad/s^2], shape (n,)
    torque: Array  #: [N m], shape (n,)
    clearance: float = 0.02  #: [m]

    def excess(self, states: States) -> States:
        """By how much positions, speeds and accelerations go beyond, in shares of the limits, signed; 0
        inside."""
        center = self.position.mean(axis=1)
        half = 0.5 * np.ptp(self.position, axis=1)
        ratios = ((states.q - center) / half, states.qd / self.speed, states.qdd / self.acceleration)
        return States(*map(beyond_one, ratios))

    def holds(self, states: States, torque: Array) -> bool:
        """Whether a motion respects position, speed, acceleration and torque at every sample."""
        return not any(np.any(part) for part in self.excess(states)) and bool(
            np.all(np.abs(torque) <= self.torque)
        )
