"""First-order low-pass, in the exact discrete form."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True)
def low_pass_step(state: float, value: float, corner_hz: float, dt: float) -> float:
    """Next output of a first-order low-pass whose input is held over the step ``dt`` [s]."""
    return state + (1.0 - math.exp(-2.0 * math.pi * corner_hz * dt)) * (value - state)
