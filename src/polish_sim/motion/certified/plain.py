"""The plain kernel: small, for corners of short segments (layer 6).

Speed falls on the old segment and rises on the new one over the same time, as two parabolas each. It rounds a corner
more slowly than the shapes of corner_shapes, but takes much less of both segments.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.bends import axis_vectors, off_axis, off_line, tip_vectors, turn_size
from polish_sim.motion.certified.corner_shapes import PIECES
from polish_sim.motion.certified.corner_task import CornerFigures, CornerLimits, CornerWeights

Array = NDArray[np.float64]

_ROUNDING = 1.0 - 1e-9


@njit(cache=True, error_model="numpy")
def plain_kernel(weights: CornerWeights, limits: CornerLimits) -> CornerFigures:
    """The largest plain kernel within limits and tolerances of tip and axis, its jerk as high as they allow.

    Args:
        weights: Of the corner.
        limits: Of tool and both segments.

    Returns:
        Its figures; it begins and ends without acceleration.
    """
    tip, axis = tip_vectors(weights), axis_vectors(weights)
    tip_turn, axis_turn = turn_size(tip), turn_size(axis)
    jerk = min(_ratio(limits.jerk, tip_turn), _ratio(limits.axis_jerk, axis_turn))
    acceleration = min(_ratio(limits.acceleration, tip_turn), _ratio(limits.axis_acceleration, axis_turn))
    bulge = min(_ratio(limits.tip_tolerance, off_line(tip)), _ratio(limits.axis_tolerance, off_axis(weights)))
    if math.isinf(jerk):
        return CornerFigures(0.0, limits.segment_speed * _ROUNDING, 0.0, 0.0)
    # At its middle a = b = j T^3 / 48, the acceleration's peak is j T / 2 and v = j T^2 / 4.
    T = min(
        (48.0 * bulge / jerk) ** (1.0 / 3.0), 2.0 * acceleration / jerk, 2.0 * math.sqrt(limits.segment_speed / jerk)
    )
    T *= _ROUNDING
    speed = 0.25 * jerk * T * T
    return CornerFigures(0.5 * speed * T, speed, 0.0, T)


@njit(cache=True, error_model="numpy")
def _ratio(limit: float, share: float) -> float:
    return limit / share if share > 1e-12 else math.inf


@njit(cache=True, error_model="numpy")
def fill_plain(size: float, speed: float, durations: Array, remaining: Array, gone: Array) -> None:
    """Write the pieces of the plain kernel of a size and a speed."""
    half = size / speed
    jerk = speed / (half * half)
    cube = jerk * half**3 / 6.0
    for p in range(PIECES):
        durations[p] = half if p < 2 else 0.0
    _fill_cubic(remaining[0], size, -speed, 0.0, jerk)
    _fill_cubic(remaining[1], cube, -0.5 * speed, jerk * half, -jerk)
    _fill_cubic(gone[0], 0.0, 0.0, 0.0, jerk)
    _fill_cubic(gone[1], cube, 0.5 * speed, jerk * half, -jerk)


@njit(cache=True, error_model="numpy")
def _fill_cubic(row: Array, way: float, speed: float, acceleration: float, jerk: float) -> None:
    row[0], row[1], row[2], row[3] = way, speed, 0.5 * acceleration, jerk / 6.0
