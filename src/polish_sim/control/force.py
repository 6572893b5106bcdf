"""Force and moment control by tool velocity (paper 1, eq. 5, lower half)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class PiGains(NamedTuple):
    """Gains of a PI law and the largest rate it may ask for."""

    p: float
    """kfp: [m/(s N)] for a force, [rad/(s N m)] for a moment."""
    i: float
    """kfi: [m/(s^2 N)] or [rad/(s^2 N m)]."""
    limit: float
    """Largest rate [m/s] or [rad/s]."""


@njit(cache=True)
def force_pi(error: float, gains: PiGains, dt: float, state: Array) -> float:
    """Rate kfp (Fd - Fe) + kfi integral (Fd - Fe) dt, limited, without wind-up (paper 1, eq. 5).

    Args:
        error: Fd - Fe [N] or [N m].
        gains: The gains.
        dt: Control cycle [s].
        state: The integral, shape (1,); it rests while the rate is at its limit and would grow further.

    Returns:
        The rate [m/s] or [rad/s].
    """
    grown = state[0] + error * dt
    rate = gains.p * error + gains.i * grown
    if -gains.limit <= rate <= gains.limit:
        state[0] = grown
        return rate
    if rate * error < 0.0:
        state[0] = grown
    return min(max(rate, -gains.limit), gains.limit)
