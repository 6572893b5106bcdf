"""The real surface's normal, from the moment of the pad's pressure (layer 7).

A pad that stands aslant presses with one side: the moment about the middle of its face, by the stiffness against
tilting that the drawing promises at this place, is the angle. Friction acts in the face and has no part in it, once
the measured moment is moved from the tool point to the face. What moment a border or a bend causes on the drawing is
taken off, so that the tool does not roll over an edge.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.adaptive.ahead import Ahead, at
from polish_sim.control.signals import Measurement, Target

Array = NDArray[np.float64]

TILT_X, TILT_Y, RATE_X, RATE_Y = 0, 1, 2, 3


class NormalGains(NamedTuple):
    """Gains of the normal's correction."""

    rate: float
    """Share of the angle seen that is taken back per time [1/s]."""
    limit: float
    """Largest correction of the planned axis [rad]."""
    turning_limit: float
    """Largest rate of the correction [rad/s]."""
    head_stiffness: float
    """Spring between tool point and pad [N/m]."""
    pad_tilt_stiffness: float
    """Of the whole disc on a flat part [N m/rad]."""
    weight: float
    """1, or 0 to leave the law out."""


@njit(cache=True, error_model="numpy", forceinline=True)
def level_by_moment(ahead: Ahead, m: Measurement, t: Target, gains: NormalGains, dt: float, state: Array) -> None:
    """Move the correction of the planned axis on by one cycle.

    Args:
        ahead: What moment to expect.
        m: Measurement.
        t: Target.
        gains: The gains.
        dt: Control cycle [s].
        state: The correction about tool x and y [rad] and its rate [rad/s], shape (4,).
    """
    if gains.weight == 0.0 or t.contact[0] == 0.0 or m.wrench[2] < 0.25 * t.force[0]:
        state[RATE_X] = state[RATE_Y] = 0.0
        if t.contact[0] == 0.0:
            state[TILT_X] = state[TILT_Y] = 0.0
        return
    # From the tool point to the pad's face, which the head's spring has pushed back.
    travel = m.wrench[2] / gains.head_stiffness
    moment_x = m.wrench[3] - travel * m.wrench[1]
    moment_y = m.wrench[4] + travel * m.wrench[0]
    s, carried = t.path[0], m.wrench[2] / t.force[0]
    moment_x -= carried * at(ahead.moment_x, ahead.spacing, s)
    moment_y -= carried * at(ahead.moment_y, ahead.spacing, s)
    stiff_x, stiff_y = at(ahead.tilt_x, ahead.spacing, s), at(ahead.tilt_y, ahead.spacing, s)
    if ahead.tilt_x.shape[0] < 2:
        stiff_x = stiff_y = gains.pad_tilt_stiffness
    state[RATE_X] = _rate(moment_x, stiff_x, gains)
    state[RATE_Y] = _rate(moment_y, stiff_y, gains)
    state[TILT_X] += state[RATE_X] * dt
    state[TILT_Y] += state[RATE_Y] * dt
    size = math.sqrt(state[TILT_X] * state[TILT_X] + state[TILT_Y] * state[TILT_Y])
    if size > gains.limit:
        state[TILT_X] *= gains.limit / size
        state[TILT_Y] *= gains.limit / size


@njit(cache=True, error_model="numpy", forceinline=True)
def _rate(moment: float, stiffness: float, gains: NormalGains) -> float:
    """Rate of the correction [rad/s]; slower where only a part of the pad touches and the moment says less."""
    whole = max(stiffness / gains.pad_tilt_stiffness, 1e-3)
    rate = -gains.rate * whole * moment / gains.pad_tilt_stiffness
    return min(max(rate, -gains.turning_limit), gains.turning_limit)


@njit(cache=True, error_model="numpy", forceinline=True)
def tilted_target(t: Target, state: Array, R_out: Array) -> None:
    """The planned orientation with the correction: ``R_out`` = R_target turned by the state about its own x and y."""
    a, b = state[TILT_X], state[TILT_Y]
    angle = math.sqrt(a * a + b * b)
    if angle < 1e-9:
        for i in range(3):
            for j in range(3):
                R_out[i, j] = t.rotation[i, j]
        return
    x, y, c, d = a / angle, b / angle, 1.0 - math.cos(angle), math.sin(angle)
    for i in range(3):
        r0, r1, r2 = t.rotation[i, 0], t.rotation[i, 1], t.rotation[i, 2]
        # Rodrigues' formula for the axis (x, y, 0).
        R_out[i, 0] = r0 * (1.0 - c * y * y) + r1 * c * x * y - r2 * d * y
        R_out[i, 1] = r0 * c * x * y + r1 * (1.0 - c * x * x) + r2 * d * x
        R_out[i, 2] = r0 * d * y - r1 * d * x + r2 * (1.0 - c)
