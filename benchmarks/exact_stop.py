"""Stopping at every way point, as fast as can be: what every rule is measured against."""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.fir import fir_schedule, stop_times
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.paper_rules import ProgressLimits, filter_times, singular_segment
from polish_sim.motion.rules.schedule import Smoothed
from polish_sim.motion.segment_rates import JointRates

_ANY = 1e12
"""Stands for an infinite limit of the rate of progress [1/s, 1/s^2, 1/s^3]."""


def plan_exact_stop(
    chain: Chain,
    limits: SmoothingLimits,
    tolerance: float = 0.0,
    axis_tolerance: float = 0.0,
    arm: Arm | None = None,
    feeds: Array | None = None,
) -> Smoothed:
    """Pass every segment from rest to rest in the time-optimal three-box profile.

    Joint limits are shared out per segment with the largest |q'|, |q''|, |q'''| of its nodes: for speed V,
    acceleration A and jerk J of progress |q''| V^2 + |q'| A <= qdd_max, |q'''| V^3 + 3 |q''| V A + |q'| J <=
    qddd_max; of all such V, A, J those of least time are taken.

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
    triples = filter_times(chain, limits, arm, feeds, block_triples).triples
    ends = np.cumsum(triples.sum(axis=1))
    return Smoothed(chain, fir_schedule(np.concatenate([[0.0], ends])[: len(triples)], triples))


def block_triples(tool: ProgressLimits, rates: JointRates, limits: SmoothingLimits) -> Array:
    """Filter times of a block of segments, shape (k, 3)."""
    most = np.stack([np.abs(column).max(axis=1) for column in rates[1:]], axis=1)
    motions = np.minimum(np.stack(tool, axis=1), _ANY)
    joint = limits.table[:, 2:]
    for k, motion in enumerate(motions):
        motion[:] = _least_time(most[k], joint, motion)
        if not np.isfinite(motion).all():
            raise singular_segment(k)
    return stop_times(1.0, *motions.T)


def _least_time(most: Array, joint: Array, tool: Array) -> Array:
    """Speed, acceleration and jerk of progress (3,) of least time up to the tool's, by ever finer grids."""
    q1, q2, q3 = most
    best, reach = np.array([tool[0], min(tool[1], np.sqrt(tool[0] * tool[2]))]), 1e-4
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(12):
            V = np.minimum(best[0] * np.geomspace(reach, 1.0 / reach, 81), tool[0])[:, None, None]
            A = np.minimum(best[1] * np.geomspace(reach, 1.0 / reach, 81), tool[1])[:, None]
            J = np.minimum(((joint[2] - q3 * V**3 - 3.0 * q2 * V * A) / q1).min(axis=2), tool[2])
            kept = ((q1 * V <= joint[0]) & (q2 * V**2 + q1 * A <= joint[1])).all(axis=2) & (J > 0.0)
            V, A = np.broadcast_to(V[..., 0], kept.shape), np.broadcast_to(A[:, 0], kept.shape)
            time = np.where(
                kept,
                stop_times(1.0, *(np.where(kept, each, 1.0).ravel() for each in (V, A, J)))
                .sum(axis=1)
                .reshape(kept.shape),
                np.inf,
            )
            i = np.unravel_index(time.argmin(), time.shape)
            if not np.isfinite(time[i]):
                return np.full(3, np.nan)
            best, reach = np.array([V[i], A[i]]), reach**0.4
            found = np.array([V[i], A[i], J[i]])
    return found * (1.0 - 1e-9)
