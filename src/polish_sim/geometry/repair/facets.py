"""Repairs of single facets that need no guessing: drop empty and double ones, flip slivers away (Skin -> Skin)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.errors import MeshError
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.polygon import split_polygons
from polish_sim.geometry.repair.skin import Floats, Ints, Skin, number_rows, place
from polish_sim.geometry.topology import facet_links, find_adjacency, label_pieces, sorted_half_edges
from polish_sim.kernel_cache import njit

SLIVER = 1e-6
"""Facets lower than this share of the part's size have no meaningful normal."""

_FLIP_ROUNDS = 10


def drop_bad_facets(skin: Skin, path: Path) -> Skin:
    """Drop facets whose corners coincide and facets that occur twice.

    Of a facet that occurs twice one stays; where that leaves a wall inside the part (two solids glued at a
    face), both go.

    Raises:
        MeshError: No facet has an area.
    """
    if (facet_heights(skin.vertices, skin.faces) <= SLIVER * skin.size).all():
        raise MeshError(
            f"{path}: all {len(skin.faces)} facets have zero area (all points on a line or in one place). "
            "Export the part again."
        )
    whole = (skin.faces != np.roll(skin.faces, 1, axis=1)).all(axis=1)
    dropped = int((~whole).sum())
    if dropped:
        skin = skin.keep(whole, f"dropped {dropped} facets without area")
    first, number = number_rows(np.sort(skin.faces, axis=1).astype(np.uint64))
    if len(first) == len(skin.faces):
        return skin
    double = np.bincount(number)[number[first]] > 1
    twice = len(skin.faces) - len(first)
    where = place(skin.vertices[skin.faces[first[double][0]]])
    skin = skin.keep(first.astype(np.int32), f"dropped {twice} facets that occur twice, the first at {where}")
    return _drop_walls(skin, double)


def _drop_walls(skin: Skin, double: NDArray[np.bool_]) -> Skin:
    """Drop pieces of double facets whose rim others share, so that inside and outside are defined again."""
    _, _, order, key = sorted_half_edges(skin.faces)
    run = np.cumsum(np.concatenate([[True], key[1:] != key[:-1]])) - 1
    crowded = np.zeros(len(order), dtype=bool)
    crowded[order] = np.bincount(run)[run] > 2
    if not crowded.any():
        return skin
    adjacency = find_adjacency(skin.faces)
    both = double[:, None] & double[adjacency.facets]
    count, labels = label_pieces(facet_links(adjacency, both), len(skin.faces))
    wall = np.zeros(count, dtype=bool)
    wall[labels[double & crowded.reshape(-1, 3).any(axis=1)]] = True
    inner = wall[labels] & double
    if not inner.any():
        return skin
    return skin.keep(~inner, f"dropped {inner.sum()} facets of walls inside the part, where solids meet face to face")


def flip_slivers(skin: Skin) -> Skin:
    """Turn the long edge of facets without height, so that the skin stays closed without them.

    A corner that lies on its facet's long edge is connected to the facet beyond that edge instead.
    """
    vertices, limit = skin.vertices, SLIVER * skin.size
    faces, flips = skin.faces.copy(), 0
    for _ in range(_FLIP_ROUNDS):
        heights = facet_heights(vertices, faces)
        slivers = np.flatnonzero(heights <= limit)
        adjacency = find_adjacency(faces) if len(slivers) else None
        done: set[int] = set()
        for facet in slivers:
            assert adjacency is not None
            edge = int(_edge_lengths(vertices, faces[facet]).argmax())
            other = int(adjacency.facets[facet, edge])
            if other < 0 or done & {int(facet), other}:
                continue
            a, c, b = np.roll(faces[facet], -edge)
            d = faces[other, (adjacency.edges[facet, edge] + 2) % 3]
            pair = np.array([[b, a, d], [c, b, d]], dtype=np.int32)
            if b == d or facet_heights(vertices, pair).min() <= heights[facet]:
                continue
            faces[facet], faces[other] = pair
            done |= {int(facet), other}
        flips += len(done) // 2
        if not done:
            break
    notes = (*skin.notes, f"flipped the long edge of {flips} facets without height") if flips else skin.notes
    return Skin(vertices, faces, skin.source, notes)


def facet_heights(vertices: Floats, faces: Ints) -> Floats:
    """Smallest height of each facet [m], shape (m,)."""
    longest = _edge_lengths(vertices, faces).max(axis=-1)
    return np.linalg.norm(_area_vectors(vertices, faces), axis=1) / np.maximum(longest, 1e-300)


def _edge_lengths(vertices: Floats, faces: Ints) -> Floats:
    return np.linalg.norm(vertices[np.roll(faces, -1, axis=-1)] - vertices[faces], axis=-1)


def _area_vectors(vertices: Floats, faces: Ints) -> Floats:
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.cross(b - a, c - a)


# Flip the long edge of needle facets, whose normals are far off on a curved face (Skin -> Skin).

NEEDLE = 0.1
"""A facet lower than this share of its longest edge is a needle."""

_CALMER = 0.5  # the sharpest edge around must get this much smaller [rad / rad], so that creases stay where they are
_DEEPEST = 0.03  # the new edge passes the old one at most at this share of its length
_ROUNDS = 10


