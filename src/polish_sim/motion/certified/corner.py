"""PLACEHOLDER until helper corner delivers."""
import math
from typing import NamedTuple

import numpy as np
from numba import njit

PIECES = 4
class CornerWeights(NamedTuple):
    tip_11: float
    tip_22: float
    tip_12: float
    axis_1: float
    axis_2: float
    axis_cosine: float
class CornerLimits(NamedTuple):
    speed: float
    acceleration: float
    jerk: float
    tip_tolerance: float
    axis_tolerance: float
    segment_speed: float
    segment_acceleration: float
    segment_jerk: float
class CornerShapes(NamedTuple):
    x: np.ndarray
class CornerKernel(NamedTuple):
    size: float
    speed: float
    acceleration: float
    duration: float
    durations: np.ndarray
    remaining: np.ndarray
    gone: np.ndarray
def corner_shapes():
    return CornerShapes(np.zeros(1))
@njit(cache=True)
def corner_kernel(w, lim, shapes):
    # norm of -d1 + d2 in tip terms
    n = math.sqrt(max(w.tip_11 + w.tip_22 - 2 * w.tip_12, 0.0))
    na = math.sqrt(max(w.axis_1**2 + w.axis_2**2 - 2 * w.axis_cosine * w.axis_1 * w.axis_2, 0.0))
    Jg = min(lim.jerk / max(n, 1e-9), math.radians(2000) / max(na, 1e-9))
    A = min(lim.acceleration / max(n, 1e-9), math.radians(100) / max(na, 1e-9))
    eps = lim.tip_tolerance / max(n, 1e-9)
    ax = max(w.axis_1, w.axis_2)
    if ax > 0:
        eps = min(eps, lim.axis_tolerance / ax)
    V = lim.segment_speed
    T = min((48 * eps / Jg) ** (1 / 3), 2 * math.sqrt(V / Jg), 2 * A / Jg)
    v = Jg * T * T / 4
    h = v * T / 2
    durations = np.array([T / 2, T / 2, 0.0, 0.0])
    a = np.zeros((4, 4)); b = np.zeros((4, 4))
    a[0, 0] = h; a[0, 1] = -v; a[0, 3] = Jg / 6
    t = T / 2
    a[1, 0] = h - v * t + Jg / 6 * t**3
    a[1, 1] = -v + Jg / 2 * t * t
    a[1, 2] = Jg * t / 2
    a[1, 3] = -Jg / 6
    b[0, 3] = Jg / 6
    b[1, 0] = Jg / 6 * t**3
    b[1, 1] = Jg / 2 * t * t
    b[1, 2] = Jg * t / 2
    b[1, 3] = -Jg / 6
    return CornerKernel(h, v, 0.0, T, durations, a, b)
