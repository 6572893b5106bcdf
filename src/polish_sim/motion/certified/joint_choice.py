"""Which speed, acceleration and jerk along a segment keep the joints' limits and pass it soonest (layer 6).

With bounds q1, q2, q3 of a joint's derivatives by progress, V, A, J of progress must keep q1 V <= speed,
q2 V^2 + q1 A <= acceleration, q3 V^3 + 3 q2 V A + q1 J <= jerk (paper 4, eq. 15-17); a way L from rest to rest
takes L/V + V/A + A/J. In the logarithms of V, A, J sums of powers are convex (a geometric programme): the best A beside
a V is known in closed form, V is found by a golden section, and no other choice is faster.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

_SLACK = 1.0 - 1e-9
_STILL = 1e-200
"""Stands for the derivative of a joint that does not move."""
_HALVINGS = 200
"""Of the speed, until the time rises again."""
_NARROWED = 24
"""Steps of the golden section: speeds are then known to 1e-5."""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
_LINES = 7


class Choice(NamedTuple):
    """What a speed allows beside it."""

    time: float
    """To pass the way from rest to rest [s]; infinite if the speed is too high."""
    acceleration: float
    jerk: float


class _Line(NamedTuple):
    """Jerk left beside an acceleration a at a given speed: ``most - bent a``."""

    most: float
    bent: float


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def rest_to_rest(way: float, v: float, a: float, j: float) -> float:
    """Least time from rest to rest over a way: the S-curve's three boxes (paper file, time-optimal three-box)."""
    c = min(a / j, math.sqrt(v / j), np.cbrt(0.5 * way / j))
    # Boxes sorted: way = t1 t2 t3 j with t2 >= t3 = c and t1 >= t2 + t3.
    peak = j * c
    b = max(c, min(v / peak, 0.5 * (math.sqrt(c * c + 4.0 * way / peak) - c)))
    return max(way / (peak * b), b + c) + b + c


@njit(cache=True, error_model="numpy")
def binds(most: Array, scale: float, joint: Array, motion: Array) -> bool:
    """Whether the joints allow less than a motion V, A, J along l."""
    return worst_share(most, scale, motion, joint) > _SLACK


@njit(cache=True, error_model="numpy", forceinline=True)
def _jerk_left(most: Array, joint: Array, jerk: float, v: float, a: float) -> _Line:
    """The line that leaves least jerk at an acceleration: of one of six joints, or the tool's."""
    line, least = _Line(jerk, 0.0), jerk
    for i in range(6):
        q1 = most[0, i] + _STILL
        left, bent = (joint[2, i] - most[2, i] * v * v * v) / q1, 3.0 * most[1, i] * v / q1
        if left - bent * a < least:
            line, least = _Line(left, bent), left - bent * a
    return line


@njit(cache=True, error_model="numpy", forceinline=True)
def _best_on(line: _Line, v: float) -> float:
    """Acceleration of least v/a + a/j on one line."""
    return line.most / (line.bent + math.sqrt(line.most / v))


@njit(cache=True, error_model="numpy", forceinline=True)
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
        if high.bent <= low.bent:
            return min(_best_on(low, v), top)
        a = (high.most - low.most) / (high.bent - low.bent)
        line = _jerk_left(most, joint, jerk, v, a)
        if line.most - line.bent * a >= (low.most - low.bent * a) * _SLACK:
            break
        if _best_on(line, v) > a:
            low = line
        else:
            high = line
    return min(max(a, _best_on(high, v)), _best_on(low, v))


@njit(cache=True, error_model="numpy")
def _choice_at(most: Array, joint: Array, way: float, v: float, motion: Array) -> Choice:
    """The best acceleration and jerk beside a speed, in rates of progress; the time is convex in log v."""
    top = motion[1]
    for i in range(6):
        top = min(top, (joint[1, i] - most[1, i] * v * v) / (most[0, i] + _STILL))
    if not (top > 0.0 and _jerk_left(most, joint, motion[2], v, 0.0).most > 0.0):
        return Choice(math.inf, 0.0, 0.0)
    a = _best_acceleration(most, joint, motion[2], v, top)
    line = _jerk_left(most, joint, motion[2], v, a)
    j = line.most - line.bent * a
    ramps = v / a + a / j
    return Choice(ramps + max(ramps, way / v), a, j)


@njit(cache=True, error_model="numpy")
def choose_limits(most: Array, scale: float, joint: Array, way: float, motion: Array) -> bool:
    """Lower speed, acceleration and jerk along l until the joints are in limits too.

    Args:
        most: Bounds of the joint derivatives by progress, shape (3, 6).
        scale: Generalised length l [m].
        joint: Limits, shape (3, 6).
        way: What is to be passed from rest to rest in least time [m].
        motion: V, A, J that the tool allows, shape (3,), finite; lowered.

    Returns:
        Whether there is any; ``motion`` is as it was if not.
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
        if math.isfinite(best.time) and choice.time >= best.time:
            break
        v, best = 0.5 * v, choice
    low, high = 0.5 * v, min(2.0 * v, high)
    for _ in range(_NARROWED):
        # The wider part is halved in golden proportion; the best speed so far stays between both ends.
        upper = high / v > v / low
        other = v * (high / v) ** (1.0 - _GOLDEN) if upper else v * (low / v) ** (1.0 - _GOLDEN)
        choice = _choice_at(most, joint, progress, other, motion)
        if choice.time < best.time:
            low, high = (v, high) if upper else (low, v)
            v, best = other, choice
        elif upper:
            high = other
        else:
            low = other
    found = math.isfinite(best.time)
    if found:
        motion[0], motion[1], motion[2] = v * _SLACK, best.acceleration * _SLACK, best.jerk * _SLACK
    for c in range(3):
        motion[c] *= scale
    return found
