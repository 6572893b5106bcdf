"""How fast a segment may be run: speed, acceleration and jerk that keep tool and joints in limits.

Along a segment the tool's motion is linear in the progress, so its limits scale by length and angle. With bounds q1,
q2, q3 of a joint's derivatives by progress, V, A, J of progress must keep q1 V <= speed, q2 V^2 + q1 A <= acceleration,
q3 V^3 + 3 q2 V A + q1 J <= jerk (paper 4, eq. 15-17); the bounds are proven piece by piece (`enclosure`), not sampled.

A way L from rest to rest takes L/V + V/A + A/J. In the logarithms of V, A, J sums of powers are convex (a geometric
programme): the best A beside a V is known in closed form, V is found by a golden section; no other is faster.
"""

from __future__ import annotations

import math

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record
from polish_sim.motion.certified.enclosure import Enclosure, enclose
from polish_sim.motion.joint_rates import Rates
from polish_sim.motion.kinematics import JOINT_LIMITS
from polish_sim.motion.rules.limits import Arm, LimitValues, is_there
from polish_sim.motion.segment_rates import BEYOND, REACHED, SINGULAR, Segment, rates_at, within_range

_SLACK = 1.0 - 1e-9
_STILL = 1e-200  #: Stands for the derivative of a joint that does not move
_HALVINGS = 200  #: Of the speed, until the time rises again
_NARROWED = 24  #: Steps of the golden section: speeds are then known to 1e-5
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_LINES = 7
MOST_PIECES = 20000  #: A segment of more pieces (some 50 ms of work) runs through a singularity
FASTEST, SHARPEST = 1e3, 1e9  #: Stand-ins for infinite limits [m/s, m/s^3]
FEW_GUESSES = 2  #: A piece confirmed so soon may be followed by one twice as wide, where a dyadic grid has one
_AGAIN = 0.99  #: A choice sooner than the last one by this much may be held up by pieces that did not count before
Grain = tuple[float, float, float]
COARSE, FINE = (0.05, 1.0 / 64.0, 1.0), (0.002, 2.0**-13, 0.9)
"""How closely to bound, in a first round and again at the limits the one before found where the joints bind: a piece is
cut while its bounds exceed values known to occur by more than this share of a limit; half width of a piece that is not
cut any more if confirmed [-]; share of a limit from which on it counts."""


class SegmentWork(Record):
    """Work space of `segment_limits`."""

    enclosure: Enclosure
    most: Rates  #: Largest bounds of |q'|, |q''|, |q'''| over the pieces seen
    middle: Rates  #: Largest of them in the middle of a piece, where they are exact
    excess: Rates  #: How far a piece's bounds are above these


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def worst_share(rates: Array, scale: float, motion: Array, joint: Array) -> float:
    """Largest share of a joint's limit used at speed, acceleration and jerk ``motion`` along l."""
    v, a, j = motion[0] / scale, motion[1] / scale, motion[2] / scale
    worst = 0.0
    for i in range(6):
        q1, q2, q3 = abs(rates[0, i]), abs(rates[1, i]), abs(rates[2, i])
        worst = max(worst, q1 * v / joint[0, i])
        worst = max(worst, (q2 * v * v + q1 * a) / joint[1, i])
        worst = max(worst, (q3 * v * v * v + 3.0 * q2 * v * a + q1 * j) / joint[2, i])
    return worst


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def rest_to_rest(way: float, v: float, a: float, j: float) -> float:
    """Least time from rest to rest over a way: the S-curve's three boxes (paper file, time-optimal three-box)."""
    c = min(a / j, math.sqrt(v / j), np.cbrt(0.5 * way / j))
    # Boxes sorted: way = t1 t2 t3 j with t2 >= t3 = c and t1 >= t2 + t3.
    peak = j * c
    b = max(c, min(v / peak, 0.5 * (math.sqrt(c * c + 4.0 * way / peak) - c)))
    return max(way / (peak * b), b + c) + b + c


