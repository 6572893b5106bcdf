"""The real surface, learned along the path and fed to the next turn.

A part lies a millimetre off and is bent. Where the force is right the tool's height says where the surface really is;
the neighbouring turn, a step-over away, meets nearly the same error, and the slope of what was learned is known ahead.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.control.adaptive.drawing import Ahead, at
from polish_sim.control.signals import Measurement, Target
from polish_sim.kernel_cache import njit

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


# The real surface's normal, from the moment of the pad's pressure.
#
# A pad that stands aslant presses with one side: the moment about the middle of its face, by the stiffness against
# tilting that the drawing promises at this place, is the angle. Friction acts in the face and has no part in it, once
# the measured moment is moved from the tool point to the face. What moment a border or a bend causes on the drawing is
# taken off, so that the tool does not roll over an edge.

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
