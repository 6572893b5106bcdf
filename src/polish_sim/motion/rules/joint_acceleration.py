"""The rule `joint-acceleration`: the method paper 4 compares with ([18] there), joint jerk not looked at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.rules.fastest import fastest_triples, stop_triples
from polish_sim.motion.rules.fir_rule import fir_rule
from polish_sim.motion.rules.progress_limits import ProgressLimits
from polish_sim.motion.segment_rates import JointRates
from polish_sim.motion.smoothing.limits import SmoothingLimits

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def block_triples(tool: ProgressLimits, rates: JointRates, limits: SmoothingLimits) -> Array:
    """Filter times of a block of segments, shape (k, 3)."""

    def triples_at(speed: Array, rows: Indices) -> Array:
        base = stop_triples(speed, tool.acceleration[rows], tool.jerk[rows])
        t2 = np.maximum(base[:, 1], second_time(speed, rates.first[rows], rates.second[rows], limits))
        t3 = base[:, 2]
        return np.stack([np.maximum(1.0 / speed, t2 + t3), t2, t3], axis=1)

    return fastest_triples(capped_speed(tool.speed, rates, limits), triples_at)


def capped_speed(speed: Array, rates: JointRates, limits: SmoothingLimits) -> Array:
    """Largest rate of progress at which no joint is too fast either (eq. 18-20) [1/s], shape (k,)."""
    fastest = np.abs(rates.first).max(axis=1) / np.asarray(limits.joint_speed)
    return np.minimum(speed, 1.0 / np.maximum(fastest.max(axis=1), 1e-300))


def second_time(speed: Array, first: Array, second: Array, limits: SmoothingLimits) -> Array:
    """T2 of eq. 25 [s], shape (k,); infinite where the denominator is not positive."""
    sd = speed[:, None, None]
    left = np.asarray(limits.joint_acceleration) - np.abs(second) * sd**2
    with np.errstate(divide="ignore"):
        needed = np.where(left > 0.0, np.abs(first) * sd / left, np.inf)
    return needed.max(axis=(1, 2))


plan = fir_rule(block_triples)
"""T1 >= |q'| / qd_max (eq. 18-20) and T2 >= |q'| sd / (qdd_max - |q''| sd^2) (eq. 25); see `fir_rule`."""
