"""Split the polygons of a mesh file into triangles that do not overlap (polygons -> FileTriangles)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, Ints
from polish_sim.errors import MeshError
from polish_sim.kernel_cache import njit
from polish_sim.kernels import cross, dot, minus, plus

MOST_CORNERS = 2000  #: Polygons with more corners than this are not split: it takes the time of their square


class Split(NamedTuple):
    """Triangles polygons were split into."""

    triangles: Indices  #: Vertex numbers, wound as the polygons, shape (m, 3)
    polygons: Ints  #: Polygon each belongs to, shape (m,)


def split_polygons(points: Array, indices: Indices, sizes: Indices) -> Split:
    """Split polygons, each by cutting off its best-shaped corner again and again.

    ``indices`` are the vertex numbers of all polygons one after the other, ``sizes`` their corners; below
    three gives no triangle.
    """
    if len(sizes) and (sizes == 3).all():
        return Split(indices.reshape(-1, 3), np.arange(len(sizes), dtype=np.int32))
    polygons = np.repeat(np.arange(len(sizes), dtype=np.int32), np.maximum(sizes - 2, 0))
    triangles = np.empty((len(polygons), 3), np.int64)
    _split(np.ascontiguousarray(points), indices, sizes, triangles)
    return Split(triangles, polygons)


@njit
def _split(points, indices, sizes, triangles):  # type: ignore[no-untyped-def]
    at = done = 0
    for size in sizes:
        if size >= 3:
            _cut_ears(points, indices[at : at + size].copy(), triangles, done)
            done += size - 2
        at += size


@njit
def _cut_ears(points, ring, triangles, done):  # type: ignore[no-untyped-def]
    """Write the triangles of one polygon; ``ring`` is used up."""
    left = len(ring)
    normal = _normal(points, ring)
    while left > 3:
        best = 0
        best_shape = -np.inf
        for i in range(left):
            a, b, c = ring[i - 1 if i > 0 else left - 1], ring[i], ring[i + 1 if i + 1 < left else 0]
            shape = _shape(points, a, b, c, normal)
            if shape > best_shape and (shape <= 0.0 or _is_empty(points, ring, left, a, b, c, normal)):
                best, best_shape = i, shape
        triangles[done, 0] = ring[best - 1 if best > 0 else left - 1]
        triangles[done, 1] = ring[best]
        triangles[done, 2] = ring[best + 1 if best + 1 < left else 0]
        done += 1
        left -= 1
        for i in range(best, left):
            ring[i] = ring[i + 1]
    for k in range(3):
        triangles[done, k] = ring[k]


@njit
def _normal(points, ring):  # type: ignore[no-untyped-def]
    """Area vector of a closed polygon."""
    area = 0.0, 0.0, 0.0
    for i in range(1, len(ring) - 1):
        area = plus(area, _cross(points, ring[0], ring[i], ring[i + 1]))
    size = max(np.sqrt(dot(area, area)), 1e-300)
    return area[0] / size, area[1] / size, area[2] / size


@njit
def _cross(points, a, b, c):  # type: ignore[no-untyped-def]
    """Twice the area vector of a triangle."""
    return cross(minus(points[b], points[a]), minus(points[c], points[a]))


@njit
def _area(points, a, b, c, normal):  # type: ignore[no-untyped-def]
    """Twice the area of a triangle seen along a normal."""
    return dot(_cross(points, a, b, c), normal)


@njit
def _shape(points, a, b, c, normal):  # type: ignore[no-untyped-def]
    """Area over squared longest side: the higher the better a triangle's shape; negative at a hollow
    corner."""
    longest = 1e-300
    for p, q in ((a, b), (b, c), (c, a)):
        side = minus(points[p], points[q])
        longest = max(longest, dot(side, side))
    return _area(points, a, b, c, normal) / longest


@njit
def _is_empty(points, ring, left, a, b, c, normal):  # type: ignore[no-untyped-def]
    """No other corner of the polygon lies within the triangle."""
    for i in range(left):
        p = ring[i]
        if p in (a, b, c):
            continue
        if (
            _area(points, a, b, p, normal) >= 0.0
            and _area(points, b, c, p, normal) >= 0.0
            and _area(points, c, a, p, normal) >= 0.0
        ):
            return False
    return True


class FileTriangles(NamedTuple):
    """Triangles of a file in the file's own unit."""

    corners: Array  #: Corners in the order the file winds them, shape (m, 3, 3)
    numbers: Ints  #: Number of the file's facet each triangle belongs to, from 0, shape (m,)
    notes: tuple[str, ...] = ()  #: What was left out or split, for the user
    unit: str = ""  #: Of the corners, where the file states one; else it is the user's


def gather_triangles(points: Array, indices: Indices, sizes: Indices, path: object) -> FileTriangles:
    """Build triangles from indexed polygons, see `split_polygons`; those with fewer than three corners are
    noted.

    Raises:
        MeshError: A polygon refers to a vertex that does not exist, or cannot be split; names the file
            ``path``.
    """
    bad = np.flatnonzero((indices < 0) | (indices >= len(points)))
    if len(bad):
        facet = np.searchsorted(np.cumsum(sizes), bad[0], side="right")
        raise MeshError(
            f"{path}: facet {facet} refers to vertex {indices[bad[0]]}, but vertices run from 0 to "
            f"{len(points) - 1}. Export the part again."
        )
    if len(sizes) and sizes.max() > MOST_CORNERS:
        raise MeshError(
            f"{path}: facet {sizes.argmax()} is a polygon of {sizes.max()} corners; at most "
            f"{MOST_CORNERS} are split. Export the part as triangles."
        )
    split = split_polygons(points, indices, sizes)
    degenerate, polygons = (sizes < 3).sum(), (sizes > 3).sum()
    notes = (
        *((f"left out {degenerate} facets with fewer than three corners",) if degenerate else ()),
        *((f"split {polygons} facets with more than three corners into triangles",) if polygons else ()),
    )
    return FileTriangles(points[split.triangles], split.polygons, notes)
