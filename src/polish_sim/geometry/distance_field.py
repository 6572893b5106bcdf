"""Signed distance of a surface: at points, and sampled in a narrow band (Surface -> bricks for the contact).

Cubes of 8 x 8 x 8 cells exist only near the surface; :mod:`field_lookup` reads them. The sign at an edge or
corner follows the angle-weighted pseudo-normal (Baerentzen and Aanaes 2005); with curved patches the tangent
planes at that point take the place of the flat facets.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, Ints, boxes_of
from polish_sim.errors import ConfigError
from polish_sim.geometry.closest import BoxTree, SearchRoom, closest_in_tree
from polish_sim.geometry.closest_on_patch import blossom, on_edge, weighted
from polish_sim.geometry.field_lookup import CELLS, INSIDE, NODES, OUTSIDE, DistanceField
from polish_sim.geometry.surface import Surface
from polish_sim.kernel_cache import njit
from polish_sim.kernels import bare, cross, dot, minus, part, plus

_ON_EDGE = 1e-9
_MOST_NODES = 400_000_000
_BATCH = 256


class SkinArrays(NamedTuple):
    """A surface's arrays as the distance kernels take them."""

    control: Array  #: Control points [m], shape (m, 6, 3)
    faces: Ints  #: Vertex indices, shape (m, 3)
    neighbours: Ints  #: Facet across each edge, -1 at borders, shape (m, 3)
    neighbour_edges: Ints  #: Which edge of that facet it is, shape (m, 3)
    vertex_normals: Array  #: Angle-weighted sums of the patches' normals, zero at borders, shape (n, 3)
    tree: BoxTree
    search: SearchRoom


def _build_skin(surface: Surface) -> SkinArrays:
    """Gather a surface's arrays, with the pseudo-normals of its vertices."""
    normals = surface.vertex_normal_sums
    return SkinArrays(surface.control, surface.faces, *surface.adjacency, normals, surface.tree, SearchRoom())


