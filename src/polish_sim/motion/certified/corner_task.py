"""What a corner kernel is asked for: tip and axis on both sides, limits, and the figures it has (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_bounds import Pair, Peaks, pair_of

FAR = (1e30, 1e30)
"""Generalised lengths of segments whose other ends do not matter [m]."""
ROUNDING = 1.0 - 1e-12
"""Kept from limits and tolerances for rounding."""


class CornerWeights(NamedTuple):
    """What tip and axis do per generalised length on both sides: Gram numbers of two pairs of vectors."""

    tip_11: float
    """(L1 / l1)^2."""
    tip_22: float
    """(L2 / l2)^2."""
    tip_12: float
    """Scalar product of the tip's two rates."""
    axis_1: float
    """theta1 / l1 [rad/m]."""
    axis_2: float
    """theta2 / l2 [rad/m]."""
    axis_cosine: float
    """n1 . n2 at the corner."""
    spans: tuple[float, float]
    """Generalised lengths of both segments [m]: a short one has another end near."""


class CornerLimits(NamedTuple):
    """What the kernel may do; infinite where there is no limit."""

    speed: float
    """Of the tip [m/s]."""
    acceleration: float
    """[m/s^2]."""
    jerk: float
    """[m/s^3]."""
    tip_tolerance: float
    """[m]."""
    axis_speed: float
    """[rad/s]."""
    axis_acceleration: float
    """[rad/s^2]."""
    axis_jerk: float
    """[rad/s^3]."""
    axis_tolerance: float
    """[rad]."""
    segment_speed: float
    """The smaller one of both segments', along generalised length [m/s]."""
    segment_acceleration: float
    """For the runs that lead here and away [m/s^2]."""
    segment_jerk: float
    """[m/s^3]."""


class CornerFigures(NamedTuple):
    """A kernel from outside."""

    size: float
    """Of either segment [m of generalised length]."""
    speed: float
    """At both ends [m/s]."""
    acceleration: float
    """Slowing down at the beginning, speeding up at the end [m/s^2], at least 0."""
    duration: float
    """[s]."""


class Side(NamedTuple):
    """Tip or axis at a corner, with its limits."""

    pair: Pair
    limits: Peaks
    tolerance: float
    bends: bool


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def tip_side(weights: CornerWeights, limits: CornerLimits, spans: tuple[float, float]) -> Side:
    """The tip, on segments of these generalised lengths."""
    first, second = math.sqrt(weights.tip_11), math.sqrt(weights.tip_22)
    cosine = weights.tip_12 / max(first * second, 1e-300)
    return Side(
        pair_of(first, second, cosine, spans),
        Peaks(limits.speed, limits.acceleration, limits.jerk),
        limits.tip_tolerance * ROUNDING,
        False,
    )


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def axis_side(weights: CornerWeights, limits: CornerLimits, spans: tuple[float, float]) -> Side:
    """The tool's axis."""
    return Side(
        pair_of(weights.axis_1, weights.axis_2, weights.axis_cosine, spans),
        Peaks(limits.axis_speed, limits.axis_acceleration, limits.axis_jerk),
        limits.axis_tolerance * ROUNDING,
        True,
    )
