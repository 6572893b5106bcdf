"""A simple corner kernel: speed falls on the old and rises on the new segment at once (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

PIECES = 2


class CornerWeights(NamedTuple):
    """What tip and axis do per generalised length on both sides: Gram numbers of two vectors."""

    tip_11: float
    tip_22: float
    tip_12: float
    axis_1: float
    axis_2: float
    axis_cosine: float


class CornerLimits(NamedTuple):
    """What the kernel may do."""

    speed: float
    acceleration: float
    jerk: float
    tip_tolerance: float
    axis_speed: float
    axis_acceleration: float
    axis_jerk: float
    axis_tolerance: float
    segment_speed: float
    segment_acceleration: float
    segment_jerk: float


class CornerShapes(NamedTuple):
    """Table of shapes."""

    table: Array


class CornerFigures(NamedTuple):
    """Size [m], speed [m/s], acceleration [m/s^2] and duration [s] of a kernel."""

    size: float
    speed: float
    acceleration: float
    duration: float


def corner_shapes() -> CornerShapes:
    """Read the table."""
    return CornerShapes(np.zeros(1))


@njit(cache=True, error_model="numpy")
def corner_kernel(
    weights: CornerWeights, limits: CornerLimits, shapes: CornerShapes, durations: Array, remaining: Array, gone: Array
) -> CornerFigures:
    """Fill a kernel's pieces; stands in until the better shapes are there."""
    w, big = weights, 1e-9
    tip = max(math.sqrt(max(w.tip_11 + w.tip_22 - 2.0 * w.tip_12, 0.0)), big)
    turn = w.axis_1**2 + w.axis_2**2 - 2.0 * w.axis_cosine * w.axis_1 * w.axis_2
    axis = max(math.sqrt(max(turn, 0.0)), big)
    jerk = min(limits.jerk / tip, limits.axis_jerk / axis)
    acceleration = min(limits.acceleration / tip, limits.axis_acceleration / axis)
    bend = min(limits.tip_tolerance / tip, limits.axis_tolerance / max(w.axis_1, w.axis_2, big))
    T = min(
        (48.0 * bend / jerk) ** (1.0 / 3.0), 2.0 * math.sqrt(limits.segment_speed / jerk), 2.0 * acceleration / jerk
    )
    speed, half = 0.25 * jerk * T * T, 0.5 * T
    for p in range(2):
        durations[p] = half
    remaining[0, 0], remaining[0, 1], remaining[0, 2], remaining[0, 3] = speed * half, -speed, 0.0, jerk / 6.0
    gone[0, 0], gone[0, 1], gone[0, 2], gone[0, 3] = 0.0, 0.0, 0.0, jerk / 6.0
    cube = jerk / 6.0 * half**3
    remaining[1, 0], remaining[1, 1], remaining[1, 2] = cube, -0.5 * speed, 0.5 * jerk * half
    remaining[1, 3] = -jerk / 6.0
    gone[1, 0], gone[1, 1], gone[1, 2], gone[1, 3] = cube, 0.5 * speed, 0.5 * jerk * half, -jerk / 6.0
    return CornerFigures(speed * half, speed, 0.0, T)
