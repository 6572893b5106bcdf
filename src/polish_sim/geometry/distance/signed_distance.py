"""On which side of the surface a point lies, also beside edges and corners (points -> signed distances).

The sign at an edge or corner follows the angle-weighted pseudo-normal (Baerentzen and Aanaes 2005); with
curved patches the tangent planes at that point take the place of the flat facets.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.geometry.bvh import BoxTree
from polish_sim.geometry.closest import closest_in_tree
from polish_sim.geometry.surface import Surface

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

_ON_EDGE = 1e-9


class Skin(NamedTuple):
    """A surface's arrays as the distance kernels take them."""

    control: Floats
    """Control points [m], shape (m, 6, 3)."""
    faces: Ints
    """Vertex indices, shape (m, 3)."""
    neighbours: Ints
    """Facet across each edge, -1 at borders, shape (m, 3)."""
    neighbour_edges: Ints
    """Which edge of that facet it is, shape (m, 3)."""
    vertex_normals: Floats
    """Angle-weighted sums of the patches' normals, zero at borders, shape (n, 3)."""
    tree: BoxTree


def build_skin(surface: Surface) -> Skin:
    """Gather a surface's arrays, with the pseudo-normals of its vertices."""
    return Skin(
        surface.control,
        surface.faces,
        surface.neighbours,
        surface.neighbour_edges,
        surface.vertex_normal_sums,
        surface.tree,
    )


def signed_distances(surface: Surface, points: Floats) -> Floats:
    """Signed distance of points to a surface, negative inside.

    Args:
        surface: The surface. Points whose closest point is on a border of an open one count as outside.
        points: Points [m], shape (n, 3).

    Returns:
        Distances [m], shape (n,).
    """
    return _signed_distances(build_skin(surface), np.ascontiguousarray(points, dtype=np.float64))


@njit(cache=True)
def _signed_distances(skin, points):  # type: ignore[no-untyped-def]
    out = np.empty(len(points))
    facet = -1
    for i in range(len(points)):
        # Neighbours in the list are mostly neighbours in space: the last facet saves time.
        out[i], facet = signed_distance(skin, points[i, 0], points[i, 1], points[i, 2], facet, np.inf)
    return out


@njit(cache=True)
def signed_distance(skin, x, y, z, hint, limit):  # type: ignore[no-untyped-def]
    """Signed distance [m] of one point and the facet it is measured to; facet -1 beyond ``limit`` [m]."""
    distance2, facet, u, v = closest_in_tree(skin.control, skin.tree, x, y, z, np.int32(hint), limit)
    if facet < 0:
        return limit, facet
    px, py, pz, nx, ny, nz = _point_and_side(skin, facet, u, v)
    side = (x - px) * nx + (y - py) * ny + (z - pz) * nz
    distance = np.sqrt(distance2)
    return (-distance if side < 0.0 else distance), facet


@njit(cache=True)
def _point_and_side(skin, facet, u, v):  # type: ignore[no-untyped-def]
    """The closest point and a vector towards outside; a zero vector at borders."""
    w = 1.0 - u - v
    px, py, pz, nx, ny, nz = _point_and_normal(skin.control[facet], u, v)
    on_first, on_second, on_third = w < _ON_EDGE, u < _ON_EDGE, v < _ON_EDGE  # edges 0-1, 1-2, 2-0
    count = int(on_first) + int(on_second) + int(on_third)
    if count == 1:
        edge = 0 if on_first else (1 if on_second else 2)
        other = skin.neighbours[facet, edge]
        if other < 0:
            return px, py, pz, 0.0, 0.0, 0.0
        along = v if edge == 0 else (w if edge == 1 else u)
        other_u, other_v = _on_edge(skin.neighbour_edges[facet, edge], 1.0 - along)
        _, _, _, mx, my, mz = _point_and_normal(skin.control[other], other_u, other_v)
        nx, ny, nz = nx + mx, ny + my, nz + mz
    elif count >= 2:
        corner = 0 if u > 0.5 else (1 if v > 0.5 else 2)
        normal = skin.vertex_normals[skin.faces[facet, corner]]
        nx, ny, nz = normal[0], normal[1], normal[2]
    return px, py, pz, nx, ny, nz


@njit(cache=True)
def _on_edge(edge, t):  # type: ignore[no-untyped-def]
    """Barycentric u, v of a point on an edge, t from its first corner."""
    if edge == 0:
        return 1.0 - t, t
    if edge == 1:
        return 0.0, 1.0 - t
    return t, 0.0


@njit(cache=True)
def _point_and_normal(patch, u, v):  # type: ignore[no-untyped-def]
    """Point of a patch and its unit normal."""
    w = 1.0 - u - v
    px, ax, bx = _component(patch, 0, u, v, w)
    py, ay, by = _component(patch, 1, u, v, w)
    pz, az, bz = _component(patch, 2, u, v, w)
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
    return px, py, pz, nx / size, ny / size, nz / size


@njit(cache=True, inline="always")
def _component(patch, k, u, v, w):  # type: ignore[no-untyped-def]
    """One component of a patch's point and of half its derivatives along u and v."""
    to_u = u * patch[0, k] + v * patch[3, k] + w * patch[5, k]
    to_v = u * patch[3, k] + v * patch[1, k] + w * patch[4, k]
    to_w = u * patch[5, k] + v * patch[4, k] + w * patch[2, k]
    return u * to_u + v * to_v + w * to_w, to_u - to_w, to_v - to_w
