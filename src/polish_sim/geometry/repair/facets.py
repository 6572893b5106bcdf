"""Repairs of single facets: drop empty and double ones, flip needles, split T-junctions (Skin -> Skin)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, Ints, angles_between, dots, next_corners, norms
from polish_sim.errors import MeshError, count_text
from polish_sim.geometry import topology
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.polygon import split_polygons
from polish_sim.geometry.repair.skin import Skin, middle_in_mm, number_rows

SLIVER = 1e-6  #: Facets lower than this share of the part's size have no meaningful normal
NEEDLE = 0.1  #: A facet lower than this share of its longest edge is a needle
ON_EDGE = 1e-5  #: A vertex closer to an edge than this share of the part's size lies on it
_ROUNDS = 10
# the sharpest edge around must get this much smaller [rad / rad], so that creases stay where they are
_CALMER = 0.5
_DEEPEST = 0.03  # the new edge passes the old one at most at this share of its length
_SAMPLE = 400  #: Edges by which candidates are guessed first
_MOST_CANDIDATES = 5_000_000


def drop_bad_facets(skin: Skin, path: Path) -> Skin:
    """Drop facets whose corners coincide and facets that occur twice.

    One of two equal facets stays; where that leaves a wall inside the part (two solids glued at a
    face), both go.

    Raises:
        MeshError: No facet has an area.
    """
    if (_shapes(skin.vertices, skin.faces).heights <= SLIVER * skin.size).all():
        raise MeshError(
            f"{path}: all {len(skin.faces)} facets have zero area (all points on a line or in one place). "
            "Export the part again."
        )
    whole = (skin.faces != np.roll(skin.faces, 1, axis=1)).all(axis=1)
    dropped = (~whole).sum()
    if dropped:
        skin = skin.keep(whole, f"dropped {dropped} facets without area")
    first, number = number_rows(np.sort(skin.faces, axis=1).astype(np.uint64))
    if len(first) == len(skin.faces):
        return skin
    double = np.bincount(number)[number[first]] > 1
    twice = len(skin.faces) - len(first)
    where = middle_in_mm(skin.vertices[skin.faces[first[double][0]]])
    skin = skin.keep(first.astype(np.int32), f"dropped {twice} facets that occur twice, the first at {where}")
    return _drop_walls(skin, double)


def _drop_walls(skin: Skin, double: Bools) -> Skin:
    """Drop pieces of double facets whose rim others share, so that inside and outside are defined again."""
    crowded = topology.facets_at_edges(skin.faces) > 2
    if not crowded.any():
        return skin
    adjacency = topology.find_adjacency(skin.faces)
    both = double[:, None] & double[adjacency.facets]
    count, labels = topology.label_pieces(topology.facet_links(adjacency, both), len(skin.faces))
    wall = np.zeros(count, dtype=bool)
    wall[labels[double & crowded.any(axis=1)]] = True
    inner = wall[labels] & double
    if not inner.any():
        return skin
    return skin.keep(
        ~inner, f"dropped {inner.sum()} facets of walls inside the part, where solids meet face to face"
    )


def flip_needles(skin: Skin) -> Skin:
    """Connect the corner of a needle that lies near its long edge with the facet beyond that edge instead;
    noted.

    A needle's normal is far off on a curved face. Edges are flipped only where both facets become rounder and
    the sharpest bend around them clearly smaller: at creases nothing changes. A facet without height has no
    normal to go by: there the skin stays closed without it. No vertex is moved.
    """
    faces = skin.faces.copy()
    flipped = []
    for _ in range(_ROUNDS):
        done = _flip_round(skin.vertices, faces, SLIVER * skin.size)
        flipped += done
        if not done:
            break
    if not flipped:
        return skin
    where = middle_in_mm(skin.vertices[faces[flipped[0]]])
    note = f"flipped the long edge of {count_text(len(flipped), 'needle')}, the first at {where}"
    return skin.noted(note, faces=faces)


def _flip_round(vertices: Array, faces: Ints, least: float) -> list[int]:
    """Flip needles in place, none beside another; the facets that were needles. Those lower than ``least``
    [m] have no height."""
    shape, edge, normals, heights = _shapes(vertices, faces)
    facet = np.flatnonzero(shape < NEEDLE)
    if len(facet) == 0:
        return []
    adjacency = topology.find_adjacency(faces)
    facet = facet[adjacency.facets[facet, edge[facet]] >= 0]
    edge = edge[facet]
    other, back = adjacency.facets[facet, edge], adjacency.edges[facet, edge]
    p, q, r = (faces[facet, (edge + k) % 3] for k in range(3))
    s = faces[other, (back + 2) % 3]
    # Facets p q r and q p s become s r p and r s q.
    pair = np.stack([np.stack([s, r, p], axis=1), np.stack([r, s, q], axis=1)], axis=1)
    (shape_1, _, normal_1, _), (shape_2, _, normal_2, _) = (_shapes(vertices, pair[:, k]) for k in range(2))
    wanted = np.minimum(shape_1, shape_2) > np.minimum(shape[facet], shape[other])
    wanted &= (s != r) & _pass_closely(*(vertices[corner] for corner in (p, q, r, s)))
    sides = (facet, edge + 2), (other, back + 1), (facet, edge + 1), (other, back + 2)
    beyond = np.stack([adjacency.facets[which, side % 3] for which, side in sides], axis=1)
    before, after = angles_between(normals[facet], normals[other]), angles_between(normal_1, normal_2)
    pairs: list[tuple[Any, Any]] = [
        (facet, normal_1),
        (other, normal_1),
        (facet, normal_2),
        (other, normal_2),
    ]
    for k, (old, new) in enumerate(pairs):
        inner = beyond[:, k] >= 0
        before = np.maximum(before, np.where(inner, angles_between(normals[old], normals[beyond[:, k]]), 0.0))
        after = np.maximum(after, np.where(inner, angles_between(new, normals[beyond[:, k]]), 0.0))
    wanted &= (after <= _CALMER * before) | (heights[facet] <= least)
    if not wanted.any():
        return []
    start, end, _, _ = topology.sorted_half_edges(faces)
    size = np.int64(len(vertices))
    key = np.minimum(r, s) * size + np.maximum(r, s)
    wanted &= ~np.isin(key, np.minimum(start, end) * size + np.maximum(start, end))
    locked, linked, done = np.zeros(len(faces), dtype=bool), set(), []
    for at in np.flatnonzero(wanted):
        around = [facet[at], other[at], *beyond[at][beyond[at] >= 0]]
        if locked[around].any() or key[at] in linked:
            continue
        faces[facet[at]], faces[other[at]] = pair[at]
        locked[around] = True
        linked.add(key[at])
        done.append(facet[at])
    return done


class _Shapes(NamedTuple):
    """Of facets."""

    roundness: Array  #: Height over longest edge [-], shape (m,)
    longest: Indices  #: Which edge that is, shape (m,)
    normals: Array  #: Unit, shape (m, 3)
    heights: Array  #: [m], shape (m,)


def _shapes(vertices: Array, faces: Ints) -> _Shapes:
    corners = vertices[faces]
    normals, areas = facet_normals(vertices, faces)
    lengths2 = ((next_corners(corners) - corners) ** 2).sum(axis=2)
    longest = np.maximum(lengths2.max(axis=1), 1e-300)
    return _Shapes(2.0 * areas / longest, lengths2.argmax(axis=1), normals, 2.0 * areas / np.sqrt(longest))


def _pass_closely(p: Array, q: Array, r: Array, s: Array) -> Bools:
    """Whether the lines p q and r s pass each other closely, compared to the length of p q."""
    along = q - p
    cross = np.cross(along, s - r)
    apart2 = dots(cross, r - p) ** 2
    return apart2 <= _DEEPEST**2 * dots(along, along) * dots(cross, cross)


def split_t_junctions(skin: Skin) -> Skin:
    """Split border edges at border vertices that lie on them, where that makes the skin less open; noted.

    Only edges with one facet are looked at: a vertex on an edge inside the skin opens no gap.
    """
    facet, at = np.nonzero(topology.facets_at_edges(skin.faces) == 1)
    border = 3 * facet + at
    if len(border) == 0:
        return skin
    start, end = skin.faces.ravel(), next_corners(skin.faces).ravel()
    edge, vertex, along = _vertices_on_edges(skin, start[border], end[border])
    if len(edge) == 0:
        return skin
    edge = border[edge]
    faces, source, split = _split_facets(skin, edge, vertex, along)
    if topology.find_edge_faults(faces).open >= len(border):
        return skin
    where = middle_in_mm(skin.vertices[[start[edge[0]], end[edge[0]]]])
    note = f"split {split} facets at T-junctions (vertices on their edges), the first at {where}"
    return skin.noted(note, faces=faces, source=source)


def _vertices_on_edges(skin: Skin, first: Indices, last: Indices) -> tuple[Indices, Indices, Array]:
    """Pairs of a border edge and a border vertex within it, and how far along it lies (0 to 1)."""
    vertices = skin.vertices
    tolerance = ON_EDGE * skin.size
    rim = np.unique(np.concatenate([first, last]))
    a, b = vertices[first], vertices[last]
    length = norms(b - a)
    tree = cKDTree(vertices[rim])
    middles, radii = 0.5 * (a + b), 0.5 * length + tolerance
    every = max(len(a) // _SAMPLE, 1)  # to count them all may itself take minutes
    for step, most in ((every, 4 * _MOST_CANDIDATES), (1, _MOST_CANDIDATES)):
        if step * tree.query_ball_point(middles[::step], radii[::step], return_length=True).sum() > most:
            return np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0)
    near = tree.query_ball_point(middles, radii)
    edge = np.repeat(np.arange(len(first)), [len(found) for found in near])
    vertex = rim[np.concatenate([np.asarray(found, dtype=np.int64) for found in near])]
    way = (b - a)[edge] / np.maximum(length[edge], 1e-300)[:, None]
    offset = vertices[vertex] - a[edge]
    along = dots(offset, way)
    off = norms(offset - along[:, None] * way)
    inside = (along > tolerance) & (along < length[edge] - tolerance)
    on = (off <= tolerance) & inside & (vertex != first[edge]) & (vertex != last[edge])
    return edge[on], vertex[on], along[on] / length[edge[on]]


def _split_facets(skin: Skin, edge: Indices, vertex: Indices, along: Array) -> tuple[Ints, Ints, int]:
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
