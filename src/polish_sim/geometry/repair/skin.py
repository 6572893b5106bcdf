"""A triangle skin under repair: merged from a soup, its pieces wound alike, turned outward, described; facets
that cross (triangles -> Skin, notes)."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, Ints, boxes_of, crosses, dots, longest_side, norms
from polish_sim.errors import MeshError, count_text, place_in_mm
from polish_sim.geometry.closest import build_boxes
from polish_sim.geometry.topology import (
    extremes,
    facet_links,
    find_adjacency,
    find_edge_faults,
    label_pieces,
    paired_half_edges,
    sorted_half_edges,
)
from polish_sim.kernel_cache import njit
from polish_sim.kernels import bare, cross, dot, minus

WELD = 1e-5  #: Gaps up to this share of the part's size are closed when exact merging leaves the mesh open


class ScanNoise(NamedTuple):
    """What a scan leaves unknown of a surface after smoothing, rms; 0 of one that is not scanned."""

    offset: float = 0.0  #: Of its places along the normal [m]
    slope: float = 0.0  #: Of its normals [rad]


NOISELESS = ScanNoise()


class Skin(NamedTuple):
    """Vertices and facets, and the repairs made so far."""

    vertices: Array  #: Vertices [m], shape (n, 3); some may be unused
    faces: Ints  #: Vertex indices, shape (m, 3)
    #: The triangle of the file each facet stems from, -1 for facets that close holes, shape (m,)
    source: Ints
    notes: tuple[str, ...] = ()  #: What was repaired, for the user
    noise: ScanNoise = NOISELESS  #: Of a scan, what smoothing left of it

    @property
    def size(self) -> float:
        """Longest side of the bounding box of the vertices in use [m]."""
        return longest_side(self.vertices[np.unique(self.faces)])

    def keep(self, kept: Bools | Ints, note: str) -> Skin:
        """The skin with these facets only, and a note about it."""
        return self.noted(note, faces=self.faces[kept], source=self.source[kept])

    def noted(self, note: str, **changed: Any) -> Skin:
        """The skin with something ``changed``, and a note about it."""
        return self._replace(**changed, notes=(*self.notes, note))


def middle_in_mm(points: Array) -> str:
    """The middle of points (k, 3) [m], for messages."""
    return place_in_mm(points.reshape(-1, 3).mean(axis=0))


def merge_vertices(triangles: Array) -> tuple[Array, Ints, tuple[str, ...]]:
    """Merge equal corners of a triangle soup (m, 3, 3) [m]; weld tiny gaps if that makes the mesh less open.

    The vertices (n, 3) [m] are in the order of their first appearance.
    """
    corners = np.ascontiguousarray(triangles.reshape(-1, 3)) + 0.0  # -0.0 and 0.0 are the same place
    first, index = number_rows(corners.view(np.uint64))
    vertices = corners[first]
    faces = index.reshape(-1, 3)
    gaps = find_edge_faults(faces).open
    if gaps == 0:
        return vertices, faces, ()
    tolerance = WELD * longest_side(vertices)
    welded = _weld(vertices, faces, tolerance)
    collapsed = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    faults = find_edge_faults(welded[~collapsed])
    if faults.open >= gaps or faults.crowded > find_edge_faults(faces).crowded:
        return vertices, faces, ()
    return (
        vertices,
        welded,
        (f"closed gaps up to {tolerance * 1e3:.1g} mm at {gaps - faults.open} border edges",),
    )


def number_rows(rows: NDArray[np.uint64]) -> tuple[Indices, Ints]:
    """Number equal rows alike in the order of appearance: each number's first row (k,), each row's number
    (n,)."""
    mixed = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    _, first, index = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first[index]], rows):  # two rows mixed to one number
        _, first, index = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order))
    return first[order], rank[index.ravel()]


def _weld(vertices: Array, faces: Ints, tolerance: float) -> Ints:
    # Vertices of a damaged file crowd by the thousand: one of those within a hundredth stands for all.
    first, index = number_rows(np.rint(100.0 / tolerance * vertices).view(np.uint64))
    pairs = cKDTree(vertices[first]).query_pairs(tolerance, output_type="ndarray")
    labels = label_pieces(pairs, len(first))[1][index]
    representative = np.unique(labels, return_index=True)[1].astype(np.int32)
    return representative[labels][faces]


MOST_FACETS = 400_000  #: Larger parts are not searched for crossing facets, for the time it takes
_MOST_PAIRS = 100_000
_SHOWN = 6
_MOST_NESTED = 2000  # with more closed pieces than this none is taken for a hollow


class Shells(NamedTuple):
    """Connected pieces of a skin."""

    labels: Ints  #: Piece of each facet, shape (m,)
    closed: Bools  #: Pieces without border, shape (k,)
    #: Volume a closed piece encloses, negative where it looks inward; 0 for open ones [m^3], shape (k,)
    volumes: Array
    low: Array  #: Lower corners of their bounding boxes [m], shape (k, 3)
    high: Array  #: Upper corners, shape (k, 3)


def wind_alike(skin: Skin, path: Path) -> Skin:
    """Flip facets until neighbours agree about which side is outside; the majority of a piece stays as it is.

    Raises:
        MeshError: The surface has only one side (a Moebius strip), so no winding is right.
    """
    start, _, order, key = sorted_half_edges(skin.faces)
    a, b = paired_half_edges(order, key)
    agrees = start[a] != start[b]
    if agrees.all():
        return skin
    # A piece with two sides falls apart into two mirrored ones if every facet stands in the graph twice, as
    # it is and flipped.
    count = len(skin.faces)
    flipped = np.where(agrees, 0, count)
    here, there = a // 3, b // 3
    links = np.concatenate(
        [np.column_stack([here, there + flipped]), np.column_stack([here + count, there + count - flipped])]
    )
    _, labels = label_pieces(links, 2 * count)
    kept, mirrored = labels[:count], labels[count:]
    if (kept == mirrored).any():
        raise MeshError(f"{path}: the surface is one-sided (like a Moebius strip). Repair the part.")
    sizes = np.bincount(kept, minlength=labels.max() + 1)
    flip = (sizes[kept] < sizes[mirrored]) | ((sizes[kept] == sizes[mirrored]) & (kept > mirrored))
    wound = skin.faces.copy()
    wound[flip] = wound[flip][:, ::-1]
    note = f"turned {flip.sum()} facets that were wound the other way"
    return skin.noted(note, faces=wound)


def turn_outward(skin: Skin) -> Skin:
    """Let closed pieces look outward, and those within others (hollows) inward; open pieces stay."""
    shells = find_shells(skin)
    depth = _depths(skin, shells)
    wrong = shells.closed & ((shells.volumes < 0.0) != (depth % 2 == 1))
    if not wrong.any():
        return skin
    faces = np.where(wrong[shells.labels][:, None], skin.faces[:, ::-1], skin.faces)
    what = (
        "the whole part inside out: its"
        if len(wrong) == 1
        else f"{wrong.sum()} of {len(wrong)} bodies: their"
    )
    return skin.noted(f"turned {what} normals pointed inward", faces=np.ascontiguousarray(faces))


def find_shells(skin: Skin) -> Shells:
    """Label connected pieces and measure them."""
    adjacency = find_adjacency(skin.faces)
    count, labels = label_pieces(facet_links(adjacency), len(skin.faces))
    closed = np.ones(count, dtype=bool)
    closed[labels[(adjacency.facets < 0).any(axis=1)]] = False
    corners = skin.vertices[skin.faces]
    low, high = extremes(labels, *boxes_of(corners), count)
    centred = corners - 0.5 * (low + high)[labels][:, None, :]
    sixfold = np.einsum("mj,mj->m", centred[:, 0], crosses(centred[:, 1], centred[:, 2]))
    volumes = np.where(closed, np.bincount(labels, weights=sixfold, minlength=count) / 6.0, 0.0)
    return Shells(labels, closed, volumes, low, high)


def describe_shells(skin: Skin) -> tuple[str, ...]:
    """Notes on a part of several bodies: how many, how large, how many hollows."""
    shells = find_shells(skin)
    if len(shells.closed) == 1:
        return ()
    hollow = shells.volumes < 0.0
    count = hollow.sum()
    notes = [f"hollow inside: {count_text(count, 'closed shell')} within others"] if count else []
    sizes = 1e3 * (shells.high - shells.low)[~hollow]
    if len(sizes) > 1:
        sizes = sizes[np.argsort(-sizes.max(axis=1), kind="stable")]
        shown = "; ".join(" x ".join(f"{length:.4g}" for length in size) for size in sizes[:_SHOWN])
        more = f"; and {len(sizes) - _SHOWN} more" if len(sizes) > _SHOWN else ""
        notes.append(
            f"{len(sizes)} bodies in one file ({shells.closed[~hollow].sum()} of them closed), "
            f"of {shown}{more} mm: all are kept; the path lies on the one its region belongs to"
        )
    return tuple(notes)


def _depths(skin: Skin, shells: Shells) -> Ints:
    """In how many other closed pieces each closed piece lies, shape (k,)."""
    depth = np.zeros(len(shells.closed), dtype=np.int32)
    closed = np.flatnonzero(shells.closed)
    if not 2 <= len(closed) <= _MOST_NESTED:
        return depth
    order = np.argsort(shells.labels, kind="stable")
    first = np.searchsorted(shells.labels[order], np.arange(len(depth) + 1))
    for inner in closed:
        around = (shells.low[closed] <= shells.low[inner]).all(axis=1)
        around &= (shells.high[closed] >= shells.high[inner]).all(axis=1)
        point = skin.vertices[skin.faces[order[first[inner]]]].mean(axis=0)
        for outer in closed[around]:
            if outer != inner:
                members = order[first[outer] : first[outer + 1]]
                depth[inner] += abs(_winding_number(skin.vertices[skin.faces[members]] - point)) > 0.5
    return depth


def _winding_number(corners: Array) -> float:
    """How often facets (m, 3, 3) enclose the origin (van Oosterom and Strackee's solid angles)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = norms(corners).T
    triple = dots(a, crosses(b, c))
    below = la * lb * lc + dots(a, b) * lc + dots(b, c) * la + dots(c, a) * lb
    return np.arctan2(triple, below).sum() / (2.0 * np.pi)


def describe_crossing_facets(skin: Skin) -> tuple[str, ...]:
    """A note on facets that pass through each other: how many, and where the first is.

    They are reported, not mended: a path on a region away from them is not concerned.
    """
    if len(skin.faces) > MOST_FACETS:
        return (f"not searched for facets that pass through each other: more than {MOST_FACETS:,} facets",)
    pairs = find_crossing_facets(skin.vertices, skin.faces)
    if len(pairs) == 0:
        return ()
    where = middle_in_mm(skin.vertices[skin.faces[pairs[0, 0]]])
    count = f"{len(pairs)}" if len(pairs) < _MOST_PAIRS else f"at least {len(pairs)}"
    return (
        f"self-intersecting: {count} pairs of facets pass through each other, the first at {where}; left as "
        "it is",
    )


def find_crossing_facets(vertices: Array, faces: Ints) -> Indices:
    """Pairs of facets without a common vertex, one with an edge through the inside of the other, shape (k,
    2)."""
    corners = vertices[faces]
    return _crossing(corners, faces, *build_boxes(corners))


@njit
def _crossing(corners, faces, low, high, right, first, size, items):  # type: ignore[no-untyped-def]
    """The pairs in a tree of boxes, the first facet's number the lower one; `_MOST_PAIRS` at most."""
    pairs, found = np.empty((_MOST_PAIRS, 2), np.int64), 0
    nodes = np.empty(64, np.int32)
    for a in range(len(faces)):
        nodes[0], top = 0, 1
        while top > 0:
            top -= 1
            node = nodes[top]
            if _is_beside(corners[a], low[node], high[node]):
                continue
            if right[node] >= 0:
                nodes[top], nodes[top + 1] = right[node], node + 1
                top += 2
                continue
            for k in range(first[node], first[node] + size[node]):
                b = items[k]
                if b <= a or _share_a_vertex(faces[a], faces[b]):
                    continue
                if _is_pierced(corners[a], corners[b]) or _is_pierced(corners[b], corners[a]):
                    pairs[found, 0], pairs[found, 1] = a, b
                    found += 1
                    if found == _MOST_PAIRS:
                        return pairs
    return pairs[:found]


@bare
def _is_beside(corners, low, high):  # type: ignore[no-untyped-def]
    """Whether a facet is beside a box."""
    for k in range(3):
        if max(corners[0, k], corners[1, k], corners[2, k]) < low[k]:
            return True
        if min(corners[0, k], corners[1, k], corners[2, k]) > high[k]:
            return True
    return False


@bare
def _share_a_vertex(one, other):  # type: ignore[no-untyped-def]
    shared = False
    for vertex in one:
        shared |= vertex == other[0] or vertex == other[1] or vertex == other[2]
    return shared


@bare
def _is_pierced(a, b):  # type: ignore[no-untyped-def]
    """Whether an edge of triangle b passes through the inside of a, (3, 3); touching within rounding does
    not."""
    size = 0.0
    for k in range(3):
        size = max(size, abs(a[1, k] - a[0, k]), abs(a[2, k] - a[0, k]))
    slack = 1e-9 * size * size * size
    for i in range(3):
        start, end = b[i], b[(i + 1) % 3]
        here, there = _volume(a[0], a[1], a[2], start), _volume(a[0], a[1], a[2], end)
        if min(here, there) < -slack and max(here, there) > slack:
            x = _volume(a[0], a[1], start, end)
            y = _volume(a[1], a[2], start, end)
            z = _volume(a[2], a[0], start, end)
            least = 1e-9 * (abs(x) + abs(y) + abs(z))
            if min(x, y, z) > least or max(x, y, z) < -least:
                return True
    return False


@bare
def _volume(a, b, c, d):  # type: ignore[no-untyped-def]
    """Six times the signed volume of a tetrahedron."""
    return dot(minus(b, a), cross(minus(c, a), minus(d, a)))
