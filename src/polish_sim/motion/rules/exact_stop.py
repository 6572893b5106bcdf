"""Stopping at every way point, as fast as can be: what every rule is measured against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.rules.fastest import fastest_triples, filter_times, stop_triples
from polish_sim.motion.rules.joint_acceleration import capped_speed
from polish_sim.motion.rules.progress_limits import ProgressLimits
from polish_sim.motion.rules.rule import Smoothed
from polish_sim.motion.segment_rates import JointRates
from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.fir import fir_schedule
from polish_sim.motion.smoothing.limits import SmoothingLimits

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def plan(
    chain: Chain,
    limits: SmoothingLimits,
    tolerance: float = 0.0,
    axis_tolerance: float = 0.0,
    arm: Arm | None = None,
    feeds: Array | None = None,
) -> Smoothed:
    """Pass every segment from rest to rest in the time-optimal three-box profile.

    Joint limits are shared out per segment with the largest |q'|, |q''|, |q'''| of its nodes: for a speed V of progress
    A = (qdd_max - |q''| V^2) / |q'|, J = (qddd_max - |q'''| V^3 - 3 |q''| V A) / |q'|; V is the one of least time.

    Args:
        chain: The segments.
        limits: Of tool and joints.
        tolerance: Not needed: nothing strays.
        axis_tolerance: Likewise.
        arm: None leaves the joints out.
        feeds: Speed limits of the tip per segment [m/s], shape (n,), or None.

    Returns:
        The chain and its schedule.
    """
    triples = filter_times(chain, limits, arm, feeds, block_triples)
    ends = np.cumsum(triples.sum(axis=1))
    return Smoothed(chain, fir_schedule(np.concatenate([[0.0], ends])[: len(triples)], triples))


def block_triples(tool: ProgressLimits, rates: JointRates, limits: SmoothingLimits) -> Array:
    """Filter times of a block of segments, shape (k, 3)."""
    first, second, third = (np.abs(column).max(axis=1) for column in rates[1:])

    def triples_at(speed: Array, rows: Indices) -> Array:
        sd, share = speed[:, None], np.maximum(first[rows], 1e-300)
        left = np.asarray(limits.joint_acceleration) - second[rows] * sd**2
        acceleration = np.minimum(tool.acceleration[rows], (left / share).min(axis=1))[:, None]
        bent = third[rows] * sd**3 + 3.0 * second[rows] * sd * np.maximum(acceleration, 0.0)
        left_jerk = np.asarray(limits.joint_jerk) - bent
        jerk = np.minimum(tool.jerk[rows], (left_jerk / share).min(axis=1))
        possible = (left.min(axis=1) > 0.0) & (left_jerk.min(axis=1) > 0.0)
        triples = np.full((len(rows), 3), np.inf)
        triples[possible] = stop_triples(speed[possible], acceleration[possible, 0], jerk[possible])
        return triples

    return fastest_triples(capped_speed(tool.speed, rates, limits), triples_at)
