"""What the drawing says the tool will have to do, done before the loops see an error (layer 7).

The planned target is pressed in by F / k of flat contact. On a bend or a border the pad touches in part and has to go
deeper: ``slope`` times the feed is a velocity along the tool axis that a force loop would find out about late.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.control.adaptive.ahead import Ahead, at
from polish_sim.control.signals import Measurement, Target

Array = NDArray[np.float64]

MOST_RATIO = 1.5  # softer springs than drawn change the depths less than their stiffness says


class FeedForwardGains(NamedTuple):
    """Gains of the feed-forward."""

    look_ahead: float
    """From a command to the tool's motion [s]."""
    weight: float
    """1, or 0 to leave the law out."""


@njit(cache=True, error_model="numpy", forceinline=True)
def planned_surplus(ahead: Ahead, t: Target, ratio: float, gains: FeedForwardGains) -> float:
    """How far beyond the target the feed-forward means the tool to be at this place [m]."""
    return gains.weight * _scale(ratio) * at(ahead.surplus, ahead.spacing, t.path[0])


@njit(cache=True, error_model="numpy", forceinline=True)
def _scale(ratio: float) -> float:
    """Factor of the drawn depths where springs are not as drawn; ``ratio`` is drawn by real stiffness [-]."""
    return min(max(ratio, 0.0), MOST_RATIO)


@njit(cache=True, error_model="numpy", forceinline=True)
def planned_press_rate(
    ahead: Ahead, m: Measurement, t: Target, wanted: Array, look_ahead: float, ratio: float, gains: FeedForwardGains
) -> float:
    """Velocity along the tool's own z that keeps the force as the path is followed [m/s].

    Two parts: the depth that changes along the path, and the planned motion seen along an axis that is not where it
    should be; a tool that lags behind a bend runs out of, or into, the part.

    Args:
        ahead: What lies ahead.
        m: Measurement.
        t: Target.
        wanted: Orientation the turning loop aims at, R_base_tool, shape (3, 3).
        look_ahead: How long from now the velocity is wanted [s].
        ratio: Drawn stiffness by the real one [-].
        gains: The gains.
    """
    speed = t.path[2]
    if speed <= 0.0 or t.contact[0] == 0.0:
        return 0.0
    slope = at(ahead.slope, ahead.spacing, t.path[0] + speed * look_ahead)
    rate = slope * speed * _scale(ratio)
    for i in range(3):
        rate += t.twist[i] * (t.rotation[i, 2] + m.rotation[i, 2] - wanted[i, 2])
    return gains.weight * rate


@njit(cache=True, error_model="numpy", forceinline=True)
def lead_turning(ahead: Ahead, t: Target, gains: FeedForwardGains, out: Array) -> None:
    """Turn as the plan will when the command acts: add the change of the planned turning rate to ``out[3:6]``."""
    speed = t.path[2]
    if speed <= 0.0 or ahead.turn_x.shape[0] < 2:
        return
    now, then = t.path[0], t.path[0] + speed * gains.look_ahead
    factor = gains.weight * speed
    out[3] += factor * (at(ahead.turn_x, ahead.spacing, then) - at(ahead.turn_x, ahead.spacing, now))
    out[4] += factor * (at(ahead.turn_y, ahead.spacing, then) - at(ahead.turn_y, ahead.spacing, now))
    out[5] += factor * (at(ahead.turn_z, ahead.spacing, then) - at(ahead.turn_z, ahead.spacing, now))
