"""Fewer points for the same line: robots and viewers need no more than its shape asks for (ToolPath -> rows)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.planning.toolpath import ToolPath

Array = NDArray[np.float64]

AIR_CHORD_M, AIR_AXIS_RAD = 1e-6, 1e-4
"""A left-out point in the air lies this close to the straight move, its tool axis to those at both ends."""
NOTICED = 0.02
"""Relative change of force or feed that is passed on."""


def needed_rows(path: ToolPath, chord_m: float, axis_rad: float, longest_m: float) -> NDArray[np.int64]:
    """Rows that must stay so that straight moves between them keep to the path.

    Ends of segments and points where force or feed change by some 2% always stay.

    Args:
        path: The path.
        chord_m: Largest distance of a left-out point from the straight move [m].
        axis_rad: Largest angle between a left-out tool axis and those at both ends of its move [rad].
        longest_m: Longest straight move over left-out points [m].

    Returns:
        Row numbers, increasing, shape (k,).
    """
    fixed = np.zeros(len(path.s), dtype=np.bool_)
    fixed[[0, -1]] = True
    wishes = [column for column in (path.force, path.feed) if column is not None]
    steps: list[NDArray[Any]] = [path.segment, *(np.round(np.log(column) / NOTICED) for column in wishes)]
    for column in steps:
        change = np.flatnonzero(np.diff(column) != 0)
        fixed[change] = fixed[change + 1] = True
    kept = np.zeros(len(path.s), dtype=np.bool_)
    _keep(path.positions_work, path.axes_work, fixed, chord_m, float(np.cos(axis_rad)), longest_m, kept)
    return np.flatnonzero(kept)


def rows_without_straight_air(path: ToolPath) -> NDArray[np.bool_]:
    """Mask of all points in contact and of those in the air at which the tool changes its way, shape (n,)."""
    kept = path.process.copy()
    kept[needed_rows(path, AIR_CHORD_M, AIR_AXIS_RAD, np.inf)] = True
    return kept


@njit(cache=True, error_model="numpy")
def _keep(
    positions: Array,
    axes: Array,
    fixed: NDArray[np.bool_],
    chord: float,
    cosine: float,
    longest: float,
    kept: NDArray[np.bool_],
) -> None:
    """Lengthen each move until a point between would be missed; mark the rows that end moves."""
    first = 0
    kept[0] = True
    last = len(fixed) - 1
    for end in range(1, last + 1):
        if fixed[end - 1] and end - 1 > first:
            kept[end - 1] = True
            first = end - 1
        if not _straight(positions, axes, first, end, chord, cosine, longest):
            kept[end - 1] = True
            first = end - 1
    kept[last] = True


@njit(cache=True, error_model="numpy")
def _straight(positions: Array, axes: Array, first: int, end: int, chord: float, cosine: float, longest: float) -> bool:
    """Whether one move from a row to another leaves out only points it passes close by."""
    if end == first + 1:
        return True
    length = 0.0
    for k in range(3):
        length += (positions[end, k] - positions[first, k]) ** 2
    if length > longest * longest:
        return False
    for row in range(first + 1, end):
        along = gap = one = other = 0.0
        for k in range(3):
            along += (positions[row, k] - positions[first, k]) * (positions[end, k] - positions[first, k])
            one += axes[row, k] * axes[first, k]
            other += axes[row, k] * axes[end, k]
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        for k in range(3):
            foot = positions[first, k] + share * (positions[end, k] - positions[first, k])
            gap += (positions[row, k] - foot) ** 2
        if gap > chord * chord or one < cosine or other < cosine:
            return False
    return True
