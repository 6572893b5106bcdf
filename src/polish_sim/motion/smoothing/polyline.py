"""Distance of a place to a stretch of the way points' polyline, and of an axis to its arcs (compiled)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.smoothing.chain import Chain

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def tip_distance(raw: Chain, first: int, stop: int, tip: Array) -> float:
    """Distance of a point to segments ``first`` to ``stop - 1`` [m]."""
    best = np.inf
    for k in range(first, stop):
        x, y, z = tip[0] - raw.tips[k, 0], tip[1] - raw.tips[k, 1], tip[2] - raw.tips[k, 2]
        d = raw.directions[k]
        along = min(max(x * d[0] + y * d[1] + z * d[2], 0.0), raw.lengths[k])
        x, y, z = x - along * d[0], y - along * d[1], z - along * d[2]
        best = min(best, x * x + y * y + z * z)
    return math.sqrt(best)


@njit(cache=True, error_model="numpy")
def axis_distance(raw: Chain, first: int, stop: int, axis: Array) -> float:
    """Angle of a unit axis to the arcs of segments ``first`` to ``stop - 1`` [rad]."""
    best = np.inf
    for k in range(first, stop):
        best = min(best, angle_between(raw.axes[k], axis), angle_between(raw.axes[k + 1], axis))
        n, a = raw.turn_axes[k], raw.axes[k]
        x = axis[0] * a[0] + axis[1] * a[1] + axis[2] * a[2]
        y = (
            axis[0] * (n[1] * a[2] - n[2] * a[1])
            + axis[1] * (n[2] * a[0] - n[0] * a[2])
            + axis[2] * (n[0] * a[1] - n[1] * a[0])
        )
        if raw.angles[k] > 0.0 and 0.0 <= math.atan2(y, x) <= raw.angles[k]:
            out = axis[0] * n[0] + axis[1] * n[1] + axis[2] * n[2]
            best = min(best, abs(math.atan2(out, math.sqrt(x * x + y * y))))
    return best


@njit(cache=True, error_model="numpy")
def angle_between(a: Array, b: Array) -> float:
    """Angle of two unit vectors [rad], accurate near zero too."""
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return math.atan2(math.sqrt(x * x + y * y + z * z), a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