def signed_distances(surface: Surface, points: Array) -> Array:
    """Signed distance (n,) of points (n, 3) to a surface [m], negative inside.

    Points whose closest point is on a border of an open surface count as outside.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    return _signed_distances(_build_skin(surface), points, np.inf)[0]


@njit
def _signed_distances(skin, points, limit):  # type: ignore[no-untyped-def]
    """Signed distances of points and their closest facets, -1 beyond the limit."""
    distances, facets = np.empty(len(points)), np.empty(len(points), np.int32)
    hint = -1
    for i in range(len(points)):
        # Neighbours in the list are mostly neighbours in space: the last facet saves time.
        place = points[i, 0], points[i, 1], points[i, 2]
        distances[i], facets[i] = signed_distance(skin, place, hint, limit)
        if facets[i] >= 0:
            hint = facets[i]
    return distances, facets


@bare
def signed_distance(skin, point, hint, limit):  # type: ignore[no-untyped-def]
    """Signed distance [m] of one point and the facet it is measured to; facet -1 beyond ``limit`` [m]."""
    distance2, facet, u, v = closest_in_tree(
        skin.control, skin.tree, skin.search, point, np.int32(hint), limit
    )
    if facet < 0:
        return limit, facet
    foot, outwards = _point_and_side(skin, facet, u, v)
    side = dot(minus(point, foot), outwards)
    distance = np.sqrt(distance2)
    return (-distance if side < 0.0 else distance), facet


@part
def _point_and_side(skin, facet, u, v):  # type: ignore[no-untyped-def]
    """The closest point and a vector towards outside; a zero vector at borders."""
    w = 1.0 - u - v
    foot, outwards = _point_and_normal(skin.control[facet], u, v)
    on_first, on_second, on_third = w < _ON_EDGE, u < _ON_EDGE, v < _ON_EDGE  # edges 0-1, 1-2, 2-0
    count = int(on_first) + int(on_second) + int(on_third)
    if count == 1:
        edge = 0 if on_first else (1 if on_second else 2)
        other = skin.neighbours[facet, edge]
        if other < 0:
            return foot, (0.0, 0.0, 0.0)
        along = v if edge == 0 else (w if edge == 1 else u)
        other_u, other_v = on_edge(skin.neighbour_edges[facet, edge], 1.0 - along)
        outwards = plus(outwards, _point_and_normal(skin.control[other], other_u, other_v)[1])
    elif count >= 2:
        corner = 0 if u > 0.5 else (1 if v > 0.5 else 2)
        normal = skin.vertex_normals[skin.faces[facet, corner]]
        outwards = normal[0], normal[1], normal[2]
    return foot, outwards


@part
def _point_and_normal(patch, u, v):  # type: ignore[no-untyped-def]
    """Point of a patch and its unit normal."""
    w = 1.0 - u - v
    a, b, c = blossom(patch, u, v, w)
    normal = cross(minus(a, c), minus(b, c))
    size = max(np.sqrt(dot(normal, normal)), 1e-300)
    return weighted(u, a, v, b, w, c), (normal[0] / size, normal[1] / size, normal[2] / size)


def build_distance_field(
    surface: Surface, spacing: float, band: float, bounds: Array | None = None
) -> DistanceField:
    """Sample the signed distance of a part's whole surface in a band of half width ``band`` [m], every
    ``spacing`` [m].

    On an open surface the sign follows the closest point's normal; beyond the border, and beyond the box
    ``bounds`` (2, 3) [m], everything is outside.

    Raises:
        ConfigError: The band is narrower than two spacings, or the field would take too much memory.
    """
    if not (0.0 < 2.0 * spacing <= band):
        raise ConfigError(
            f"distance field: the band ({band:g} m) must be at least twice the spacing ({spacing:g} m), both "
            "positive."
        )
    low, high = surface.bounds if bounds is None else np.asarray(bounds, dtype=np.float64)
    margin = band + spacing if bounds is None else 0.0
    origin = low - margin
    side = CELLS * spacing
    shape = np.maximum(np.ceil((high + margin - origin) / side), 1).astype(np.int64)
    skin = _build_skin(surface)
    near, hints = _find_near_bricks(skin, origin, side, shape, band)
    if len(near) * NODES**3 > _MOST_NODES:
        raise ConfigError(
            f"distance field: {len(near)} bricks are too many; raise the spacing ({spacing:g} m) or set "
            "bounds."
        )
    table = np.full(shape, OUTSIDE, dtype=np.int32)
    table[tuple(near.T)] = np.arange(len(near), dtype=np.int32)
    if not surface.is_open:
        _sign_empty_bricks(skin, table, origin, side)
    bricks = np.empty((len(near), NODES, NODES, NODES), dtype=np.float32)
    for begin in range(0, len(near), _BATCH):
        batch = slice(begin, begin + _BATCH)
        corners = origin + side * near[batch]
        bricks[batch] = _sample_bricks(skin, corners, hints[batch], spacing, band)
    return DistanceField(origin, float(spacing), float(band), table, bricks)


def bend_field(field: DistanceField, shift_at: Callable[[Array, Array], Array]) -> DistanceField:
    """The field of the same part bent by a form error.

    ``shift_at`` gives the outward shift of the surface [m], (k, n), at each of some steps (n, 3) from each of
    some corners (k, 3).
    """
    places = np.argwhere(field.table >= 0)
    corners = np.empty((len(field.bricks), 3))
    corners[field.table[tuple(places.T)]] = field.origin + CELLS * field.spacing * places
    bricks = np.empty_like(field.bricks)
    steps = field.spacing * np.indices((NODES, NODES, NODES)).reshape(3, -1).T.astype(np.float64)
    for begin in range(0, len(bricks), _BATCH):
        batch = slice(begin, begin + _BATCH)
        shift = shift_at(corners[batch], steps).reshape(bricks[batch].shape)
        bricks[batch] = np.clip(field.bricks[batch] - shift, -field.band, field.band)
    return field._replace(bricks=bricks)


def _find_near_bricks(
    skin: SkinArrays, origin: Array, side: float, shape: Indices, band: float
) -> tuple[Indices, Ints]:
    """Bricks that meet the band, shape (k, 3), and a facet near each, shape (k,)."""
    low, high = boxes_of(skin.control)
    first = np.floor((low - band - origin) / side).astype(np.int64).clip(0, shape)
    last = np.floor((high + band - origin) / side).astype(np.int64) + 1
    # Boxes that begin at a place or below, less those that end there: boxes around it.
    boxes = np.zeros(shape + 1, dtype=np.int64)
    for end in np.ndindex(2, 2, 2):
        np.add.at(boxes, tuple(np.where(end, last.clip(first, shape), first).T), (-1) ** sum(end))
    candidates = np.argwhere(boxes.cumsum(0).cumsum(1).cumsum(2))
    limit = band + 0.5 * np.sqrt(3.0) * side
    facets = _signed_distances(skin, np.ascontiguousarray(origin + side * (candidates + 0.5)), limit)[1]
    return candidates[facets >= 0], facets[facets >= 0]


def _sign_empty_bricks(skin: SkinArrays, table: Ints, origin: Array, side: float) -> None:
    """Mark the empty bricks inside a closed surface; neighbours in a row are on one side."""
    empty = table < 0
    begins = empty & np.diff(empty, axis=2, prepend=False)
    distances, _ = _signed_distances(
        skin, np.ascontiguousarray(origin + side * (np.argwhere(begins) + 0.5)), np.inf
    )
    inside = distances[np.cumsum(begins)[empty.ravel()] - 1] < 0.0
    table[empty] = np.where(inside, INSIDE, OUTSIDE)


@njit
def _sample_bricks(skin, corners, hints, spacing, band):  # type: ignore[no-untyped-def]
    """Signed distances at the nodes of bricks, shape (k, 9, 9, 9), clipped to the band.

    A brick is 27 blocks of 3 x 3 x 3 nodes; a block whose middle is far enough is outside the band as a
    whole.
    """
    out = np.empty((len(corners), NODES, NODES, NODES))
    for b in range(len(corners)):
        hint = np.int64(hints[b])
        for block in range(27):
            i, j, k = 3 * (block // 9), 3 * (block // 3 % 3), 3 * (block % 3)
            x, y, z = corners[b, 0] + spacing * i, corners[b, 1] + spacing * j, corners[b, 2] + spacing * k
            limit = band + 1.7321 * spacing if block > 0 else np.inf
            middle, facet = signed_distance(skin, (x + spacing, y + spacing, z + spacing), hint, limit)
            near = facet >= 0
            if near:
                hint = facet
            else:
                # On the same side as the block before: a change of side takes more than twice the band.
                middle = (
                    out[b, i, j, k - 1] if k > 0 else (out[b, i, j - 1, 0] if j > 0 else out[b, i - 1, 0, 0])
                )
            for node in range(27):
                di, dj, dk = node // 9, node // 3 % 3, node % 3
                distance = -band if middle < 0.0 else band
                if near:
                    place = x + spacing * di, y + spacing * dj, z + spacing * dk
                    exact, facet = signed_distance(skin, place, hint, band)
                    if facet >= 0:
                        distance, hint = exact, facet
                out[b, i + di, j + dj, k + dk] = distance
    return out
