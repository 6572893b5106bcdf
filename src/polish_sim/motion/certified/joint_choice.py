"""Which speed, acceleration and jerk along a segment keep the joints' limits and pass it soonest (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SLACK = 1.0 - 1e-9
_SPEEDS, _SLOWER = 40, 0.85
"""Falling speeds tried first."""
_NARROWED = 14
"""Steps that then close in on the best one."""
_ACCELERATIONS, _LESS = 6, 0.8
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class Choice(NamedTuple):
    """What a speed allows beside it."""

    time: float
    """To pass the way from rest to rest [s]; infinite if the speed is too high."""
    acceleration: float
    jerk: float


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
    v, a = motion[0], motion[1]
    for i in range(6):
        if v * most[0, i] / scale > joint[0, i] * _SLACK:
            return True
    return not (
        _greatest_acceleration(most, scale, v, joint) * _SLACK >= a
        and _greatest_jerk(most, scale, v, a, joint) * _SLACK >= motion[2]
    )


@njit(cache=True, error_model="numpy")
def _choice_at(most: Array, scale: float, joint: Array, way: float, v: float, motion: Array) -> Choice:
    """The best acceleration and jerk beside a speed."""
    best = Choice(math.inf, 0.0, 0.0)
    a = min(motion[1], _greatest_acceleration(most, scale, v, joint) * _SLACK)
    for _ in range(_ACCELERATIONS):
        if not a > 0.0:
            break
        j = min(motion[2], _greatest_jerk(most, scale, v, a, joint) * _SLACK)
        time = rest_to_rest(way, v, a, j) if j > 0.0 else math.inf
        if time < best.time:
            best = Choice(time, a, j)
        a *= _LESS
    return best


@njit(cache=True, error_model="numpy")
def choose_limits(most: Array, scale: float, joint: Array, way: float, motion: Array) -> None:
    """Lower speed, acceleration and jerk along l until the joints are in limits too.

    Args:
        most: Bounds of the joint derivatives by progress, shape (3, 6).
        scale: Generalised length [m].
        joint: Limits, shape (3, 6).
        way: What is to be passed from rest to rest in least time [m].
        motion: V, A, J that the tool allows, shape (3,); lowered.
    """
    if not binds(most, scale, joint, motion):
        return
    top = motion[0]
    for i in range(6):
        top = min(top, joint[0, i] / (most[0, i] / scale) * _SLACK)
    speed, v, best = top, top, Choice(math.inf, 0.0, 0.0)
    for _ in range(_SPEEDS):
        choice = _choice_at(most, scale, joint, way, v, motion)
        if choice.time < best.time:
            speed, best = v, choice
        if way / v > best.time:
            break
        v *= _SLOWER
    low, high = speed * _SLOWER, min(speed / _SLOWER, top)
    for k in range(_NARROWED):
        v = high - _GOLDEN * (high - low) if k % 2 == 0 else low + _GOLDEN * (high - low)
        choice = _choice_at(most, scale, joint, way, v, motion)
        if choice.time < best.time:
            low, high = (low, speed) if v < speed else (speed, high)
            speed, best = v, choice
        elif v < speed:
            low = v
        else:
            high = v
    motion[0], motion[1], motion[2] = speed, best.acceleration, best.jerk
