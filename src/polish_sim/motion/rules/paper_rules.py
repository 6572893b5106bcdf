"""The paper's way to a schedule: filter times by one rule for the joints, then neighbours overlapped in
tolerance."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, dots, running_sums
from polish_sim.errors import SmoothingError
from polish_sim.motion.rules.chain import Chain, part_of
from polish_sim.motion.rules.fir import corner_overlap, corner_speed, fir_schedule, stop_times
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.motion.rules.schedule import Schedule, Smoothed
from polish_sim.motion.segment_rates import JointRates, chain_rates, chebyshev_nodes

#: Progress at which joint derivatives are taken; the paper takes forward differences
NODES = chebyshev_nodes(9)
BLOCK = 4096  #: Segments whose joint derivatives are in memory at once


class ProgressLimits(NamedTuple):
    """Largest rates of progress of n segments that tool (and feed) allow."""

    speed: Array  #: [1/s], shape (n,)
    acceleration: Array  #: [1/s^2], shape (n,)
    jerk: Array  #: [1/s^3], shape (n,)


def tool_limits(chain: Chain, limits: SmoothingLimits, feeds: Array | None) -> ProgressLimits:
    """Tip and axis share one progress: the smaller limit counts (paper 4, eq. 5, 9)."""
    tip, axis = limits.table[:, :2, None].swapaxes(0, 1)
    with np.errstate(divide="ignore"):
        most = np.minimum(tip / chain.lengths, axis / chain.angles)
        if feeds is not None:
            most[0] = np.minimum(most[0], feeds / chain.lengths)
    return ProgressLimits(*most)


TriplesAt = Callable[[Array, Indices], Array]
"""(speed (k,) [1/s], segments (k,)) -> filter times (k, 3) [s], the first at least the sum of the others;
infinite where the joints' curvature alone takes up a limit at that speed."""

BlockTriples = Callable[[ProgressLimits, JointRates, SmoothingLimits], Array]
"""(tool's limits, joint derivatives (k, nodes, 6), limits) -> filter times of k segments (k, 3) [s]."""

_SLOWEST = 1e4  # times slower than the limit
_COARSE, _FINE = 40, 12
_GAINING = np.where(NODES < 0.5, 1.0, -1.0)[:, None]
"""Sign of the acceleration of progress at the nodes: speed is gained in the first half, lost in the
second."""


class Timed(NamedTuple):
    """Every segment of a chain from rest to rest."""

    triples: Array  #: Filter times T1, T2, T3 [s], shape (n, 3)
    q: Array  #: Joint angles at the way points [rad], 0 without an arm, shape (n + 1, 6)


def filter_times(
    chain: Chain, limits: SmoothingLimits, arm: Arm | None, feeds: Array | None, block_triples: BlockTriples
) -> Timed:
    """Filter times of every segment by a rule for the joints' share; arguments as of `Rule`.

    Raises:
        ReachError: A place out of reach or singular.
        SmoothingError: No speed keeps the joint limits, or no limit is finite.
    """
    tool = tool_limits(chain, limits, feeds)
    n = len(chain.lengths)
    triples, q = stop_times(1.0, *tool), np.zeros((n + 1, 6))
    if arm is not None:
        for begin in range(0, n, BLOCK):
            rows = slice(begin, min(begin + BLOCK, n))
            rates = chain_rates(part_of(chain, rows), NODES, arm)
            arm = arm._replace(q_start=rates.q[-1, -1])
            triples[rows] = block_triples(ProgressLimits(*(column[rows] for column in tool)), rates, limits)
            q[rows], q[rows.stop] = rates.q[:, 0], rates.q[-1, -1]
    if not np.all(triples.max(axis=1, initial=0.0) > 0.0):
        k = int(np.argmin(triples.max(axis=1)))
        raise SmoothingError(
            f"nothing limits the motion along segment {k + 1}: give a speed, acceleration or jerk."
        )
    return Timed(triples, q)


