"""What the drawing says the tool will have to do, done before the loops see an error.

The planned target is pressed in by F / k of flat contact. On a bend or a border the pad touches in part and
has to go
deeper: ``slope`` times the feed is a velocity along the tool axis that a force loop would find out about
late.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from polish_sim.arrays import Array, norms
from polish_sim.config import AdaptiveConfig
from polish_sim.control.adaptive.gains import AdaptiveGains
from polish_sim.control.signals import Course, Measurement, Target
from polish_sim.kernels import Record, Vector2, Vector3, kernel
from polish_sim.motion.trajectory import slowed_before

SMOOTHING_M = 0.002  # of the planned depth before its slope is taken: the pad is far wider [m]


class AheadRow(Record):
    """One place of the path, and what was learned there."""

    surplus: float  #: Depth that presses with the wanted force, beyond the planned target's [m]
    slope: float  #: Change of the surplus per arc length [-]
    stiffness: float  #: Head spring and touching part of the pad in series [N/m]
    turning: Vector3  #: Planned rotation per arc length, base frame [rad/m]
    moment: Vector2  #: Of the pad's pressure about tool x and y through the middle of its face [N m]
    tilt_stiffness: Vector2  #: Against tilting about them [N m/rad]
    share: float  #: Share of the planned feed the loops can follow [-]
    neighbour: int  #: Row of the nearest place on an earlier turn, -1 for none
    arm_mode: float  #: Vibration of the arm that the notch takes out [rad/s]; 0: none
    learned: float  #: How much deeper than drawn the tool had to go here, memory of the run [m]
    known: bool  #: Whether that was learned in this run


class Ahead(NamedTuple):
    """What lies ahead on the path, and what was learned on the way."""

    spacing: float  #: Arc length between rows [m]
    rows: Any  #: ``AheadRow`` at equal steps of arc length, shape (n,); none without a course


def rows_ahead(course: Course, share: Array) -> NDArray[np.void]:
    """A course for the compiled laws, shape (n,) of ``AheadRow``, with the ``share`` (n,) of
    `followable_share`."""
    rows = np.zeros(len(course.depth), AheadRow.dtype)
    smooth = gaussian_filter1d(course.surplus, SMOOTHING_M / course.spacing, mode="nearest")
    rows["surplus"], rows["share"] = smooth, share
    if len(rows) > 1:
        rows["slope"] = np.gradient(smooth, course.spacing)
    for name in ("stiffness", "turning", "moment", "tilt_stiffness", "neighbour", "arm_mode"):
        rows[name] = getattr(course, name)
    return rows


@kernel
def at(column: Array, spacing: float, s: float) -> float:
    """A column at an arc length [m], linear between rows and held at its ends; 0 without rows."""
    n = column.shape[0]
    if n < 2:
        return 0.0
    place = min(max(s / spacing, 0.0), n - 1.000001)
    row = int(place)
    return column[row] + (place - row) * (column[row + 1] - column[row])


MOST_RATIO = 1.5  # softer springs than drawn change the depths less than their stiffness says


@kernel
def planned_surplus(ahead: Ahead, t: Target, ratio: float, g: AdaptiveGains) -> float:
    """How far beyond the target the feed-forward means the tool to be at this place [m]."""
    if not g.feed_forward:
        return 0.0
    return _scale(ratio) * at(ahead.rows.surplus, ahead.spacing, t.s)


@kernel
def _scale(ratio: float) -> float:
    """Factor of the drawn depths where springs are not as drawn; ``ratio`` is drawn by real stiffness [-]."""
    return min(max(ratio, 0.0), MOST_RATIO)


@kernel
def planned_press_rate(
    ahead: Ahead,
    m: Measurement,
    t: Target,
    wanted: Array,
    look_ahead: float,
    ratio: float,
    g: AdaptiveGains,
) -> float:
    """Velocity along the tool's own z that keeps the force as the path is followed, ``look_ahead`` [s] from
    now [m/s].

    Two parts: the depth that changes along the path, and the planned motion seen along an axis that is not
    where it should be; a tool that lags behind a bend runs out of, or into, the part. ``wanted`` (3, 3) is
    the R_base_tool the turning loop aims at, ``ratio`` the drawn stiffness by the real one.
    """
    speed = t.speed
    if speed <= 0.0 or not t.contact or not g.feed_forward:
        return 0.0
    slope = at(ahead.rows.slope, ahead.spacing, t.s + speed * look_ahead)
    rate = slope * speed * _scale(ratio)
    for i in range(3):
        rate += t.twist[i] * (t.rotation[i, 2] + m.rotation[i, 2] - wanted[i, 2])
    return rate


@kernel
def lead_turning(ahead: Ahead, t: Target, g: AdaptiveGains, out: Array) -> None:
    """Turn as the plan will when the command acts, by the believed delay: add the change of the planned
    turning rate to ``out[3:6]``."""
    speed = t.speed
    if speed <= 0.0 or not g.feed_forward:
        return
    then = t.s + speed * g.command_delay_s
    for i in range(3):
        turning = ahead.rows.turning[:, i]
        out[3 + i] += speed * (at(turning, ahead.spacing, then) - at(turning, ahead.spacing, t.s))


# Slow the feed where the loops could not follow: what the drawing says, and what the force says.

#: Share of a planned motion that a displaced and bent part makes differently from its drawing [-]
UNFORESEEN = 0.3
#: Share of the robot's acceleration limits the path may use; the rest is for the force loop [-]
OF_LIMIT = 0.5


#: Time over which the force error is averaged, and in which the feed recovers [s]
FEED_AVERAGE_S = 0.1


def followable_share(course: Course, can: AdaptiveConfig) -> Array:
    """Share of the planned feed at which force and axis stay within the budget, from the drawing, (n,).

    Limits on the speed v: the unforeseen part of the planned rate ``slope v`` costs the force loop an error
    of ``k slope v / w_c``; the rate changes by ``slope' v^2``, the path bends by ``bending v^2`` and the axis
    turns faster by ``turning' v^2``, all within a share of the robot's accelerations; the joints, which turn
    about as fast as the tool, must not let the gears' error come at half the arm's vibration. Where the plan
    itself is as slow, all of it is granted. Before a slow place the share falls in time, at the rate at which
    it may grow.
    """
    if len(course.depth) < 3:
        return np.ones(len(course.depth))
    width = SMOOTHING_M / course.spacing
    slope = np.gradient(gaussian_filter1d(course.surplus, width, mode="nearest"), course.spacing)
    turning = gaussian_filter1d(course.turning, width, axis=0, mode="nearest")
    turning_change = norms(np.gradient(turning, course.spacing, axis=0))
    bending = gaussian_filter1d(course.bending, width, mode="nearest")
    push = np.hypot(np.abs(np.gradient(slope, course.spacing)), bending)
    with np.errstate(divide="ignore"):
        limits = np.stack([
            can.feed_error_n * can.crossover_rad_s / (UNFORESEEN * course.stiffness * np.abs(slope)),
            np.sqrt(OF_LIMIT * can.acceleration_m_s2 / push),
            np.sqrt(OF_LIMIT * can.angular_acceleration_rad_s2 / turning_change),
            np.where(course.arm_mode > 0.0, 0.5 * course.arm_mode / can.gear_waves, math.inf)
            / norms(turning),
        ])  # fmt: skip
    speed, top = np.maximum(course.feed, 1e-6), max(float(course.feed.max()), 1e-6)
    rise = max(0.05 / top, 2.0)  # of the share, the sequence's own ramp [1/s]
    gain = 2.0 * rise * course.spacing / speed
    before = slowed_before(np.minimum(limits.min(axis=0) / speed, 1.0), gain)
    return slowed_before(before[::-1].copy(), gain[::-1].copy())[::-1].copy()


@kernel
def granted_feed(ahead: Ahead, t: Target, error: float, g: AdaptiveGains) -> float:
    """Share of the planned feed to grant now, 0 to 1.

    The drawing's share, lowered while the averaged force ``error`` [N] is beyond the budget: twice the budget
    halves it.
    """
    if not g.feed or not t.contact:
        return 1.0
    share = at(ahead.rows.share, ahead.spacing, t.s) if ahead.rows.shape[0] > 1 else 1.0
    beyond = abs(error) / g.feed_error_n
    if beyond > 1.0:
        share /= beyond
    return max(share, g.feed_least)


@kernel
def averaged_error(average: float, error: float, t: Target, dt: float) -> float:
    """The average of wanted less measured force [N] with one more cycle."""
    return average + dt / FEED_AVERAGE_S * (error - average) if t.contact else 0.0
