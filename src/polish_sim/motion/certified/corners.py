"""A corner as the window sees it: its kernel, and the states it may be passed in (layer 6)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import ACCELERATION, DURATION, SIZE, SPEED, Corners, Lines, Segments
from polish_sim.motion.certified.connector import Ends, LineLimits, least_distance
from polish_sim.motion.certified.corner_parts import Kernel
from polish_sim.motion.certified.corner_task import CornerFigures, CornerLimits, CornerWeights
from polish_sim.motion.certified.window import line_limits
from polish_sim.motion.rules.limits import LimitValues

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
        (segments.spans[old], segments.spans[new]),
    )


@njit(cache=True, error_model="numpy")
def corner_limits(
    segments: Segments, k: int, limits: LimitValues, tolerances: Tolerances, old: LineLimits, new: LineLimits
) -> CornerLimits:
    """What may be done at the corner before segment ``k``, and what merging has left of the tolerances.

    Where the joints hold a segment back, tip and axis are held back as much at its corners: there is then little left
    to slow down.
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
def kernel_of(corners: Corners, k: int) -> Kernel:
    """The full kernel of corner ``k``."""
    return Kernel(corners.durations[k], corners.remaining[k], corners.gone[k])


@njit(cache=True, error_model="numpy")
def scaled_figures(figures: CornerFigures, scale: float, slowdown: float) -> CornerFigures:
    """Figures of a smaller, slower kernel of the same kind, see `copy_scaled`."""
    return CornerFigures(
        figures.size * scale**3,
        figures.speed * scale**2 / slowdown,
        figures.acceleration * scale / slowdown**2,
        figures.duration * scale * slowdown,
    )


@njit(cache=True, error_model="numpy")
def set_state(corners: Corners, k: int, i: int, figures: CornerFigures) -> None:
    """Write one state of a corner."""
    state = corners.states[k, i]
    state[SIZE], state[SPEED] = figures.size, figures.speed
    state[ACCELERATION], state[DURATION] = figures.acceleration, figures.duration


@njit(cache=True, error_model="numpy")
def is_roomy(lines: Lines, k: int, figures: CornerFigures) -> bool:
    """Whether both lines have so much room that no smaller kernel is needed."""
    whole = room_scale(lines, k, figures.size) == 1.0
    return whole and _is_roomy(lines, k - 1, figures) and _is_roomy(lines, k, figures)


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
