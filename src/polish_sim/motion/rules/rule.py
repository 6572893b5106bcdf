"""The interface of smoothing rules, and limits and joint derivatives by a segment's progress that they share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, build_arm
from polish_sim.motion.rules.schedule import Smoothed
from polish_sim.motion.segment_rates import JointRates, chain_rates, chebyshev_nodes

Rule = Callable[[Chain, SmoothingLimits, float, float, Arm | None, Array | None], Smoothed]
"""Plans the motion along a chain, within limits of tool and joints and tolerances of tip [m] and tool axis [rad].

The rule says of which distance of the tip. An arm of None leaves the joints out. Last come the tip's largest speeds on
the segments [m/s], shape (n,), infinite where there is none; None for no such limits. Raises a ReachError for a place
out of reach or singular, a SmoothingError if no speed keeps the joint limits."""

RULES: Mapping[str, Rule] = {
    "certified": FunctionOnUse("polish_sim.motion.certified.smoother", "plan_certified"),
    "joint-jerk": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_jerk"),
    "joint-acceleration": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_acceleration"),
}

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
        arm = build_arm(arm.T_base_work, arm.T_flange_tool, rates.q[-1, -1])
        yield rows, rates


def part_of(chain: Chain, rows: slice) -> Chain:
    """Some neighbouring segments of a chain."""
    points = slice(rows.start, rows.stop + 1)
    return Chain(*(array[points] for array in chain[:3]), *(array[rows] for array in chain[3:]))
