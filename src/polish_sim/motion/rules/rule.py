"""The interface of smoothing rules, and limits and joint derivatives by a segment's progress that they share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol

import numpy as np

from polish_sim.arrays import Array
from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import Schedule
from polish_sim.motion.segment_rates import JointRates, chain_rates, chebyshev_nodes


class Smoothed(NamedTuple):
    """The segments passed, the given ones or fewer where the rule joins short ones, and when they are passed."""

    chain: Chain
    schedule: Schedule


class Rule(Protocol):
    """A smoothing rule."""

    def __call__(
        self,
        chain: Chain,
        limits: SmoothingLimits,
        tolerance: float,
        axis_tolerance: float,
        arm: Arm | None,
        feeds: Array | None = None,
    ) -> Smoothed:
        """Plan the motion along a chain.

        Args:
            chain: The segments.
            limits: Of tool and joints.
            tolerance: Of the tip [m]; the rule says of which distance.
            axis_tolerance: Of the tool axis [rad].
            arm: None leaves the joints out.
            feeds: Speed limits of the tip per segment [m/s], shape (n,), infinity where there is none; or None.

        Returns:
            The chain and its schedule.

        Raises:
            ReachError: A place out of reach or singular.
            SmoothingError: No speed keeps the joint limits.
        """
        ...


RULES: Mapping[str, Rule] = {
    "certified": FunctionOnUse("polish_sim.motion.rules.certified_rule", "plan_certified"),
    "joint-jerk": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_jerk"),
    "joint-acceleration": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_acceleration"),
}
"""Name -> plan function."""

NODES = chebyshev_nodes(9)  #: Progress at which joint derivatives are taken; the paper takes forward differences
BLOCK = 4096  #: Segments whose joint derivatives are in memory at once


class ProgressLimits(NamedTuple):
    """Largest rates of progress of n segments that tool (and feed) allow."""

    speed: Array  #: [1/s], shape (n,)
    acceleration: Array  #: [1/s^2], shape (n,)
    jerk: Array  #: [1/s^3], shape (n,)


def tool_limits(chain: Chain, limits: SmoothingLimits, feeds: Array | None) -> ProgressLimits:
    """Tip and axis share one progress: the smaller limit counts (paper 4, eq. 5, 9)."""
    feed = np.full(len(chain.lengths), np.inf) if feeds is None else np.asarray(feeds, dtype=float)
    with np.errstate(divide="ignore"):
        return ProgressLimits(
            np.minimum(np.minimum(limits.tip_speed, feed) / chain.lengths, limits.axis_speed / chain.angles),
            np.minimum(limits.tip_acceleration / chain.lengths, limits.axis_acceleration / chain.angles),
            np.minimum(limits.tip_jerk / chain.lengths, limits.axis_jerk / chain.angles),
        )


def rate_blocks(chain: Chain, arm: Arm) -> Iterator[tuple[slice, JointRates]]:
    """Joint derivatives by progress at `NODES`, arrays (k, nodes, 6), for ``BLOCK`` segments at a time."""
    for begin in range(0, len(chain.lengths), BLOCK):
        rows = slice(begin, min(begin + BLOCK, len(chain.lengths)))
        rates = chain_rates(part_of(chain, rows), NODES, arm)
        arm = arm._replace(q_start=rates.q[-1, -1].copy())
        yield rows, rates


def part_of(chain: Chain, rows: slice) -> Chain:
    """Some neighbouring segments of a chain."""
    points = slice(rows.start, rows.stop + 1)
    return Chain(*(array[points] for array in chain[:3]), *(array[rows] for array in chain[3:]))
