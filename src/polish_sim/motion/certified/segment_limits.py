"""How fast a segment may be run: speed, acceleration and jerk that keep tool and joints in limits (layer 6).

Along a segment the tool's motion is linear in the progress, so its limits scale by length and angle. The joints' are
q1 V <= speed, q2 V^2 + q1 A <= acceleration, q3 V^3 + 3 q2 V A + q1 J <= jerk (paper 4, eq. 15-17), with q1, q2, q3
bounds of the derivatives on the whole segment, proven piece by piece (`joint_enclosure`), not sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.joint_choice import binds, choose_limits, rest_to_rest, worst_share
from polish_sim.motion.certified.joint_enclosure import Enclosure, enclose, new_enclosure
from polish_sim.motion.kinematics import JOINT_LIMITS
from polish_sim.motion.rules.limits import Arm, LimitValues, is_there
from polish_sim.motion.segment_rates import BEYOND, REACHED, SINGULAR, Segment, rates_at, within_range

Array = NDArray[np.float64]

MOST_PIECES = 20000
"""A segment that needs more pieces (some 50 ms of work) runs through a singularity: no speed can be proven."""
FASTEST, SHARPEST = 1e3, 1e9
"""Stand-ins for what no limit binds [m/s, m/s^3]."""
FEW_GUESSES = 2
"""A piece confirmed so soon may be followed by one twice as wide, where a dyadic grid has one."""
_SLACK = 1.0 - 1e-9
_AGAIN = 0.99
"""A choice sooner than the last one by this much may be held up by pieces that did not count before."""


class SegmentWork(NamedTuple):
    """Work space of `segment_limits`, made once per stream."""

    enclosure: Enclosure
    most: Array
    """Largest bounds of |q'|, |q''|, |q'''| over the pieces seen, shape (3, 6)."""
    middle: Array
    """Largest of them in the middle of a piece, where they are exact, shape (3, 6)."""
    excess: Array
    """How far a piece's bounds are above these, shape (3, 6)."""


def new_segment_work() -> SegmentWork:
    """Fresh work space."""
    return SegmentWork(new_enclosure(), np.zeros((3, 6)), np.zeros((3, 6)), np.zeros((3, 6)))


class Grain(NamedTuple):
    """How closely to bound."""

    loose: float
    """A piece is cut while its bounds exceed values known to occur by more than this share of a limit."""
    finest: float
    """Half width of a piece that is not cut any more if confirmed [-]."""
    binding: float
    """Share of a limit from which on it counts."""


COARSE, FINE = Grain(0.05, 1.0 / 64.0, 1.0), Grain(0.002, 2.0**-13, 0.9)
"""For a first round, and for more at what the one before found, where the joints bind."""


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


@njit(cache=True, error_model="numpy", forceinline=True)
def _stays_in_range(q: Array, rates: Array, r: float) -> bool:
    """Whether no joint can leave its range within r of the middle."""
    for i in range(6):
        way = r * rates[0, i]
        if q[i] - way < JOINT_LIMITS[i, 0] or q[i] + way > JOINT_LIMITS[i, 1]:
            return False
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _is_loose(scale: float, limits: LimitValues, motion: Array, grain: Grain, work: SegmentWork) -> bool:
    """Whether a piece's bounds bind and are too far above the values that are known to occur."""
    e = work.enclosure
    for i in range(3):
        for j in range(6):
            work.middle[i, j] = max(work.middle[i, j], abs(e.arm.rates[i, j]))
            work.excess[i, j] = max(e.rates[i, j] - work.middle[i, j], 0.0)
    return bool(
        worst_share(e.rates, scale, motion, limits.joint) > grain.binding
        and worst_share(work.excess, scale, motion, limits.joint) > grain.loose
    )


