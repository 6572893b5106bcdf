"""What a robot's joints did and which torques they took, as arrays; from simulation or from a file (layer 8d)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_lsq_spline

from polish_sim.identification.fourier import fit_fourier
from polish_sim.identification.torque_model import States

Array = NDArray[np.float64]

HARMONICS_FITTED = 20
"""Of the measured positions: four times what is commanded, for what the servos add."""


class RobotLog(NamedTuple):
    """Equally long columns, one row a sample."""

    time: Array
    """[s], shape (m,)."""
    q: Array
    """Measured positions [rad], shape (m, n)."""
    torque: Array
    """Torques of the joints, gravity included [N m], shape (m, n)."""


def periodic_states(log: RobotLog, period: float, harmonics: int = HARMONICS_FITTED) -> States:
    """States of a log of a periodic motion: a Fourier series fitted to its positions, and that series' derivatives."""
    return fit_fourier(log.time, log.q, 1.0 / period, harmonics)(log.time)


def with_noise(log: RobotLog, encoder: float, sigma: Array, rng: np.random.Generator) -> RobotLog:
    """The log as encoders and torque sensors read it.

    Args:
        log: What happened.
        encoder: Step of the encoders [rad].
        sigma: White noise of the torques [N m], shape (n,).
        rng: Draws the noise.
    """
    q = np.round(log.q / encoder) * encoder if encoder > 0.0 else log.q
    return RobotLog(log.time, q, log.torque + rng.normal(size=log.torque.shape) * sigma)


def spline_states(log: RobotLog, knots: float = 0.05) -> States:
    """States of any motion: splines of degree five fitted to its positions, and their derivatives.

    Args:
        log: The log.
        knots: Time between knots [s]; motion faster than some three of them is smoothed away.
    """
    span = log.time[-1] - log.time[0]
    inner = np.linspace(log.time[0], log.time[-1], max(int(span / knots), 2) + 1)[1:-1]
    t = np.concatenate([np.repeat(log.time[0], 6), inner, np.repeat(log.time[-1], 6)])
    spline = make_lsq_spline(log.time, log.q, t, k=5)
    return States(*(np.asarray(spline(log.time, nu=order)) for order in range(3)))
