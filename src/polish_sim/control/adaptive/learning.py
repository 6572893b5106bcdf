"""The real surface, learned along the path and fed to the next turn (layer 7).

A part lies a millimetre off and is bent. Where the force is right the tool's height says where the surface really is;
the neighbouring turn, a step-over away, meets nearly the same error, and the slope of what was learned is known ahead.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.adaptive.ahead import Ahead
from polish_sim.control.signals import Target

Array = NDArray[np.float64]

AVERAGE, BEGAN, LAST_ROW = 0, 1, 2
FADING, SLOPE = 0, 1


class LearningGains(NamedTuple):
    """Gains of the learning."""

    length: float
    """Length over which the offset is averaged, and its slope taken to either side [m]."""
    sensor_delay: float
    """Age of the measured force [s]."""
    fade_s: float
    """Time in which the feed-forward fades in where a neighbour is known and out where it is lost [s]."""
    gain: float
    """Share of the neighbour's slope that is fed forward [-]."""
    weight: float
    """1, or 0 to leave the law out."""


@njit(cache=True, error_model="numpy", forceinline=True)
def learn(ahead: Ahead, t: Target, offset: float, gains: LearningGains, dt: float, state: Array) -> None:
    """Remember how much deeper than planned the real surface lies at the present place.

    The average lags its length behind, and the force is as old as the sensor's delay: it is stored where it belongs.

    Args:
        ahead: Its memory is written.
        t: Target.
        offset: Tool beyond the target along the planned axis, plus (wanted - measured force) / stiffness, less what was
            planned, see ``planned_surplus`` [m].
        gains: The gains.
        dt: Control cycle [s].
        state: Averaged offset [m], arc length where it began [m] (0: it does not run), last row written; shape (3,).
    """
    speed = t.path[2]
    if t.contact[0] == 0.0 or speed <= 0.0 or ahead.learned.shape[0] < 2:
        state[BEGAN] = 0.0
        return
    s = t.path[0]
    row = int((s - gains.length - speed * gains.sensor_delay) / ahead.spacing)
    if state[BEGAN] == 0.0:
        state[AVERAGE], state[BEGAN], state[LAST_ROW] = offset, s, row
    state[AVERAGE] += min(speed * dt / gains.length, 1.0) * (offset - state[AVERAGE])
    # The first stretch after a landing only fills the average.
    if s - state[BEGAN] < 2.0 * gains.length:
        state[LAST_ROW] = row
        return
    for k in range(max(int(state[LAST_ROW]) + 1, 0), min(row + 1, ahead.learned.shape[0])):
        ahead.learned[k] = state[AVERAGE]
        ahead.known[k] = 1.0
    state[LAST_ROW] = max(row, state[LAST_ROW])


@njit(cache=True, error_model="numpy", forceinline=True)
def learned_rate(ahead: Ahead, t: Target, look_ahead: float, gains: LearningGains, dt: float, state: Array) -> float:
    """Velocity along the tool axis that the neighbouring turn says will be needed [m/s].

    Args:
        ahead: What was learned.
        t: Target.
        look_ahead: How long from now the velocity is wanted [s].
        gains: The gains.
        dt: Control cycle [s]; 0 leaves the fading as it is.
        state: Fading, 0 to 1, and the slope while it fades out, shape (2,).
    """
    speed, n = t.path[2], ahead.learned.shape[0]
    if gains.weight == 0.0 or n < 2 or t.contact[0] == 0.0:
        state[FADING] = 0.0
        return 0.0
    s, h = t.path[0] + speed * look_ahead, gains.length
    before, after = _neighbour(ahead, s - h), _neighbour(ahead, s + h)
    span = abs(after - before) * ahead.spacing
    found = before >= 0 and after >= 0 and h < span < 4.0 * h
    found = found and ahead.known[max(before, 0)] > 0.0 and ahead.known[max(after, 0)] > 0.0
    if found:
        state[SLOPE] = (ahead.learned[after] - ahead.learned[before]) / (2.0 * h)
    state[FADING] += min(dt / gains.fade_s, 1.0) * ((1.0 if found else 0.0) - state[FADING])
    return gains.weight * gains.gain * state[FADING] * state[SLOPE] * speed


@njit(cache=True, error_model="numpy", forceinline=True)
def _neighbour(ahead: Ahead, s: float) -> int:
    """Row of the neighbour of the place at ``s`` [m], -1 for none."""
    row = int(s / ahead.spacing + 0.5)
    if row < 0 or row >= ahead.neighbour.shape[0]:
        return -1
    return int(ahead.neighbour[row])
