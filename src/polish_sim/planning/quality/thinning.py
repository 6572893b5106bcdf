"""Some of many points, spread evenly, each standing for those around it (points -> Thinned).

Points are taken in their own order, so the choice does not depend on the frame they are given in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.quality.point_grid import build_point_grid

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Thinned(NamedTuple):
    """Which points were kept, and which of them stands for each."""

    kept: Ints
    """Numbers of the points kept, shape (k,)."""
    stands_for: Ints
    """Place in `kept` of the one nearest to each point, shape (n,)."""


def thin(points: Array, spacing: float) -> Thinned:
    """Keep points no closer than a spacing to each other, every other one within it of one kept.

    Args:
        points: [m], shape (n, 3).
        spacing: [m].

    Returns:
        The choice.
    """
    grid = build_point_grid(points, spacing)
    cells = ((points - grid.low) / grid.cell).astype(np.int64)
    kept = np.flatnonzero(_keep(points, cells, grid.size, spacing))
    return Thinned(kept, np.asarray(cKDTree(points[kept]).query(points)[1], dtype=np.int64))


@njit(cache=True, error_model="numpy")
def _keep(points, cells, size, spacing):  # type: ignore[no-untyped-def]
    kept = np.zeros(len(points), np.bool_)
    # Kept points of each cell as a chain: the last one kept, and for each point the one kept before it.
    last = np.full(size[0] * size[1] * size[2], -1, np.int64)
    before = np.full(len(points), -1, np.int64)
    for i in range(len(points)):
        free = True
        for a in range(max(cells[i, 0] - 1, 0), min(cells[i, 0] + 2, size[0])):
            for b in range(max(cells[i, 1] - 1, 0), min(cells[i, 1] + 2, size[1])):
                for c in range(max(cells[i, 2] - 1, 0), min(cells[i, 2] + 2, size[2])):
                    j = last[(a * size[1] + b) * size[2] + c]
                    while j >= 0 and free:
                        dx, dy = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1]
                        dz = points[i, 2] - points[j, 2]
                        free = dx * dx + dy * dy + dz * dz >= spacing * spacing
                        j = before[j]
        if free:
            kept[i] = True
            cell = (cells[i, 0] * size[1] + cells[i, 1]) * size[2] + cells[i, 2]
            before[i] = last[cell]
            last[cell] = i
    return kept