@njit(cache=True, error_model="numpy", _nrt=False)
def binds(most: Array, scale: float, joint: Array, motion: Array) -> bool:
    """Whether the joints allow less than a motion V, A, J along l."""
    return worst_share(most, scale, motion, joint) > _SLACK


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _jerk_left(most: Array, joint: Array, jerk: float, v: float, a: float) -> tuple[float, float]:
    """The line (most, bent) that leaves least jerk, most - bent a, at an acceleration: of a joint, or the tool's."""
    best, bend, least = jerk, 0.0, jerk
    for i in range(6):
        q1 = most[0, i] + _STILL
        left, bent = (joint[2, i] - most[2, i] * v * v * v) / q1, 3.0 * most[1, i] * v / q1
        if left - bent * a < least:
            best, bend, least = left, bent, left - bent * a
    return best, bend


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _best_on(line: tuple[float, float], v: float) -> float:
    """Acceleration of least v/a + a/j on one line."""
    return line[0] / (line[1] + math.sqrt(line[0] / v))


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _best_acceleration(most: Array, joint: Array, jerk: float, v: float, top: float) -> float:
    """Acceleration up to ``top`` of least v/a + a/j beneath all lines, which leave some jerk at no acceleration.

    The time falls where the least line's own best lies above, and rises where it lies below: the best place is one
    line's own, or where two meet.
    """
    low, high = _jerk_left(most, joint, jerk, v, 0.0), _jerk_left(most, joint, jerk, v, top)
    if _best_on(high, v) >= top:
        return top
    a = top
    for _ in range(_LINES):
        if high[1] <= low[1]:
            return min(_best_on(low, v), top)
        a = (high[0] - low[0]) / (high[1] - low[1])
        line = _jerk_left(most, joint, jerk, v, a)
        if line[0] - line[1] * a >= (low[0] - low[1] * a) * _SLACK:
            break
        if _best_on(line, v) > a:
            low = line
        else:
            high = line
    return min(max(a, _best_on(high, v)), _best_on(low, v))


@njit(cache=True, error_model="numpy", _nrt=False)
def _choice_at(most: Array, joint: Array, way: float, v: float, motion: Array) -> tuple[float, float, float]:
    """Time to pass the way, infinite if ``v`` is too high, with the best acceleration and jerk beside it, per progress.

    The time is convex in log v.
    """
    top = motion[1]
    for i in range(6):
        top = min(top, (joint[1, i] - most[1, i] * v * v) / (most[0, i] + _STILL))
    if not (top > 0.0 and _jerk_left(most, joint, motion[2], v, 0.0)[0] > 0.0):
        return math.inf, 0.0, 0.0
    a = _best_acceleration(most, joint, motion[2], v, top)
    line = _jerk_left(most, joint, motion[2], v, a)
    j = line[0] - line[1] * a
    ramps = v / a + a / j
    return ramps + max(ramps, way / v), a, j


@njit(cache=True, error_model="numpy", _nrt=False)
def choose_limits(most: Array, scale: float, joint: Array, way: float, motion: Array) -> bool:
    """Lower speed, acceleration and jerk along l in ``motion`` (3,) until the joints are in limits too, if they can be.

    ``most`` (3, 6) bounds the joint derivatives by progress, ``scale`` is the generalised length l [m], ``joint``
    (3, 6) are the limits, ``way`` is to be passed from rest to rest in least time [m].
    """
    if not binds(most, scale, joint, motion):
        return True
    for c in range(3):
        motion[c] /= scale
    high, progress = motion[0], way / scale
    for i in range(6):
        high = min(high, joint[0, i] / (most[0, i] + _STILL))
    v, best = high, _choice_at(most, joint, progress, high, motion)
    for _ in range(_HALVINGS):
        choice = _choice_at(most, joint, progress, 0.5 * v, motion)
        if math.isfinite(best[0]) and choice[0] >= best[0]:
            break
        v, best = 0.5 * v, choice
    low, high = 0.5 * v, min(2.0 * v, high)
    for _ in range(_NARROWED):
        # The wider part is halved in golden proportion; the best speed so far stays between both ends.
        upper = high / v > v / low
        other = v * (high / v) ** (1.0 - _GOLDEN) if upper else v * (low / v) ** (1.0 - _GOLDEN)
        choice = _choice_at(most, joint, progress, other, motion)
        if choice[0] < best[0]:
            low, high = (v, high) if upper else (low, v)
            v, best = other, choice
        elif upper:
            high = other
        else:
            low = other
    found = math.isfinite(best[0])
    if found:
        motion[0], motion[1], motion[2] = v * _SLACK, best[1] * _SLACK, best[2] * _SLACK
    for c in range(3):
        motion[c] *= scale
    return found


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def segment_limits(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q_near: Array, motion: Array, work: SegmentWork
) -> int:
    """Speed, acceleration and jerk along a segment, in limits of tool and joints on all of it.

    Args:
        segment: In the base frame.
        scale: Its generalised length l [m], positive.
        limits: Of tool and joints.
        arm: Tool and robot; `arm_or_none`: tool limits only.
        q_near: Joint angles near the segment's start [rad], shape (6,); overwritten by those at its end.
        motion: Written: V [m/s], A [m/s^2], J [m/s^3] along l with which a way is passed soon that is long enough to
            get fast, then those with which the segment takes least time from rest to rest; either three hold on their
            own, shape (6,).
        work: Work space.

    Returns:
        REACHED, UNREACHABLE, SINGULAR (no speed can be proven) or BEYOND (a joint's range).
    """
    tip, axis = segment.length / scale, segment.angle / scale
    motion[0] = min(limits.tip_speed / tip, limits.axis_speed / axis, FASTEST) * _SLACK
    motion[2] = min(limits.tip_jerk / tip, limits.axis_jerk / axis, SHARPEST) * _SLACK
    # More than the square root is never reached on the way to full speed.
    acceleration = min(limits.tip_acceleration / tip, limits.axis_acceleration / axis) * _SLACK
    motion[1] = min(acceleration, math.sqrt(motion[0] * motion[2]))
    for i in range(3):
        motion[3 + i] = motion[i]
    return _lower_to_joints(segment, scale, limits, arm, q_near, motion, work) if is_there(arm) else REACHED


