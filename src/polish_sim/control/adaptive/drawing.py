"""What the drawing says the tool will have to do, done before the loops see an error.

The planned target is pressed in by F / k of flat contact. On a bend or a border the pad touches in part and has to go
deeper: ``slope`` times the feed is a velocity along the tool axis that a force loop would find out about late.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from polish_sim.control.signals import Course, Measurement, Target
from polish_sim.kernel_cache import njit

# The course as a compiled law reads it: columns in one flat array behind the law's gains and memory.
#
# Kernels cannot hold a Python object; they get the tail of the context and see it through ``ahead_of``.

Array = NDArray[np.float64]

HEADER = 2  # spacing and number of rows
COLUMNS = 15
MEMORY_COLUMNS = 2  # the last ones
SMOOTHING_M = 0.002  # of the planned depth before its slope is taken: the pad is far wider [m]


class Ahead(NamedTuple):
    """What lies ahead, and what was learned on the way; columns of shape (n,), n = 0 without a course."""

    spacing: float
    """Arc length between rows [m]."""
    depth: Array
    """Depth that presses with the wanted force, from the unpressed surface [m]."""
    surplus: Array
    """That depth beyond the planned target's [m]."""
    slope: Array
    """Change of the surplus per arc length [-]."""
    stiffness: Array
    """Head spring and touching part of the pad in series [N/m]."""
    turn_x: Array
    """Planned rotation per arc length about base x [rad/m]."""
    turn_y: Array
    turn_z: Array
    moment_x: Array
    """Moment of the pad's pressure about tool x through the middle of its face [N m]."""
    moment_y: Array
    tilt_x: Array
    """Stiffness against tilting about tool x [N m/rad]."""
    tilt_y: Array
    share: Array
    """Share of the planned feed the loops can follow [-]."""
    neighbour: Array
    """Row of the nearest place on an earlier turn, -1 for none."""
    learned: Array
    """How much deeper than drawn the tool had to go here, memory of the run [m]."""
    known: Array
    """1 where that was learned in this run, else 0."""


def pack_ahead(course: Course, share: Array) -> Array:
    """Flatten a course for the compiled laws, shape (2 + 15 n,).

    Args:
        course: The course.
        share: Share of the planned feed that can be followed, see ``feed.followable_share``, shape (n,).
    """
    n = len(course.depth)
    smooth = gaussian_filter1d(course.surplus, SMOOTHING_M / course.spacing, mode="nearest")
    slope = np.gradient(smooth, course.spacing) if n > 1 else np.zeros(n)
    columns = [
        course.depth, smooth, slope, course.stiffness, *course.turning.T, *course.moment.T, *course.tilt_stiffness.T,
        share, course.neighbour, *np.zeros((MEMORY_COLUMNS, n)),
    ]  # fmt: skip
    return np.concatenate([[course.spacing, n], *columns]).astype(np.float64)


def no_ahead() -> Array:
    """What the laws get when nothing is known of the path, shape (2,)."""
    return np.array([1.0, 0.0])


def forget(flat: Array) -> None:
    """Forget what was learned; what was drawn stays."""
    n = int(flat[1])
    flat[HEADER + (COLUMNS - MEMORY_COLUMNS) * n :] = 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def ahead_of(flat: Array) -> Ahead:
    """Named views of a flat course."""
    n, table = int(flat[1]), flat[2:]
    return Ahead(
        flat[0],
        table[0:n], table[n : 2 * n], table[2 * n : 3 * n], table[3 * n : 4 * n], table[4 * n : 5 * n],
        table[5 * n : 6 * n], table[6 * n : 7 * n], table[7 * n : 8 * n], table[8 * n : 9 * n],
        table[9 * n : 10 * n], table[10 * n : 11 * n], table[11 * n : 12 * n], table[12 * n : 13 * n],
        table[13 * n : 14 * n], table[14 * n : 15 * n],
    )  # fmt: skip


@njit(cache=True, error_model="numpy", forceinline=True)
def at(column: Array, spacing: float, s: float) -> float:
    """A column at an arc length [m], linear between rows and held at its ends; 0 without rows."""
    n = column.shape[0]
    if n < 2:
        return 0.0
    place = min(max(s / spacing, 0.0), n - 1.000001)
    row = int(place)
    return column[row] + (place - row) * (column[row + 1] - column[row])


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


# Slow the feed where the loops could not follow: what the drawing says, and what the force says.

UNFORESEEN = 0.3
"""Share of a planned motion that a real part, displaced and bent, makes differently from its drawing [-]."""
OF_LIMIT = 0.5
"""Share of the robot's acceleration limits the path may use; the rest is for the force loop [-]."""


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
