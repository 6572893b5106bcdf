"""Force and moment control by tool velocity (paper 1, eq. 5, lower half)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.filters import low_pass_step

Array = NDArray[np.float64]


class PiGains(NamedTuple):
    """Gains of a PI law, the largest rate it may ask for and the low-pass before it."""

    p: float
    """kfp: [m/(s N)] for a force, [rad/(s N m)] for a moment."""
    i: float
    """kfi: [m/(s^2 N)] or [rad/(s^2 N m)]."""
    limit: float
    """Largest rate [m/s] or [rad/s]."""
    filter_hz: float
    """Corner of the low-pass on the measurement [Hz].

    The sensor feels the tool's own inertia: without the filter a proportional gain kfp feeds kfp m d/dt of the
    command back, which beyond about kfp m 2 pi (sensor bandwidth) = 1 is a limit cycle, whatever the part.
    """


@njit(cache=True)
def force_pi(wanted: float, measured: float, gains: PiGains, dt: float, state: Array) -> float:
    """Rate kfp (Fd - Fe) + kfi integral (Fd - Fe) dt, limited, without wind-up (paper 1, eq. 5).

    Args:
        wanted: Fd [N] or [N m].
        measured: Fe [N] or [N m].
        gains: The gains.
        dt: Control cycle [s].
        state: The integral, the filtered measurement and a started flag, shape (3,). The integral rests while the
            rate is at its limit and would grow further.

    Returns:
        The rate [m/s] or [rad/s].
    """
    state[1] = low_pass_step(state[1], measured, gains.filter_hz, dt) if state[2] > 0.0 else measured
    state[2] = 1.0
    error = wanted - state[1]
    grown = state[0] + error * dt
    rate = gains.p * error + gains.i * grown
    if -gains.limit <= rate <= gains.limit:
        state[0] = grown
        return rate
    if rate * error < 0.0:
        state[0] = grown
    return min(max(rate, -gains.limit), gains.limit)
