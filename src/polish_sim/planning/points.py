"""Points sorted into the cells of a grid, for kernels that visit what lies near, and points thinned evenly.

The grid only speeds a search up: every visitor tests exact distances, so no answer depends on where cells
begin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, longest_side
from polish_sim.kernel_cache import njit

MOST_ACROSS = 96  #: Cells along the longest side: with more the table itself would cost more than it saves


class PointGrid(NamedTuple):
    """Numbers of points, cell by cell."""

    low: Array  #: Corner of the first cell [m], shape (3,)
    cell: float  #: Side of a cell [m]
    size: Indices  #: Cells along x, y and z, shape (3,)
    first: Indices  #: Where each cell's points begin in `items`, one more at the end, shape (cells + 1,)
    items: Indices  #: Numbers of the points, sorted by cell, shape (n,)


def build_point_grid(points: Array, cell: float) -> PointGrid:
    """Sort points (n, 3) [m], at least one, into cells of a side [m]; larger ones where they spread too far
    for it."""
    cell = max(cell, longest_side(points) / MOST_ACROSS, 1e-9)
    low = points.min(axis=0)
    where = ((points - low) / cell).astype(np.int64)
    size = where.max(axis=0) + 1
    flat = (where[:, 0] * size[1] + where[:, 1]) * size[2] + where[:, 2]
    items = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[items], np.arange(int(size.prod()) + 1))
    return PointGrid(low, cell, size, first.astype(np.int64), items.astype(np.int64))


@njit(inline="always")
def cells_between(grid, axis, least, most):  # type: ignore[no-untyped-def]
    """First and one past the last cell between two coordinates [m] along one axis."""
    first = int(max(np.floor((least - grid.low[axis]) / grid.cell), 0))
    last = int(min(np.floor((most - grid.low[axis]) / grid.cell), grid.size[axis] - 1)) + 1
    return first, last


# Some of many points, spread evenly, each standing for those around it (points -> Thinned).
#
# Points are taken in their own order, so the choice does not depend on the frame they are given in.


class Thinned(NamedTuple):
    """Which points were kept, and which of them stands for each."""

    kept: Indices  #: Numbers of the points kept, shape (k,)
    stands_for: Indices  #: Place in `kept` of the one nearest to each point, shape (n,)


def thin(points: Array, spacing: float) -> Thinned:
    """Keep points (n, 3) [m] no closer than a spacing [m] to each other, every other one within it of one
    kept."""
    tree, free, kept = cKDTree(points), np.ones(len(points), dtype=bool), list[int]()
    for k, point in enumerate(points):
        if free[k]:
            kept.append(k)
            free[tree.query_ball_point(point, np.nextafter(spacing, 0.0))] = False
    numbers = np.array(kept, dtype=np.int64)
    return Thinned(numbers, np.asarray(cKDTree(points[numbers]).query(points)[1], dtype=np.int64))
