"""The paper's way to a schedule: filter times by one rule for the joints, then neighbours overlapped in tolerance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.rules.fastest import BlockTriples, filter_times
from polish_sim.motion.rules.overlap import overlapped
from polish_sim.motion.rules.rule import Rule, Smoothed
from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.limits import SmoothingLimits

Array = NDArray[np.float64]


def fir_rule(block_triples: BlockTriples) -> Rule:
    """Make a smoothing rule of a rule for the joints' share of the filter times (paper 4, eq. 12-14 do the rest)."""

    def plan(
        chain: Chain,
        limits: SmoothingLimits,
        tolerance: float,
        axis_tolerance: float,
        arm: Arm | None,
        feeds: Array | None = None,
    ) -> Smoothed:
        triples = filter_times(chain, limits, arm, feeds, block_triples)
        return Smoothed(chain, overlapped(chain, triples, tolerance, axis_tolerance))

    return plan
