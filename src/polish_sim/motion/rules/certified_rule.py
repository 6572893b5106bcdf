"""The rule ``certified``: short chords merged, corner kernels, fastest runs between them, a look-ahead."""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import SmoothingError
from polish_sim.motion.certified.smoother import Smoother, join_pieces
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.rule import Smoothed
from polish_sim.motion.rules.schedule import Schedule


def plan_certified(
    chain: Chain, limits: SmoothingLimits, tolerance: float, axis_tolerance: float, arm: Arm | None,
    feeds: Array | None = None,
) -> Smoothed:  # fmt: skip
    """Schedule a chain within all limits and tolerances, proven on intervals; arguments as of `Rule`.

    Returns the chain with short segments merged, its way points a part of the given ones, and its schedule.

    Raises:
        ReachError: A place out of reach or singular.
        SmoothingError: No motion was found within the limits.
    """
    smoother = Smoother(limits, tolerance, axis_tolerance, arm)
    caps = None if feeds is None else np.concatenate([[np.inf], feeds])
    pieces = join_pieces([smoother.feed(chain.tips, chain.rotations, caps), smoother.finish()])
    merged = build_chain(
        np.concatenate([chain.tips[:1], pieces.tips]), np.concatenate([chain.rotations[:1], pieces.rotations])
    )
    if not np.isfinite(smoother.time):
        raise SmoothingError("no motion was found within the limits: those of the joints are too tight for this path.")
    schedule = Schedule(pieces.segments, pieces.starts, pieces.durations, pieces.coefficients, smoother.time)
    return Smoothed(merged, schedule)
