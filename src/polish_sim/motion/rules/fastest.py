"""Filter times of every segment, by one rule for the joints: at full speed, or the lower one that takes least time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import SmoothingError
from polish_sim.motion.rules.progress_limits import ProgressLimits, rate_blocks, tool_limits
from polish_sim.motion.segment_rates import JointRates
from polish_sim.motion.smoothing.arm import Arm
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.limits import SmoothingLimits

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TriplesAt = Callable[[Array, Indices], Array]
"""(speed (k,) [1/s], segments (k,)) -> filter times (k, 3) [s], the first at least the sum of the others; infinite
where the joints' curvature alone takes up a limit at that speed."""

BlockTriples = Callable[[ProgressLimits, JointRates, SmoothingLimits], Array]
"""(tool's limits, joint derivatives (k, nodes, 6), limits) -> filter times of k segments (k, 3) [s]."""

_SLOWEST = 1e4  # times slower than the limit
_COARSE, _FINE = 40, 12


def filter_times(
    chain: Chain, limits: SmoothingLimits, arm: Arm | None, feeds: Array | None, block_triples: BlockTriples
) -> Array:
    """T1, T2, T3 of every segment.

    Args:
        chain: The segments.
        limits: Of tool and joints.
        arm: None leaves the joints out.
        feeds: Speed limits of the tip per segment [m/s], shape (n,), or None.
        block_triples: The rule for the joints.

    Returns:
        [s], shape (n, 3).

    Raises:
        ReachError: A place out of reach or singular.
        SmoothingError: No speed keeps the joint limits, or no limit is finite.
    """
    tool = tool_limits(chain, limits, feeds)
    triples = stop_triples(*tool)
    if arm is not None:
        for rows, rates in rate_blocks(chain, arm):
            triples[rows] = block_triples(ProgressLimits(*(column[rows] for column in tool)), rates, limits)
    if not np.all(triples.max(axis=1, initial=0.0) > 0.0):
        k = int(np.argmin(triples.max(axis=1)))
        raise SmoothingError(f"nothing limits the motion along segment {k + 1}: give a speed, acceleration or jerk.")
    return triples


def fastest_triples(speed: Array, triples_at: TriplesAt) -> Array:
    """Filter times of every segment at full speed, or at the lower speed that takes least time.

    Full speed is kept where it is reached (the paper's case). Where the segment is too short for it, or a denominator
    of eq. 24, 25, 30 is not positive at it (the paper's absolute value hides that), slower ones are searched.

    Args:
        speed: Largest rate of progress [1/s], shape (n,).
        triples_at: Filter times at a speed.

    Returns:
        T1 >= T2 + T3 [s], shape (n, 3).

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
        times = np.stack([triples_at(row, rows).sum(axis=1) for row in grid])
        best = np.argmin(times, axis=0)
        columns = np.arange(len(rows))
        high, low = grid[np.maximum(best - 1, 0), columns], grid[np.minimum(best + 1, count - 1), columns]
    triples[rows] = triples_at(grid[best, columns], rows)
    if not np.isfinite(triples).all():
        raise singular_segment(int(np.argmin(np.isfinite(triples).all(axis=1))))
    return triples


def singular_segment(k: int) -> SmoothingError:
    """Build the error for segment ``k``, on which no speed keeps the joints' limits."""
    return SmoothingError(f"no speed keeps the joint limits in segment {k + 1}: too near a singularity.")


def stop_triples(speed: Array, acceleration: Array, jerk: Array) -> Array:
    """Times of the fastest rest-to-rest motion of length 1 (`stop_times`), shape (n, 3)."""
    with np.errstate(invalid="ignore", over="ignore"):
        finite = np.isfinite(jerk)
        ramp = np.where(finite, acceleration / jerk, 0.0)
        c = np.where(finite, np.minimum(ramp, np.minimum(np.sqrt(speed / jerk), np.cbrt(0.5 / jerk))), 0.0)
        held = np.minimum(speed / acceleration, 0.5 * (np.sqrt(c * c + 4.0 / acceleration) - c))
        b = np.where(c == ramp, np.maximum(c, held), c)
    return np.stack([np.maximum(1.0 / speed, b + c), b, c], axis=1)