def flip_needles(skin: Skin) -> Skin:
    """Connect the corner of a needle that lies near its long edge with the facet beyond that edge instead.

    Done only where both facets become rounder and the sharpest bend around them clearly smaller: on planes and at
    creases nothing changes. No vertex is moved.

    Returns:
        The skin, with a note of how many edges were flipped, and where the first is.
    """
    faces, flips, first = skin.faces.copy(), 0, -1
    for _ in range(_ROUNDS):
        adjacency = find_adjacency(faces)
        normals, _ = facet_normals(skin.vertices, faces)
        done, facet = _flip(skin.vertices, faces, adjacency.facets, adjacency.edges, normals)
        first = int(facet) if first < 0 else first
        flips += int(done)
        if not done:
            break
    if not flips:
        return skin
    where = place(skin.vertices[faces[first]])
    return Skin(
        skin.vertices,
        faces,
        skin.source,
        (*skin.notes, f"flipped the long edge of {flips} needles, the first at {where}"),
    )


@njit(cache=True, error_model="numpy")
def _flip(vertices: Floats, faces: Ints, neighbours: Ints, edges: Ints, normals: Floats):  # type: ignore[no-untyped-def]
    """One round of flips in place, none beside another; how many, and the first facet (-1: none)."""
    locked = np.zeros(len(faces), np.bool_)
    flips, first = 0, -1
    for facet in range(len(faces)):
        a, b, c = vertices[faces[facet, 0]], vertices[faces[facet, 1]], vertices[faces[facet, 2]]
        before, edge, _, _, _ = _measure(a, b, c)
        if before >= NEEDLE or locked[facet]:
            continue
        other = neighbours[facet, edge]
        if other < 0 or locked[other]:
            continue
        back = edges[facet, edge]
        p, q, r = faces[facet, edge], faces[facet, (edge + 1) % 3], faces[facet, (edge + 2) % 3]
        s = faces[other, (back + 2) % 3]
        if s == r or _linked(faces, neighbours, edges, facet, (edge + 2) % 3, s):
            continue
        # Facets p q r and q p s become s r p and r s q.
        shape_1, _, x1, y1, z1 = _measure(vertices[s], vertices[r], vertices[p])
        shape_2, _, x2, y2, z2 = _measure(vertices[r], vertices[s], vertices[q])
        other_shape, _, _, _, _ = _measure(
            vertices[faces[other, 0]], vertices[faces[other, 1]], vertices[faces[other, 2]]
        )
        if min(shape_1, shape_2) <= min(before, other_shape):
            continue
        if not _pass_closely(vertices[p], vertices[q], vertices[r], vertices[s]):
            continue
        beyond = (
            neighbours[facet, (edge + 2) % 3],
            neighbours[other, (back + 1) % 3],
            neighbours[facet, (edge + 1) % 3],
            neighbours[other, (back + 2) % 3],
        )
        sharpest = _bend(normals[facet, 0], normals[facet, 1], normals[facet, 2], normals[other])
        sharpest_after = _bend(x1, y1, z1, np.array([x2, y2, z2]))
        clear = True
        for k in range(4):
            if beyond[k] < 0:
                continue
            clear = clear and not locked[beyond[k]]
            old = facet if k in (0, 2) else other
            sharpest = max(sharpest, _bend(normals[old, 0], normals[old, 1], normals[old, 2], normals[beyond[k]]))
            x, y, z = (x1, y1, z1) if k < 2 else (x2, y2, z2)
            sharpest_after = max(sharpest_after, _bend(x, y, z, normals[beyond[k]]))
        if not clear or sharpest_after > _CALMER * sharpest:
            continue
        faces[facet, 0], faces[facet, 1], faces[facet, 2] = s, r, p
        faces[other, 0], faces[other, 1], faces[other, 2] = r, s, q
        locked[facet] = locked[other] = True
        for k in range(4):
            if beyond[k] >= 0:
                locked[beyond[k]] = True
        first = facet if flips == 0 else first
        flips += 1
    return flips, first


@njit(cache=True, error_model="numpy")
def _linked(faces, neighbours, edges, facet, corner, vertex):  # type: ignore[no-untyped-def]
    """Whether a corner's vertex has an edge to another vertex already, seen by walking around it both ways."""
    for way in range(2):
        at, here = facet, corner
        for _ in range(64):
            if faces[at, (here + 1) % 3] == vertex or faces[at, (here + 2) % 3] == vertex:
                return True
            side = here if way == 0 else (here + 2) % 3
            beyond = neighbours[at, side]
            if beyond < 0:
                break
            # The edge runs the other way there: the corner is its end (way 0) or its start.
            here = (edges[at, side] + 1) % 3 if way == 0 else edges[at, side]
            at = beyond
            if at == facet:
                return False
    return False


@njit(cache=True, error_model="numpy")
def _pass_closely(p, q, r, s):  # type: ignore[no-untyped-def]
    """Whether the lines p q and r s pass each other closely, seen against p q's length."""
    u, v, w = q - p, s - r, r - p
    x, y, z = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
    cross2 = x * x + y * y + z * z
    return (x * w[0] + y * w[1] + z * w[2]) ** 2 <= _DEEPEST**2 * (u * u).sum() * cross2


@njit(cache=True, error_model="numpy")
def _measure(a, b, c):  # type: ignore[no-untyped-def]
    """Height over longest edge, which edge that is (from corner 0, 1 or 2), and the unit normal."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size = np.sqrt(x * x + y * y + z * z)
    ab, ca = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    bc = (ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2
    longest, edge = ab, 0
    if bc > longest:
        longest, edge = bc, 1
    if ca > longest:
        longest, edge = ca, 2
    size_1 = max(size, 1e-300)
    return size / max(longest, 1e-300), edge, x / size_1, y / size_1, z / size_1


@njit(cache=True, error_model="numpy")
def _bend(x, y, z, normal):  # type: ignore[no-untyped-def]
    """Angle between two unit normals [rad]."""
    return np.arccos(min(max(x * normal[0] + y * normal[1] + z * normal[2], -1.0), 1.0))


# Split facets at vertices of their neighbours that lie on their edges, so that the skin closes (Skin -> Skin).

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
