"""What every mesh reader returns: the corners of triangles, whatever the file's facets were (reader -> load_part)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.polygon import MOST_CORNERS, split_polygons


class FileTriangles(NamedTuple):
    """Triangles of a file in the file's own unit."""

    corners: NDArray[np.float64]
    """Corners in the order the file winds them, shape (m, 3, 3)."""
    numbers: NDArray[np.int32]
    """Number of the file's facet each triangle belongs to, from 0, shape (m,)."""
    notes: tuple[str, ...] = ()
    """What was left out or split, for the user."""


def gather_triangles(
    points: NDArray[np.float64], indices: NDArray[np.int64], sizes: NDArray[np.int64], path: object
) -> FileTriangles:
    """Build triangles from indexed polygons.

    Args:
        points: Vertices, shape (n, 3).
        indices: Vertex numbers of all polygons one after the other, shape (sum of sizes,).
        sizes: Corners of each polygon, shape (k,).
        path: The file, for messages.

    Returns:
        Triangles; polygons with fewer than three corners are left out and noted.

    Raises:
        MeshError: A polygon refers to a vertex that does not exist, or cannot be split.
    """
    bad = np.flatnonzero((indices < 0) | (indices >= len(points)))
    if len(bad):
        facet = int(np.searchsorted(np.cumsum(sizes), bad[0], side="right"))
        raise MeshError(
            f"{path}: facet {facet} refers to vertex {indices[bad[0]]}, but vertices run from 0 to {len(points) - 1}. "
            "Export the part again."
        )
    split = split_polygons(points, indices, sizes)
    if split.too_many >= 0:
        raise MeshError(
            f"{path}: facet {split.too_many} is a hollow polygon of {sizes[split.too_many]} corners; at most "
            f"{MOST_CORNERS} are split. Export the part as triangles."
        )
    degenerate, polygons = int((sizes < 3).sum()), int((sizes > 3).sum())
    notes = (
        *((f"left out {degenerate} facets with fewer than three corners",) if degenerate else ()),
        *((f"split {polygons} facets with more than three corners into triangles",) if polygons else ()),
    )
    return FileTriangles(points[split.triangles], split.polygons, notes)
