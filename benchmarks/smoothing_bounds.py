"""`python -m benchmarks.smoothing_bounds`: what proving joint limits costs, in time and in speed given away."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.random_paths import KINDS, draw_path
from benchmarks.table import Row, print_rows
from polish_sim.motion.certified.segment_limits import SegmentWork, segment_limits
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, LimitValues, SmoothingLimits, arm_or_none, chain_in_base, six
from polish_sim.motion.segment_rates import REACHED, Segment, chain_rates, chain_segment

Array = NDArray[np.float64]

REPEATS = 50
BINDING = SmoothingLimits(joint_speed=six(0.1), joint_acceleration=six(0.5), joint_jerk=six(10.0))
"""Such that the joints, not the tool, decide on most segments."""


class Proven(NamedTuple):
    """One segment."""

    scale: float
    """Generalised length [m]."""
    seconds: float
    """To prove its limits."""
    used: float
    """Largest share of a joint limit at dense samples, at the proven speed, acceleration and jerk."""
    binding: bool
    """Whether a joint limit lowered them."""


@njit(cache=True, error_model="numpy")
def _repeat(
    segment: Segment, scale: float, limits: LimitValues, arm: Arm, q: Array, motion: Array, work: SegmentWork, n: int
) -> int:
    status, near = REACHED, np.empty(6)
    for _ in range(n):
        near[:] = q
        status = segment_limits(segment, scale, limits, arm, near, motion, work)
    return status


def prove(chain: Chain, k: int, arm: Arm, limits: SmoothingLimits) -> Proven | None:
    """Prove segment k of a chain that begins at the arm's start; None if it cannot be."""
    tool, motion, work = np.zeros(6), np.zeros(6), SegmentWork()
    segment, ratio = chain_segment(chain_in_base(chain, arm), k), limits.tip_speed / limits.axis_speed
    scale = max(segment.length, segment.angle * ratio, abs(segment.roll) * ratio)
    arguments = (segment, scale, limits.values(), arm, arm.q_start, motion, work)
    if _repeat(*arguments, 1) != REACHED:
        return None
    began = time.process_time()
    _repeat(*arguments, REPEATS)
    seconds = (time.process_time() - began) / REPEATS
    segment_limits(segment, scale, limits.values(), arm_or_none(None), arm.q_start.copy(), tool, work)
    one = Chain(*(column[k : k + (2 if name in {"tips", "axes", "rotations"} else 1)]
                  for name, column in zip(Chain._fields, chain, strict=True)))  # fmt: skip
    return Proven(scale, seconds, _used(one, arm, scale, motion, limits), bool((motion < 0.999 * tool).any()))


def _used(chain: Chain, arm: Arm, scale: float, motion: Array, limits: SmoothingLimits) -> float:
    rates = chain_rates(chain, np.linspace(0.0, 1.0, 101), arm)
    q1, q2, q3 = (np.abs(rate[0]).max(axis=0) for rate in rates[1:])
    v, a, j = motion[:3] / scale
    shares = np.array([q1 * v, q2 * v * v + q1 * a, q3 * v**3 + 3.0 * q2 * v * a + q1 * j]) / limits.values().joint
    return float(shares.max())


def first_segments(count: int, wanted: Callable[[str], bool], limits: SmoothingLimits) -> list[Proven]:
    """The first segments of random paths of some kinds."""
    paths = (draw_path(np.random.default_rng([7, n]), n) for n in range(count) if wanted(KINDS[n % len(KINDS)]))
    proven = (prove(path.chain, 0, path.arm, limits) for path in paths)
    return [p for p in proven if p is not None]


def measure(count: int = 400) -> Iterable[Row]:
    """Time and tightness of the proofs."""
    near = {"wrist", "elbow"}
    away = first_segments(count, lambda kind: kind not in near, SmoothingLimits())
    for low, high, limit in ((0.0, 0.002, "20"), (0.002, 0.01, "20"), (0.01, 0.06, "-")):
        times = 1e6 * np.array([p.seconds for p in away if low <= p.scale < high])
        name = f"segment of {1e3 * low:g}-{1e3 * high:g} mm: median, 99% [us]"
        yield Row(name, f"{np.median(times):.1f}, {np.percentile(times, 99):.1f}", limit)
    times = 1e6 * np.array([p.seconds for p in first_segments(count, lambda kind: kind in near, SmoothingLimits())])
    yield Row("next to a singularity: median, largest [us]", f"{np.median(times):.1f}, {times.max():.0f}", "-")
    used = [p.used for p in first_segments(count, lambda kind: kind not in near, BINDING) if p.binding]
    yield Row(f"joint limit used, {len(used)} segments: least, median", f"{min(used):.4f}, {np.median(used):.4f}", "1")
    yield Row("largest", f"{max(used):.9f}", "1")


if __name__ == "__main__":
    print_rows("Joint limits proven on whole segments", measure())
