"""The rule `joint-jerk`: paper 4's own, joint jerk kept by the third filter, its limit halved for the corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.rules.fastest import fastest_triples, stop_triples
from polish_sim.motion.rules.fir_rule import fir_rule
from polish_sim.motion.rules.joint_acceleration import capped_speed
from polish_sim.motion.rules.progress_limits import NODES, ProgressLimits
from polish_sim.motion.segment_rates import JointRates
from polish_sim.motion.smoothing.limits import SmoothingLimits

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_GAINING = np.where(NODES < 0.5, 1.0, -1.0)[:, None]
"""Sign of the acceleration of progress at the nodes: speed is gained in the first half, lost in the second."""


def block_triples(tool: ProgressLimits, rates: JointRates, limits: SmoothingLimits) -> Array:
    """Filter times of a block of segments, shape (k, 3)."""

    def triples_at(speed: Array, rows: Indices) -> Array:
        part = JointRates(*(column[rows] for column in rates))
        base = stop_triples(speed, tool.acceleration[rows], tool.jerk[rows])
        t2 = np.maximum(base[:, 1], second_time(speed, part, limits))
        t3 = np.maximum(base[:, 2], third_time(speed, speed / t2, part, limits))
        return np.stack([np.maximum(1.0 / speed, t2 + t3), t2, t3], axis=1)

    return fastest_triples(capped_speed(tool.speed, rates, limits), triples_at)


def second_time(speed: Array, rates: JointRates, limits: SmoothingLimits) -> Array:
    """T2 of eq. 24 [s], shape (k,); infinite where a denominator is not positive."""
    sd = speed[:, None, None]
    left = np.asarray(limits.joint_acceleration) - np.sign(rates.first * _GAINING) * rates.second * sd**2
    cruising = np.asarray(limits.joint_acceleration) - np.abs(rates.second) * sd**2
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where((left > 0.0) & (cruising > 0.0), np.abs(rates.first) * sd / left, np.inf)
    return needed.max(axis=(1, 2))


def third_time(speed: Array, acceleration: Array, rates: JointRates, limits: SmoothingLimits) -> Array:
    """T3 of eq. 30 [s], shape (k,); infinite where the denominator is not positive."""
    sd, sdd = speed[:, None, None], acceleration[:, None, None]
    bent = np.abs(rates.third * sd**3 + 3.0 * rates.second * _GAINING * sd * sdd)
    left = 0.5 * np.asarray(limits.joint_jerk) - bent
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(left > 0.0, np.abs(rates.first) * sdd / left, np.inf)
    return needed.max(axis=(1, 2))


plan = fir_rule(block_triples)
"""Eq. 18-20 for T1, 24 for T2 and 30 for T3; see `fir_rule`.

``|q'| sd / |qdd_max -+ q'' sd^2|`` is taken with the sign the motion has (eq. 24, never more than eq. 25);
``|q'| sdd / |qddd_max / 2 -+ (q''' sd^3 + 3 q'' sd sdd)|`` with both, as jerk has both in either half.
A denominator that is not positive asks for a lower speed.
"""
