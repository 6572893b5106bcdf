"""Split facets at vertices of their neighbours that lie on their edges, so that the skin closes (Skin -> Skin)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.geometry.polygon import split_polygons
from polish_sim.geometry.repair.skin import Skin, place
from polish_sim.geometry.topology import sorted_half_edges

ON_EDGE = 1e-5
"""A vertex closer to an edge than this share of the part's size lies on it."""

_MOST_CANDIDATES = 20_000_000


def split_t_junctions(skin: Skin) -> Skin:
    """Split border edges at border vertices that lie on them, where that makes the skin less open.

    Only edges with one facet are looked at: a vertex on an edge inside the skin opens no gap.

    Returns:
        The skin, with a note of how many edges were split, and where the first is.
    """
    start, end, order, key = sorted_half_edges(skin.faces)
    alone = np.concatenate([[True], key[1:] != key[:-1]]) & np.concatenate([key[1:] != key[:-1], [True]])
    border = order[alone]
    if len(border) == 0:
        return skin
    edge, vertex, along = _vertices_on_edges(skin, start[border], end[border])
    if len(edge) == 0:
        return skin
    edge = border[edge]
    faces, source, split = _split_facets(skin, edge, vertex, along)
    if _open_edges(faces) >= len(border):
        return skin
    where = place(skin.vertices[[start[edge[0]], end[edge[0]]]])
    notes = (*skin.notes, f"split {split} facets at T-junctions (vertices on their edges), the first at {where}")
    return Skin(skin.vertices, faces, source, notes)


def _vertices_on_edges(
    skin: Skin, first: NDArray[np.int64], last: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Pairs of a border edge and a border vertex within it, and how far along it lies (0 to 1)."""
    vertices, tolerance = skin.vertices, ON_EDGE * skin.size
    rim = np.unique(np.concatenate([first, last]))
    a, b = vertices[first], vertices[last]
    length = np.linalg.norm(b - a, axis=1)
    tree = cKDTree(vertices[rim])
    middles, radii = 0.5 * (a + b), 0.5 * length + tolerance
    if tree.query_ball_point(middles, radii, return_length=True).sum() > _MOST_CANDIDATES:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    near = tree.query_ball_point(middles, radii)
    edge = np.repeat(np.arange(len(first)), [len(found) for found in near])
    vertex = rim[np.concatenate([np.asarray(found, dtype=np.int64) for found in near])]
    way = (b - a)[edge] / np.maximum(length[edge], 1e-300)[:, None]
    offset = vertices[vertex] - a[edge]
    along = (offset * way).sum(axis=1)
    off = np.linalg.norm(offset - along[:, None] * way, axis=1)
    inside = (along > tolerance) & (along < length[edge] - tolerance)
    on = (off <= tolerance) & inside & (vertex != first[edge]) & (vertex != last[edge])
    return edge[on], vertex[on], along[on] / length[edge[on]]


def _split_facets(
    skin: Skin, edge: NDArray[np.int64], vertex: NDArray[np.int64], along: NDArray[np.float64]
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """Replace facets by the triangles of the polygon their corners and the vertices on their edges make."""
    facets = np.unique(edge // 3)
    corner = np.concatenate([np.arange(3)[None] + 3 * facets[:, None]], axis=None)
    rank = np.concatenate([corner.astype(np.float64), edge + along])
    member = np.concatenate([skin.faces[facets].ravel().astype(np.int64), vertex])
    order = np.argsort(rank, kind="stable")
    sizes = np.bincount(np.searchsorted(facets, (rank[order] // 3).astype(np.int64)), minlength=len(facets))
    split = split_polygons(skin.vertices, member[order], sizes.astype(np.int64))
    kept = np.ones(len(skin.faces), dtype=bool)
    kept[facets] = False
    faces = np.concatenate([skin.faces[kept], split.triangles.astype(np.int32)])
    source = np.concatenate([skin.source[kept], skin.source[facets][split.polygons]])
    return faces, source, len(facets)


def _open_edges(faces: NDArray[np.int32]) -> int:
    _, _, _, key = sorted_half_edges(faces)
    _, counts = np.unique(key, return_counts=True)
    return int((counts == 1).sum())