@njit(cache=True, error_model="numpy", _nrt=False, inline="always")
def _lower_to_joints(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q_near: Array, motion: Array, work: SegmentWork
) -> int:
    """Lower what the tool allows until all joints are in limits on all of the segment; see `segment_limits`."""
    e = work.enclosure
    work.middle[:] = 0.0
    status = _bound_joints(segment, scale, limits, arm, q_near, motion[:3], COARSE, work)
    if status == REACHED and binds(work.most, scale, limits.joint, motion[:3]):
        tool, stop, time = (motion[0], motion[1], motion[2]), motion[3:6], math.inf
        found = _choose_both(scale, limits, tool, motion, work)
        while found and rest_to_rest(scale, stop[0], stop[1], stop[2]) < _AGAIN * time:
            time = rest_to_rest(scale, stop[0], stop[1], stop[2])
            # Next to a singularity there may be too many pieces for a closer look: the last one's bounds hold as well.
            if _bound_joints(segment, scale, limits, arm, q_near, stop, FINE, work) != REACHED:
                break
            found = _choose_both(scale, limits, tool, motion, work)
        status = REACHED if found else SINGULAR
    if status == REACHED:
        status = rates_at(e.arm, segment, 1.0, arm)
        for j in range(6):
            q_near[j] = e.arm.q[j]
    return status


@njit(cache=True, error_model="numpy", _nrt=False)
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


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _bound_joints(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q_near: Array, motion: Array, grain: Grain,
    work: SegmentWork,
) -> int:  # fmt: skip
    """Bound the joint derivatives on a whole segment, piece by piece, into ``work.most``.

    Where the joints do not bind at the speed, acceleration and jerk ``motion`` loose bounds are enough; see
    `segment_limits` for the other arguments and the result.
    """
    e, most = work.enclosure, work.most
    most[:] = 0.0
    for j in range(6):
        e.arm.q[j] = q_near[j]
    fourth = abs(segment.roll) * segment.angle**3
    start, width, pieces = 0.0, 1.0, 0
    while start < 1.0:
        pieces += 1
        if pieces > MOST_PIECES:
            return SINGULAR
        r = 0.5 * width
        status = rates_at(e.arm, segment, start + r, arm)
        if status != REACHED and width < COARSE[1]:
            return status
        guesses = enclose(e, r, fourth) if status == REACHED else 0
        if guesses == 0:
            width *= 0.5
            continue
        if not _stays_in_range(e.arm.q, e.rates, r):
            if not within_range(e.arm.q) or width < COARSE[1]:
                return BEYOND
            width *= 0.5
            continue
        if r > grain[1] and _is_loose(scale, limits, motion, grain, work):
            width *= 0.5
            continue
        for i in range(3):
            for j in range(6):
                most[i, j] = max(most[i, j], e.rates[i, j])
        start += width
        if guesses <= FEW_GUESSES and start % (2.0 * width) == 0.0 and start + 2.0 * width <= 1.0:
            width *= 2.0
    return REACHED


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _stays_in_range(q: Array, rates: Array, r: float) -> bool:
    """Whether no joint can leave its range within r of the middle."""
    for i in range(6):
        way = r * rates[0, i]
        if q[i] - way < JOINT_LIMITS[i, 0] or q[i] + way > JOINT_LIMITS[i, 1]:
            return False
    return True


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def _is_loose(scale: float, limits: LimitValues, motion: Array, grain: Grain, work: SegmentWork) -> bool:
    """Whether a piece's bounds bind and are too far above the values that are known to occur."""
    e = work.enclosure
    for i in range(3):
        for j in range(6):
            work.middle[i, j] = max(work.middle[i, j], abs(e.arm.rates[i, j]))
            work.excess[i, j] = max(e.rates[i, j] - work.middle[i, j], 0.0)
    return bool(
        worst_share(e.rates, scale, motion, limits.joint) > grain[2]
        and worst_share(work.excess, scale, motion, limits.joint) > grain[0]
    )
