"""Slight bends inside a line: turned through without a change of the line's speed (layer 6).

Chords that follow one another with small turns are strung into one line with a single time law s(t), which may speed
up and slow down through the bends. At a bend the tip leaves the old chord at rate s' - g and enters the new one at
rate g: with t1, t2 the old and the new chord's directions, tip'' = s'' t1 + g' (t2 - t1) and so on. Over a time T
about the vertex g grows from nothing to s' as two parabolas, so only the share g'' |t2 - t1| of the jerk goes into
the turn. Part of every limit is kept for the law along the line, the rest is left to the bends.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_task import CornerLimits, CornerWeights

Array = NDArray[np.float64]

LINE_SHARE = 0.8
"""Share of acceleration and jerk limits that the law along a bent line may use."""
_PEAK = 1.0 / 12.0
"""What remains of the old chord at the vertex, at constant speed, as a share of the bend's length."""
_MARGIN = 1.15
"""How much more it may be while speed changes."""


class Bend(NamedTuple):
    """How a bend is passed."""

    length: float
    """Along the path, at constant speed [m of generalised length]; 0: not at all."""
    speed: float
    """Most, along generalised length [m/s]."""


class Vectors(NamedTuple):
    """Two vectors t1, t2, tip or axis per generalised length, by their products."""

    first: float
    """|t1|^2."""
    second: float
    """|t2|^2."""
    product: float
    """t1 t2."""


@njit(cache=True, error_model="numpy")
def tip_vectors(weights: CornerWeights) -> Vectors:
    """What the tip does on both sides."""
    return Vectors(weights.tip_11, weights.tip_22, weights.tip_12)


@njit(cache=True, error_model="numpy")
def axis_vectors(weights: CornerWeights) -> Vectors:
    """What the tool's axis does on both sides."""
    one, two = weights.axis_1, weights.axis_2
    return Vectors(one * one, two * two, one * two * weights.axis_cosine)


@njit(cache=True, error_model="numpy")
def turn_size(v: Vectors) -> float:
    """|t2 - t1|."""
    return math.sqrt(max(v.first + v.second - 2.0 * v.product, 0.0))


@njit(cache=True, error_model="numpy")
def _turn_share(v: Vectors) -> float:
    """Share of a limit left for g'' |t2 - t1| beside LINE_SHARE of it along either side."""
    turn = turn_size(v)
    longer = math.sqrt(max(v.first, v.second))
    if turn <= 1e-12 * longer:
        return 1.0
    along = max(abs(v.product - v.first), abs(v.second - v.product)) / (turn * longer)
    mixed = LINE_SHARE * min(along, 1.0)
    return math.sqrt(mixed * mixed + 1.0 - LINE_SHARE * LINE_SHARE) - mixed


@njit(cache=True, error_model="numpy")
def _greatest_turning(v: Vectors, limit: float) -> float:
    """Largest |g''| or |g'| within a limit on the vector."""
    turn = turn_size(v)
    return _turn_share(v) * limit / turn if turn > 0.0 else math.inf


@njit(cache=True, error_model="numpy")
def off_line(v: Vectors) -> float:
    """Distance from the nearer chord per remaining generalised length, at most."""
    crossed = math.sqrt(max(v.first * v.second - v.product * v.product, 0.0))
    shorter = math.sqrt(min(v.first, v.second))
    return crossed / shorter if shorter > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def off_axis(weights: CornerWeights) -> float:
    """The same for the tool's axis: min(alpha, beta) times the distance of both turn axes, at most 1."""
    if weights.axis_1 == 0.0 or weights.axis_2 == 0.0:
        return 0.0
    apart = math.sqrt(max(2.0 - 2.0 * weights.axis_cosine, 0.0))
    return min(apart, 1.0) * max(weights.axis_1, weights.axis_2)


@njit(cache=True, error_model="numpy")
def plan_bend(weights: CornerWeights, limits: CornerLimits, room: float) -> Bend:
    """Longest bend within the tolerances, and the speed it allows.

    Args:
        weights: Of the corner.
        limits: Of tool, both chords and what is left of the tolerances.
        room: Length of the shorter chord [m of generalised length].

    Returns:
        The bend.
    """
    tip, axis = tip_vectors(weights), axis_vectors(weights)
    bulge = _PEAK * _MARGIN
    length = room
    length = min(length, _ratio(limits.tip_tolerance, bulge * off_line(tip)))
    length = min(length, _ratio(limits.axis_tolerance, bulge * off_axis(weights)))
    jerk = min(_greatest_turning(tip, limits.jerk), _greatest_turning(axis, limits.axis_jerk))
    acceleration = min(_greatest_turning(tip, limits.acceleration), _greatest_turning(axis, limits.axis_acceleration))
    line_acceleration = LINE_SHARE * limits.segment_acceleration
    return Bend(length, _bend_speed(length, jerk - 0.5 * LINE_SHARE * limits.segment_jerk,
                                    acceleration - 0.5 * line_acceleration, line_acceleration))  # fmt: skip


@njit(cache=True, error_model="numpy")
def _ratio(limit: float, share: float) -> float:
    return limit / share if share > 0.0 else math.inf


@njit(cache=True, error_model="numpy")
def _bend_speed(length: float, jerk: float, acceleration: float, along: float) -> float:
    """Greatest v with 4 v^3 / l^2 + a v / l <= jerk and 2 v^2 / l <= acceleration; a: the line's acceleration."""
    if length <= 0.0 or not (jerk > 0.0 and acceleration > 0.0):
        return 0.0
    if math.isinf(jerk) and math.isinf(acceleration):
        return math.inf
    square, steady = 4.0 / (length * length), along / length
    v = (jerk / square) ** (1.0 / 3.0)
    for _ in range(8):
        v -= (v * (square * v * v + steady) - jerk) / (3.0 * square * v * v + steady)
    return min(v * (1.0 - 1e-9), math.sqrt(0.5 * acceleration * length))
