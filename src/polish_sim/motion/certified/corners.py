"""A corner as the window sees it: its kernel, and the states it may be passed in (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.certified.buffers import (
    ACCELERATION,
    DURATION,
    FULL_LEVELS,
    LEVELS,
    SIZE,
    SPEED,
    Corners,
    Lines,
    Segments,
)
from polish_sim.motion.certified.connector import Ends, LineLimits, least_distance
from polish_sim.motion.certified.corner import (
    PIECES,
    CornerFigures,
    CornerLimits,
    CornerWeights,
)
from polish_sim.motion.certified.window import line_limits
from polish_sim.motion.smoothing.limits import LimitValues

Array = NDArray[np.float64]


class Tolerances(NamedTuple):
    """How far the motion may be from the path."""

    tip: float
    """[m]."""
    axis: float
    """[rad]."""


@njit(cache=True, error_model="numpy")
def corner_weights(segments: Segments, k: int) -> CornerWeights:
    """What tip and axis do per generalised length on both sides of the corner before segment ``k``."""
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
def corner_limits(
    segments: Segments, k: int, limits: LimitValues, tolerances: Tolerances, old: LineLimits, new: LineLimits
) -> CornerLimits:
    """What may be done at the corner before segment ``k``, and what merging has left of the tolerances.

    Where the joints hold a segment back, tip and axis are held back as much at its corners: `corner_factor` then has
    little left to slow down.
    """
    first, second = _held_back(segments, k - 1, limits), _held_back(segments, k, limits)
    acceleration, jerk = min(first[0], second[0]), min(first[1], second[1])
    return CornerLimits(
        limits.tip_speed,
        limits.tip_acceleration * acceleration,
        limits.tip_jerk * jerk,
        max(tolerances.tip - max(segments.used[k - 1, 0], segments.used[k, 0]), 0.0),
        limits.axis_speed,
        limits.axis_acceleration * acceleration,
        limits.axis_jerk * jerk,
        max(tolerances.axis - max(segments.used[k - 1, 1], segments.used[k, 1]), 0.0),
        min(old.speed, new.speed),
        min(old.acceleration, new.acceleration),
        min(old.jerk, new.jerk),
    )


@njit(cache=True, error_model="numpy")
def _held_back(segments: Segments, k: int, limits: LimitValues) -> tuple[float, float]:
    """Shares of acceleration and jerk that the joints leave of what tip and axis allow along a segment."""
    row, span = segments.limits[k], segments.spans[k]
    tip, axis = segments.chain.lengths[k] / span, segments.chain.angles[k] / span
    acceleration, jerk = math.sqrt(row[0] * row[2]), math.inf
    if tip > 0.0:
        acceleration, jerk = min(acceleration, limits.tip_acceleration / tip), limits.tip_jerk / tip
    if axis > 0.0:
        acceleration, jerk = min(acceleration, limits.axis_acceleration / axis), min(jerk, limits.axis_jerk / axis)
    return min(row[1] / acceleration, 1.0), 1.0 if math.isinf(jerk) else min(row[2] / jerk, 1.0)


@njit(cache=True, error_model="numpy")
def lines_slowing(lines: Lines, k: int, figures: CornerFigures) -> float:
    """Factor on a kernel's times with which runs along both lines can begin and end at it, at least 1."""
    factor = 1.0
    for side in range(k - 1, k + 1):
        limits = line_limits(lines, side)
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
def shrunk(figures: CornerFigures, scale: float) -> CornerFigures:
    """Figures of a smaller kernel of the same kind, with the same jerk."""
    return CornerFigures(
        figures.size * scale**3, figures.speed * scale**2, figures.acceleration * scale, figures.duration * scale
    )


@njit(cache=True, error_model="numpy")
def shrink_to_room(lines: Lines, corners: Corners, k: int, figures: CornerFigures) -> CornerFigures:
    """Make the kernel of corner ``k`` as small as both lines have room for.

    Returns:
        Its figures then.
    """
    scale = room_scale(lines, k, figures.size)
    if scale == 1.0:
        return figures
    for p in range(PIECES):
        corners.durations[k, p] *= scale
        factor = scale**3
        for c in range(4):
            corners.remaining[k, p, c] *= factor
            corners.gone[k, p, c] *= factor
            factor /= scale
    return shrunk(figures, scale)


@njit(cache=True, error_model="numpy")
def lay_out_states(lines: Lines, corners: Corners, k: int, figures: CornerFigures, share: float) -> bool:
    """Lay out the states of corner ``k``: its kernel at full size, smaller ones, an exact stop.

    Args:
        lines: Those on both sides are known.
        corners: Filled at ``k``.
        k: The corner.
        figures: Of its kernel.
        share: Largest part of its size that the joints allow.

    Returns:
        Whether there is so much room that no smaller kernel is needed.
    """
    corners.chosen[k] = -1
    largest = room_scale(lines, k, figures.size) * share ** (1.0 / 3.0)
    roomy = largest == 1.0 and _is_roomy(lines, k - 1, figures) and _is_roomy(lines, k, figures)
    levels = 2 if roomy else FULL_LEVELS
    corners.levels[k] = levels
    for i in range(levels):
        scale = largest * i / (levels - 1)
        corners.scales[k, i] = scale
        _fill_state(corners.states[k, i], figures, scale)
    return roomy


@njit(cache=True, error_model="numpy")
def lay_out_plain(lines: Lines, corners: Corners, k: int, figures: CornerFigures, share: float) -> None:
    """Add the states of the plain kernel of corner ``k``; their scales are negative."""
    largest = room_scale(lines, k, figures.size) * share ** (1.0 / 3.0)
    count = LEVELS - FULL_LEVELS
    for i in range(count):
        scale = largest * (i + 1) / count
        corners.scales[k, FULL_LEVELS + i] = -scale
        _fill_state(corners.states[k, FULL_LEVELS + i], figures, scale)
    corners.levels[k] = LEVELS


@njit(cache=True, error_model="numpy")
def _fill_state(state: Array, figures: CornerFigures, scale: float) -> None:
    state[SIZE] = figures.size * scale**3
    state[SPEED] = figures.speed * scale**2
    state[ACCELERATION] = figures.acceleration * scale
    state[DURATION] = figures.duration * scale


@njit(cache=True, error_model="numpy")
def room_scale(lines: Lines, k: int, size: float) -> float:
    """Largest scale whose size both lines have room for."""
    room = min(lines.rooms[k - 1, 1], lines.rooms[k, 0])
    return 1.0 if size <= room else (room / size) ** (1.0 / 3.0)


@njit(cache=True, error_model="numpy")
def _is_roomy(lines: Lines, k: int, figures: CornerFigures) -> bool:
    """Whether half of line ``k`` is enough for a corner and to stop before it: no smaller kernel is needed."""
    to_stop = least_distance(Ends(figures.speed, figures.acceleration, 0.0, 0.0), line_limits(lines, k))
    return 2.0 * (figures.size + to_stop) <= lines.spans[k]
