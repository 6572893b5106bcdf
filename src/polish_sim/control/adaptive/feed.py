"""Slow the feed where the loops could not follow: what the drawing says, and what the force says (layer 7)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from polish_sim.control.adaptive.ahead import Ahead, at
from polish_sim.control.course import Course
from polish_sim.control.signals import Target

Array = NDArray[np.float64]

UNFORESEEN = 0.3
"""Share of a planned motion that a real part, displaced and bent, makes differently from its drawing [-]."""
OF_LIMIT = 0.5
"""Share of the robot's acceleration limits the path may use; the rest is for the force loop [-]."""
SMOOTHING_M = 0.002  # of the course's columns before they are differentiated [m]


class Abilities(NamedTuple):
    """What robot and force loop can do."""

    error: float
    """Budget of the force error [N]."""
    bandwidth: float
    """Crossover of the force loop [rad/s]."""
    acceleration: float
    """Of the tool point [m/s^2]."""
    angular_acceleration: float
    """Of the tool's axis [rad/s^2]."""


class FeedGains(NamedTuple):
    """Gains of the feed law."""

    error: float
    """Budget of the force error [N]."""
    filter_s: float
    """Time over which the force error is averaged, and in which the feed recovers [s]."""
    least: float
    """Share of the planned feed that is always granted [-]."""
    weight: float
    """1, or 0 to leave the law out."""


def followable_share(course: Course, can: Abilities) -> Array:
    """Share of the planned feed at which force and axis stay within the budget, from the drawing, (n,).

    Four limits on the speed v: the unforeseen part of the planned rate ``slope v`` costs the force loop an error of
    ``k slope v / w_c``; the rate changes by ``slope' v^2``, the path bends by ``bending v^2`` and the axis turns faster
    by ``turning' v^2``, all within a share of the robot's accelerations. Where the plan itself is as slow, all of it is
    granted. Before a slow place the share falls in time, at the rate at which it may grow.
    """
    if len(course.depth) < 3:
        return np.ones(len(course.depth))
    width = SMOOTHING_M / course.spacing
    slope = np.gradient(gaussian_filter1d(course.surplus, width, mode="nearest"), course.spacing)
    turning = gaussian_filter1d(course.turning, width, axis=0, mode="nearest")
    turning_change = np.linalg.norm(np.gradient(turning, course.spacing, axis=0), axis=1)
    bending = gaussian_filter1d(course.bending, width, mode="nearest")
    push = np.hypot(np.abs(np.gradient(slope, course.spacing)), bending)
    with np.errstate(divide="ignore"):
        limits = np.stack([
            can.error * can.bandwidth / (UNFORESEEN * course.stiffness * np.abs(slope)),
            np.sqrt(OF_LIMIT * can.acceleration / push),
            np.sqrt(OF_LIMIT * can.angular_acceleration / turning_change),
        ])  # fmt: skip
    speed, top = np.maximum(course.feed, 1e-6), max(float(course.feed.max()), 1e-6)
    rise = max(0.05 / top, 2.0)  # of the share, the sequence's own ramp [1/s]
    return _eased(np.minimum(limits.min(axis=0) / speed, 1.0), 2.0 * rise * course.spacing / speed)


@njit(cache=True)
def _eased(share: Array, gain: Array) -> Array:
    """Lower shares so that their square changes by no more than ``gain`` from row to row."""
    out = share.copy()
    for row in range(len(out) - 2, -1, -1):
        out[row] = min(out[row], math.sqrt(out[row + 1] ** 2 + gain[row]))
    for row in range(1, len(out)):
        out[row] = min(out[row], math.sqrt(out[row - 1] ** 2 + gain[row]))
    return out


@njit(cache=True, error_model="numpy", forceinline=True)
def granted_feed(ahead: Ahead, t: Target, force_error: float, gains: FeedGains, dt: float, state: Array) -> float:
    """Share of the planned feed to grant now.

    The drawing's share, lowered while the averaged force error is beyond the budget: twice the budget halves it.

    Args:
        ahead: What lies ahead.
        t: Target.
        force_error: Wanted less measured force [N].
        gains: The gains.
        dt: Control cycle [s].
        state: Averaged error [N], shape (1,).

    Returns:
        0 to 1.
    """
    if gains.weight == 0.0:
        return 1.0
    if t.contact[0] == 0.0:
        state[0] = 0.0
        return 1.0
    state[0] += dt / gains.filter_s * (force_error - state[0])
    known = ahead.share.shape[0] > 1
    share = at(ahead.share, ahead.spacing, t.path[0]) if known else 1.0
    beyond = abs(state[0]) / gains.error
    if beyond > 1.0:
        share /= beyond
    return max(share, gains.least)
