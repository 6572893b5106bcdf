"""How fast a segment may be run: speed, acceleration and jerk that keep tool and joints in limits (layer 6).

Along a segment the tool's motion is linear in the progress, so its limits scale by length and angle. The joints' are
q1 V <= speed, q2 V^2 + q1 A <= acceleration, q3 V^3 + 3 q2 V A + q1 J <= jerk (paper 4, eq. 15-17), with q1, q2, q3
bounds of the derivatives on the whole segment, proven piece by piece (`joint_enclosure`), not sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.certified.joint_enclosure import Enclosure, enclose, new_enclosure
from polish_sim.motion.kinematics import JOINT_LIMITS
from polish_sim.motion.segment_rates import BEYOND, REACHED, SINGULAR, Segment, rates_at, within_range
from polish_sim.motion.smoothing.arm import Arm, is_there
from polish_sim.motion.smoothing.limits import LimitValues

Array = NDArray[np.float64]

MOST_PIECES = 20000
"""A segment that needs more pieces (some 50 ms of work) runs through a singularity: no speed can be proven."""
LOOSE = 1.05
"""A piece is cut while its bounds exceed the values at its middle by more than this and bind."""
FINEST = 1.0 / 64.0
"""Half width below which bounds are taken as they are, if confirmed [-]."""
FASTEST, SHARPEST = 1e3, 1e9
"""Stand-ins for what no limit binds [m/s, m/s^3]."""
FEW_GUESSES = 2
"""A piece confirmed so soon may be followed by one twice as wide, where a dyadic grid has one."""
_SLACK = 1.0 - 1e-9


class SegmentWork(NamedTuple):
    """Work space of `segment_limits`, made once per stream."""

    enclosure: Enclosure
    most: Array
    """Largest bounds of |q'|, |q''|, |q'''| over the pieces seen, shape (3, 6)."""


def new_segment_work() -> SegmentWork:
    """Fresh work space."""
    return SegmentWork(new_enclosure(), np.zeros((3, 6)))


@njit(cache=True, error_model="numpy")
def tool_limits(segment: Segment, scale: float, limits: LimitValues, out: Array) -> None:
    """Write the largest speed, acceleration and jerk along a segment that tip and axis allow.

    Args:
        segment: The segment.
        scale: Its generalised length l [m], positive.
        limits: Of the tool.
        out: Written: V [m/s], A [m/s^2], J [m/s^3] along l, in its first three places.
    """
    tip = segment.length / scale
    axis = segment.angle / scale
    out[0] = min(limits.tip_speed / tip, limits.axis_speed / axis, FASTEST) * _SLACK
    out[2] = min(limits.tip_jerk / tip, limits.axis_jerk / axis, SHARPEST) * _SLACK
    # More than the square root is never reached on the way to full speed.
    acceleration = min(limits.tip_acceleration / tip, limits.axis_acceleration / axis) * _SLACK
    out[1] = min(acceleration, math.sqrt(out[0] * out[2]))


@njit(cache=True, error_model="numpy")
def _worst_share(rates: Array, scale: float, motion: Array, joint: Array) -> float:
    """Largest share of a joint's limit used at speed, acceleration and jerk ``motion`` along l."""
    v, a, j = motion[0] / scale, motion[1] / scale, motion[2] / scale
    worst = 0.0
    for i in range(6):
        q1, q2, q3 = abs(rates[0, i]), abs(rates[1, i]), abs(rates[2, i])
        worst = max(worst, q1 * v / joint[0, i])
        worst = max(worst, (q2 * v * v + q1 * a) / joint[1, i])
        worst = max(worst, (q3 * v * v * v + 3.0 * q2 * v * a + q1 * j) / joint[2, i])
    return worst


@njit(cache=True, error_model="numpy", forceinline=True)
def _stays_in_range(q: Array, rates: Array, r: float) -> bool:
    """Whether no joint can leave its range within r of the middle."""
    for i in range(6):
        way = r * rates[0, i]
        if q[i] - way < JOINT_LIMITS[i, 0] or q[i] + way > JOINT_LIMITS[i, 1]:
            return False
    return True


@njit(cache=True, error_model="numpy")
def bound_joints(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q_near: Array, motion: Array, work: SegmentWork
) -> int:
    """Bound the joint derivatives on a whole segment, piece by piece, into ``work.most``.

    Args:
        segment: In the base frame.
        scale: Its generalised length [m].
        limits: Of the joints; where they do not bind at ``motion``, loose bounds do.
        arm: Tool and robot.
        q_near: Says the arm's branch [rad], shape (6,).
        motion: Speed, acceleration and jerk along l that the tool allows.
        work: Work space.

    Returns:
        REACHED, UNREACHABLE, SINGULAR or BEYOND (a joint's range).
    """
    e, most = work.enclosure, work.most
    for i in range(3):
        for j in range(6):
            most[i, j] = 0.0
    for j in range(6):
        e.arm.q[j] = q_near[j]
    fourth = abs(segment.roll) * segment.angle**3
    start, width, pieces = 0.0, 1.0, 0
    while start < 1.0:
        pieces += 1
        if pieces > MOST_PIECES:
            return SINGULAR
        r = 0.5 * width
        status = rates_at(e.arm, segment, start + r, arm, e.arm.q, e.T)
        if status != REACHED and width < FINEST:
            return status
        guesses = enclose(e, r, fourth) if status == REACHED else 0
        if guesses == 0:
            width *= 0.5
            continue
        if not _stays_in_range(e.arm.q, e.rates, r):
            if not within_range(e.arm.q) or width < FINEST:
                return BEYOND
            width *= 0.5
            continue
        share = _worst_share(e.rates, scale, motion, limits.joint)
        if share > 1.0 and r > FINEST and share > LOOSE * _worst_share(e.arm.rates, scale, motion, limits.joint):
            width *= 0.5
            continue
        for i in range(3):
            for j in range(6):
                most[i, j] = max(most[i, j], e.rates[i, j])
        start += width
        if guesses <= FEW_GUESSES and start % (2.0 * width) == 0.0 and start + 2.0 * width <= 1.0:
            width *= 2.0
    return REACHED