@njit(cache=True, error_model="numpy")
def bound_joints(
    segment: Segment,
    scale: float,
    limits: LimitValues,
    arm: Arm,
    q_near: Array,
    motion: Array,
    grain: Grain,
    work: SegmentWork,
) -> int:
    """Bound the joint derivatives on a whole segment, piece by piece, into ``work.most``.

    Args:
        segment: In the base frame.
        scale: Its generalised length [m].
        limits: Of the joints; where they do not bind at ``motion``, loose bounds do.
        arm: Tool and robot.
        q_near: Says the arm's branch [rad], shape (6,).
        motion: Speed, acceleration and jerk along l that are wanted.
        grain: How closely to look.
        work: Work space; ``middle`` holds values known to occur on the segment, or zeros.

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
        if status != REACHED and width < COARSE.finest:
            return status
        guesses = enclose(e, r, fourth) if status == REACHED else 0
        if guesses == 0:
            width *= 0.5
            continue
        if not _stays_in_range(e.arm.q, e.rates, r):
            if not within_range(e.arm.q) or width < COARSE.finest:
                return BEYOND
            width *= 0.5
            continue
        if r > grain.finest and _is_loose(scale, limits, motion, grain, work):
            width *= 0.5
            continue
        for i in range(3):
            for j in range(6):
                most[i, j] = max(most[i, j], e.rates[i, j])
        start += width
        if guesses <= FEW_GUESSES and start % (2.0 * width) == 0.0 and start + 2.0 * width <= 1.0:
            width *= 2.0
    return REACHED


@njit(cache=True, error_model="numpy")
def _choose_both(
    scale: float, limits: LimitValues, tool: tuple[float, float, float], motion: Array, work: SegmentWork
) -> bool:
    """Write what the bounds in ``work`` leave of the tool's V, A, J for a long way, then from rest to rest."""
    for i in range(3):
        motion[i] = motion[3 + i] = tool[i]
    way = max(scale, tool[0] ** 2 / tool[1] + tool[0] * tool[1] / tool[2])
    return bool(
        choose_limits(work.most, scale, limits.joint, scale, motion[3:6])
        and choose_limits(work.most, scale, limits.joint, way, motion[:3])
    )


@njit(cache=True, error_model="numpy")
def lower_to_joints(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q_near: Array, motion: Array, work: SegmentWork
) -> int:
    """Lower speeds, accelerations and jerks along a segment until all joints are in limits on all of it.

    Args:
        segment: In the base frame.
        scale: Its generalised length l [m], positive.
        limits: Of the joints.
        arm: Tool and robot.
        q_near: Joint angles near the segment's start [rad], shape (6,); overwritten by those at its end.
        motion: As for `segment_limits`: what the tool allows, finite; lowered.
        work: Work space.

    Returns:
        REACHED, UNREACHABLE, SINGULAR (no speed can be proven) or BEYOND (a joint's range).
    """
    for i in range(3):
        for j in range(6):
            work.middle[i, j] = 0.0
    status = bound_joints(segment, scale, limits, arm, q_near, motion[:3], COARSE, work)
    if status == REACHED and binds(work.most, scale, limits.joint, motion[:3]):
        tool, stop, time = (motion[0], motion[1], motion[2]), motion[3:6], math.inf
        found = _choose_both(scale, limits, tool, motion, work)
        while found and rest_to_rest(scale, stop[0], stop[1], stop[2]) < _AGAIN * time:
            time = rest_to_rest(scale, stop[0], stop[1], stop[2])
            # Next to a singularity there may be too many pieces for a closer look: the last one's bounds hold as well.
            if bound_joints(segment, scale, limits, arm, q_near, stop, FINE, work) != REACHED:
                break
            found = _choose_both(scale, limits, tool, motion, work)
        status = REACHED if found else SINGULAR
    if status != REACHED:
        return status
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
        motion: Written: V, A, J along l with which a way is passed soon that is long enough to get fast, then those
            with which the segment takes least time from rest to rest; either three hold on their own, shape (6,).
        work: Work space.

    Returns:
        REACHED, UNREACHABLE, SINGULAR or BEYOND (a joint's range).
    """
    tool_limits(segment, scale, limits, motion)
    for i in range(3):
        motion[3 + i] = motion[i]
    if not is_there(arm):
        return REACHED
    return lower_to_joints(segment, scale, limits, arm, q_near, motion, work)
