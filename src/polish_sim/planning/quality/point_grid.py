"""Points sorted into the cells of a grid, for kernels that visit what lies near (points -> PointGrid).

The grid only speeds a search up: every visitor tests exact distances, so no answer depends on where cells begin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_ACROSS = 96
"""Cells along the longest side: beyond so many the table itself would cost more than it saves."""


class PointGrid(NamedTuple):
    """Numbers of points, cell by cell."""

    low: Array
    """Corner of the first cell [m], shape (3,)."""
    cell: float
    """Side of a cell [m]."""
    size: Ints
    """Cells along x, y and z, shape (3,)."""
    first: Ints
    """Where each cell's points begin in `items`, one more at the end, shape (cells + 1,)."""
    items: Ints
    """Numbers of the points, sorted by cell, shape (n,)."""


def build_point_grid(points: Array, cell: float) -> PointGrid:
    """Sort points into cells.

    Args:
        points: Where they are [m], shape (n, 3), at least one.
        cell: Wanted side of a cell [m]; larger where the points spread too far for it.

    Returns:
        The grid.
    """
    low = points.min(axis=0)
    spread = points.max(axis=0) - low
    cell = max(cell, float(spread.max()) / MOST_ACROSS, 1e-9)
    where = ((points - low) / cell).astype(np.int64)
    size = where.max(axis=0) + 1
    flat = (where[:, 0] * size[1] + where[:, 1]) * size[2] + where[:, 2]
    items = np.argsort(flat, kind="stable")
    first = np.searchsorted(flat[items], np.arange(int(size.prod()) + 1))
    return PointGrid(low, cell, size, first.astype(np.int64), items.astype(np.int64))
