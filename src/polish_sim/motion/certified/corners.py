"""A corner as the window sees it: its kernel, and the states it may be passed in (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from polish_sim.motion.certified.buffers import ACCELERATION, DURATION, LEVELS, SIZE, SPEED, Corners, Segments
from polish_sim.motion.certified.connector import Ends, least_distance
from polish_sim.motion.certified.corner import (
    PIECES,
    CornerFigures,
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
        limits.axis_speed,
        limits.axis_acceleration,
        limits.axis_jerk,
        max(tolerances.axis - max(segments.used[k - 1, 1], segments.used[k, 1]), 0.0),
        min(old[0], new[0]),
        min(old[1], new[1]),
        min(old[2], new[2]),
    )


@njit(cache=True, error_model="numpy")
def lines_slowing(segments: Segments, k: int, figures: CornerFigures) -> float:
    """Factor on a kernel's times with which runs along both segments can begin and end at it, at least 1."""
    factor = 1.0
    for side in range(k - 1, k + 1):
        limits = line_limits(segments, side)
        if figures.acceleration > limits.acceleration:
            factor = max(factor, math.sqrt(figures.acceleration / limits.acceleration))
        peak = figures.speed / factor + 0.5 * figures.acceleration**2 / limits.jerk / factor**4
        # Both terms fall at least as the factor grows.
        factor *= max(peak / limits.speed, 1.0)
    return factor


@njit(cache=True, error_model="numpy")
def slow_down(corners: Corners, k: int, figures: CornerFigures, factor: float) -> CornerFigures:
    """Stretch the kernel of corner ``k`` in time.

    Args:
        corners: Changed at ``k``.
        k: The corner.
        figures: Of the kernel as it is.
        factor: On its times, at least 1.

    Returns:
        The figures then.
    """
    for p in range(PIECES):
        corners.durations[k, p] *= factor
        rate = 1.0
        for c in range(4):
            corners.remaining[k, p, c] *= rate
            corners.gone[k, p, c] *= rate
            rate /= factor
    return CornerFigures(
        figures.size, figures.speed / factor, figures.acceleration / factor**2, figures.duration * factor
    )


@njit(cache=True, error_model="numpy")
def lay_out_states(segments: Segments, corners: Corners, k: int, figures: CornerFigures) -> None:
    """Lay out the states of corner ``k``: its kernel at full size, smaller ones, an exact stop.

    Args:
        segments: Those on both sides are known.
        corners: Filled at ``k``.
        k: The corner.
        figures: Of its kernel.
    """
    corners.chosen[k] = -1
    largest = _largest_scale(segments, k, figures.size)
    roomy = largest == 1.0 and _is_roomy(segments, k - 1, figures) and _is_roomy(segments, k, figures)
    levels = 2 if roomy else LEVELS
    corners.levels[k] = levels
    for i in range(levels):
        scale = largest * i / (levels - 1)
        corners.scales[k, i] = scale
        corners.states[k, i, SIZE] = figures.size * scale**3
        corners.states[k, i, SPEED] = figures.speed * scale**2
        corners.states[k, i, ACCELERATION] = figures.acceleration * scale
        corners.states[k, i, DURATION] = figures.duration * scale


@njit(cache=True, error_model="numpy", forceinline=True)
def _largest_scale(segments: Segments, k: int, size: float) -> float:
    """Largest scale whose size both segments have room for."""
    room = min(segments.spans[k - 1], segments.spans[k])
    return 1.0 if size <= room else (room / size) ** (1.0 / 3.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def _is_roomy(segments: Segments, k: int, figures: CornerFigures) -> bool:
    """Whether half of segment ``k`` is enough for a corner and to stop before it: no smaller kernel is needed."""
    to_stop = least_distance(Ends(figures.speed, figures.acceleration, 0.0, 0.0), line_limits(segments, k))
    return 2.0 * (figures.size + to_stop) <= segments.spans[k]