@njit(cache=True, error_model="numpy", forceinline=True)
def _greatest_acceleration(most: Array, scale: float, v: float, joint: Array) -> float:
    """Largest acceleration along l that the joints allow at speed v; negative if v alone is too fast."""
    largest = math.inf
    for i in range(6):
        left = joint[1, i] - most[1, i] * (v / scale) ** 2
        largest = min(largest, left / (most[0, i] / scale) if left > 0.0 else -1.0)
    return largest


@njit(cache=True, error_model="numpy", forceinline=True)
def _greatest_jerk(most: Array, scale: float, v: float, a: float, joint: Array) -> float:
    """Largest jerk along l that the joints allow at speed v and acceleration a; negative if none."""
    v, a = v / scale, a / scale
    largest = math.inf
    for i in range(6):
        left = joint[2, i] - most[2, i] * v * v * v - 3.0 * most[1, i] * v * a
        largest = min(largest, left / (most[0, i] / scale) if left > 0.0 else -1.0)
    return largest


@njit(cache=True, error_model="numpy")
def _rest_to_rest(way: float, v: float, a: float, j: float) -> float:
    """Least time from rest to rest over a way: the S-curve's three boxes (paper file, time-optimal three-box)."""
    c = min(a / j, math.sqrt(v / j), np.cbrt(0.5 * way / j))
    # Boxes sorted: way = t1 t2 t3 j with t2 >= t3 = c and t1 >= t2 + t3.
    peak = j * c
    b = max(c, min(v / peak, 0.5 * (math.sqrt(c * c + 4.0 * way / peak) - c)))
    return max(way / (peak * b), b + c) + b + c


@njit(cache=True, error_model="numpy")
def joint_limits(most: Array, scale: float, limits: LimitValues, out: Array) -> None:
    """Lower speed, acceleration and jerk along l in ``out`` until the joints are in limits too.

    Tried are falling speeds and, at each, falling shares of the acceleration left; taken is the choice that passes a
    representative way from rest to rest soonest: the segment's own, but no shorter than the tool needs to get fast.

    Args:
        most: Bounds of the joint derivatives by progress, shape (3, 6).
        scale: Generalised length [m].
        limits: Of the joints.
        out: V, A, J that the tool allows; lowered.
    """
    v0, a0, j0 = out[0], out[1], out[2]
    for i in range(6):
        v0 = min(v0, limits.joint[0, i] / (most[0, i] / scale) * _SLACK)
    a = min(a0, _greatest_acceleration(most, scale, v0, limits.joint) * _SLACK)
    if a == a0 and _greatest_jerk(most, scale, v0, a, limits.joint) >= j0:
        out[0] = v0
        return
    way = max(scale, v0 * v0 / a0 + v0 * a0 / j0)
    soonest, v = math.inf, v0
    for _ in range(40):
        a_most = min(a0, _greatest_acceleration(most, scale, v, limits.joint) * _SLACK)
        if a_most > 0.0:
            a = a_most
            for _ in range(6):
                j = min(j0, _greatest_jerk(most, scale, v, a, limits.joint) * _SLACK)
                time = _rest_to_rest(way, v, a, j) if j > 0.0 else math.inf
                if time < soonest:
                    soonest, out[0], out[1], out[2] = time, v, a, j
                a *= 0.8
        if way / v > soonest:
            break
        v *= 0.85


@njit(cache=True, error_model="numpy")
def lower_to_joints(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q_near: Array, motion: Array, work: SegmentWork
) -> int:
    """Lower speed, acceleration and jerk along a segment until all joints are in limits on all of it.

    Args:
        segment: In the base frame.
        scale: Its generalised length l [m], positive.
        limits: Of the joints.
        arm: Tool and robot.
        q_near: Joint angles near the segment's start [rad], shape (6,); overwritten by those at its end.
        motion: V, A, J along l that the tool allows, finite; lowered.
        work: Work space.

    Returns:
        REACHED, UNREACHABLE, SINGULAR (no speed can be proven) or BEYOND (a joint's range).
    """
    status = bound_joints(segment, scale, limits, arm, q_near, motion, work)
    if status != REACHED:
        return status
    joint_limits(work.most, scale, limits, motion)
    e = work.enclosure
    status = rates_at(e.arm, segment, 1.0, arm, e.arm.q, e.T)
    for j in range(6):
        q_near[j] = e.arm.q[j]
    return status


@njit(cache=True, error_model="numpy")
def segment_limits(
    segment: Segment,
    scale: float,
    limits: LimitValues,
    arm: Arm,
    q_near: Array,
    motion: Array,
    work: SegmentWork,
) -> int:
    """Speed, acceleration and jerk along a segment, in limits of tool and joints on all of it.

    Args:
        segment: In the base frame.
        scale: Its generalised length l [m], positive.
        limits: Of tool and joints.
        arm: Tool and robot; `arm_or_none`: tool limits only.
        q_near: As for `lower_to_joints`.
        motion: Written: V, A, J along l in its first three places.
        work: Work space.

    Returns:
        REACHED, UNREACHABLE, SINGULAR or BEYOND (a joint's range).
    """
    tool_limits(segment, scale, limits, motion)
    if not is_there(arm):
        return REACHED
    return lower_to_joints(segment, scale, limits, arm, q_near, motion, work)
