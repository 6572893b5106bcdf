"""A corner as the window sees it: its kernel, and the states it may be passed in (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from polish_sim.motion.certified.buffers import ACCELERATION, DURATION, LEVELS, SIZE, SPEED, Corners, Segments
from polish_sim.motion.certified.connector import Ends, LineLimits, least_distance
from polish_sim.motion.certified.corner import (
    PIECES,
    CornerKernel,
    CornerLimits,
    CornerWeights,
)
from polish_sim.motion.certified.window import line_limits
from polish_sim.motion.smoothing.limits import LimitValues


class Tolerances(NamedTuple):
    """How far the motion may be from the path."""

    tip: float
    """[m]."""
    axis: float
    """[rad]."""


@njit(cache=True, error_model="numpy")
def corner_weights(segments: Segments, k: int) -> CornerWeights:
    """What tip and axis do per generalised length on both sides of corner ``k``."""
    chain, old, new = segments.chain, k - 1, k
    tip_old, tip_new = chain.lengths[old] / segments.spans[old], chain.lengths[new] / segments.spans[new]
    along = cosine = 0.0
    for i in range(3):
        along += chain.directions[old, i] * chain.directions[new, i]
        cosine += chain.turn_axes[old, i] * chain.turn_axes[new, i]
    return CornerWeights(
        tip_old * tip_old,
        tip_new * tip_new,
        along * tip_old * tip_new,
        chain.angles[old] / segments.spans[old],
        chain.angles[new] / segments.spans[new],
        cosine,
    )


@njit(cache=True, error_model="numpy")
def corner_limits(segments: Segments, k: int, limits: LimitValues, tolerances: Tolerances) -> CornerLimits:
    """What the kernel of corner ``k`` may do, and what merging has left of the tolerances."""
    old, new = segments.limits[k - 1], segments.limits[k]
    return CornerLimits(
        limits.tip_speed,
        limits.tip_acceleration,
        limits.tip_jerk,
        max(tolerances.tip - max(segments.used[k - 1, 0], segments.used[k, 0]), 0.0),
        max(tolerances.axis - max(segments.used[k - 1, 1], segments.used[k, 1]), 0.0),
        min(old[0], new[0]),
        min(old[1], new[1]),
        min(old[2], new[2]),
    )


@njit(cache=True, error_model="numpy")
def add_corner(segments: Segments, corners: Corners, k: int, kernel: CornerKernel, slowed: float) -> None:
    """Keep the kernel of corner ``k``, slowed in time, and lay out its states.

    Args:
        segments: Those on both sides are known.
        corners: Filled at ``k``.
        k: The corner.
        kernel: At full size.
        slowed: Factor on its times, at least 1.
    """
    for p in range(PIECES):
        corners.durations[k, p] = kernel.durations[p] * slowed
        rate = 1.0
        for c in range(4):
            corners.remaining[k, p, c] = kernel.remaining[p, c] * rate
            corners.gone[k, p, c] = kernel.gone[p, c] * rate
            rate /= slowed
    corners.chosen[k] = -1
    largest = _largest_scale(segments, k, kernel.size)
    state = (kernel.size, kernel.speed / slowed, kernel.acceleration / slowed**2, kernel.duration * slowed)
    roomy = largest == 1.0 and _is_roomy(segments, k - 1, state) and _is_roomy(segments, k, state)
    levels = 2 if roomy else LEVELS
    corners.levels[k] = levels
    for i in range(levels):
        scale = largest * i / (levels - 1)
        corners.scales[k, i] = scale
        corners.states[k, i, SIZE] = state[0] * scale**3
        corners.states[k, i, SPEED] = state[1] * scale**2
        corners.states[k, i, ACCELERATION] = state[2] * scale
        corners.states[k, i, DURATION] = state[3] * scale


@njit(cache=True, error_model="numpy", forceinline=True)
def _largest_scale(segments: Segments, k: int, size: float) -> float:
    """Largest scale whose size both segments have room for."""
    room = min(segments.spans[k - 1], segments.spans[k])
    return 1.0 if size <= room else (room / size) ** (1.0 / 3.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def _is_roomy(segments: Segments, k: int, state: tuple[float, float, float, float]) -> bool:
    """Whether half of segment ``k`` is enough for a corner and to stop before it: no smaller kernel is needed."""
    limits = line_limits(segments, k)
    fit = LineLimits(limits.speed, limits.acceleration, limits.jerk)
    return 2.0 * (state[0] + least_distance(Ends(state[1], state[2], 0.0, 0.0), fit)) <= segments.spans[k]