def fastest_triples(speed: Array, triples_at: TriplesAt) -> Array:
    """Filter times of every segment at full speed, or at the lower speed that takes least time [s], shape (n,
    3).

    Full speed (n,) [1/s] is kept where it is reached (the paper's case). Where the segment is too short for
    it, or a denominator of eq. 24, 25, 30 is not positive at it (the paper's absolute value hides that),
    slower ones are searched.

    Raises:
        SmoothingError: No speed keeps the limits.
    """
    everything = np.arange(len(speed))
    triples = triples_at(speed, everything)
    rows = np.flatnonzero(~(triples[:, 0] * speed <= 1.0 + 1e-12))
    if len(rows) == 0:
        return triples
    low, high = speed[rows] / _SLOWEST, speed[rows]
    for count in (_COARSE, _FINE, _FINE):
        grid = high * (low / high) ** np.linspace(0.0, 1.0, count)[:, None]
        # No more at once than a block of segments.
        parts = np.array_split(grid, min(count, 1 + grid.size // BLOCK))
        times = np.concatenate(
            [
                triples_at(part.ravel(), np.tile(rows, len(part))).sum(axis=1).reshape(part.shape)
                for part in parts
            ]
        )
        best = times.argmin(axis=0)
        columns = np.arange(len(rows))
        high, low = grid[np.maximum(best - 1, 0), columns], grid[np.minimum(best + 1, count - 1), columns]
    triples[rows] = triples_at(grid[best, columns], rows)
    if not np.isfinite(triples).all():
        raise singular_segment(int(np.argmin(np.isfinite(triples).all(axis=1))))
    return triples


def singular_segment(k: int) -> SmoothingError:
    """Build the error for segment ``k``, on which no speed keeps the joints' limits."""
    return SmoothingError(f"no speed keeps the joint limits in segment {k + 1}: too near a singularity.")


# From filter times to a schedule: neighbours overlap as far as the tolerances let them (paper 4, eq. 12-14).


def overlapped(chain: Chain, triples: Array, tolerance: float, axis_tolerance: float) -> Schedule:
    """Let each segment begin before the last one has ended, as far as the tolerances of tip and axis allow.

    No more than two are under way at once: a corner takes at most half of each neighbour's time. A tolerance
    of 0 stops at each way point.
    """
    c, b, a = np.sort(triples, axis=1).T
    halves, found = 0.5 * (a + b + c), []
    for size, ways, most in (
        (chain.lengths, chain.directions, tolerance),
        (chain.angles, chain.turn_axes, axis_tolerance),
    ):
        speed = size / a
        change = corner_speed(speed[:-1], speed[1:], dots(ways[:-1], ways[1:]))
        found.append(corner_overlap(most, change, b[:-1], c[:-1], b[1:], c[1:]))
    overlaps = np.min([*found, halves[:-1], halves[1:]], axis=0)
    starts = running_sums(triples.sum(axis=1)[:-1] - overlaps)[: len(triples)]
    return fir_schedule(starts, triples)


def fir_rule(
    block_triples: BlockTriples,
    chain: Chain,
    limits: SmoothingLimits,
    tolerance: float,
    axis_tolerance: float,
    arm: Arm | None,
    feeds: Array | None = None,
) -> Smoothed:
    """A smoothing rule by a rule for the joints' share of the filter times (paper 4, eq. 12-14 do the
    rest)."""
    triples = filter_times(chain, limits, arm, feeds, block_triples).triples
    return Smoothed(chain, overlapped(chain, triples, tolerance, axis_tolerance))


def block_triples(
    tool: ProgressLimits,
    rates: JointRates,
    limits: SmoothingLimits,
    jerk_share: float = 0.0,
    signed: bool = False,
) -> Array:
    """Filter times of a block of k segments by one of the paper's rules [s], shape (k, 3).

    ``rates`` are joint derivatives (k, nodes, 6). Acceleration is limited by eq. 24 if ``signed``, else by
    eq. 25; jerk by a share of the joints' limits (eq. 30), with a share of 0 not at all.
    """

    def triples_at(speed: Array, rows: Indices) -> Array:
        part = JointRates(*(column[rows] for column in rates))
        base = stop_times(1.0, speed, tool.acceleration[rows], tool.jerk[rows])
        t2 = np.maximum(base[:, 1], second_time(speed, part, limits, signed))
        t3 = base[:, 2]
        if jerk_share > 0.0:
            t3 = np.maximum(
                t3, third_time(speed, speed / t2, part, jerk_share * np.asarray(limits.joint_jerk))
            )
        return np.stack([np.maximum(1.0 / speed, t2 + t3), t2, t3], axis=1)

    # No joint is too fast either (eq. 18-20).
    fastest = (np.abs(rates.first).max(axis=1) / np.asarray(limits.joint_speed)).max(axis=1)
    return fastest_triples(np.minimum(tool.speed, 1.0 / np.maximum(fastest, 1e-300)), triples_at)


def second_time(speed: Array, rates: JointRates, limits: SmoothingLimits, signed: bool) -> Array:
    """T2 of eq. 25 [s], shape (k,), or of eq. 24, with the ``signed`` curvature of the motion, so never more.

    Infinite where the denominator is not positive.
    """
    sd = speed[:, None, None]
    most = np.asarray(limits.joint_acceleration)
    cruising = most - np.abs(rates.second) * sd**2
    left = most - np.sign(rates.first * _GAINING) * rates.second * sd**2 if signed else cruising
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where((left > 0.0) & (cruising > 0.0), np.abs(rates.first) * sd / left, np.inf)
    return needed.max(axis=(1, 2))


def third_time(speed: Array, acceleration: Array, rates: JointRates, most: Array) -> Array:
    """T3 of eq. 30 [s], shape (k,), within joint jerks (6,); infinite where the denominator is not positive.

    The jerk due to curvature counts with both signs, as jerk has both in either half.
    """
    sd, sdd = speed[:, None, None], acceleration[:, None, None]
    bent = np.abs(rates.third * sd**3 + 3.0 * rates.second * _GAINING * sd * sdd)
    left = most - bent
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.where(left > 0.0, np.abs(rates.first) * sdd / left, np.inf)
    return needed.max(axis=(1, 2))


plan_joint_acceleration = partial(fir_rule, block_triples)
"""The method paper 4 compares with ([18] there): eq. 18-20 for T1, 25 for T2; joint jerk is not limited."""
plan_joint_jerk = partial(fir_rule, partial(block_triples, jerk_share=0.5, signed=True))
"""Paper 4's rule: eq. 18-20, 24, 30, the limit of jerk halved for corners."""


def plan_stops(chain: Chain, limits: SmoothingLimits, arm: Arm | None, feeds: Array | None) -> Timed:
    """The fastest three boxes for every segment; joint limits are kept at `NODES`. Errors as of
    `filter_times`."""
    return filter_times(chain, limits, arm, feeds, partial(block_triples, jerk_share=1.0))
