"""The closed and open pieces a skin consists of: turned outward, counted, measured (Skin -> Skin, notes)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.closest import build_boxes
from polish_sim.geometry.repair.skin import Floats, Skin, place
from polish_sim.geometry.repair.skin import Ints as Indices
from polish_sim.geometry.topology import equal_pairs, facet_links, find_adjacency, label_pieces, sorted_half_edges
from polish_sim.kernel_cache import njit

# Make all facets of a piece run the same way round (faces -> faces).

Ints = NDArray[np.int32]


def wind_consistently(faces: Ints) -> tuple[Ints, int, bool]:
    """Flip facets until neighbours agree about which side is outside; the majority of a piece stays.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        The faces, how many were flipped, and whether the surface has two sides at all.
    """
    start, _, order, key = sorted_half_edges(faces)
    first, second = equal_pairs(key)
    a, b = order[first], order[second]
    agrees = start[a] != start[b]
    if agrees.all():
        return faces, 0, True
    neighbours = np.full((len(faces), 3), -1, dtype=np.int64)
    same = np.ones((len(faces), 3), dtype=np.bool_)
    neighbours[a // 3, a % 3], neighbours[b // 3, b % 3] = b // 3, a // 3
    same[a // 3, a % 3] = same[b // 3, b % 3] = agrees
    flip, two_sided = _flood(neighbours, same)
    wound = faces.copy()
    wound[flip] = wound[flip][:, ::-1]
    return wound, int(flip.sum()), bool(two_sided)


@njit(cache=True)
def _flood(neighbours, same):  # type: ignore[no-untyped-def]
    """Walk each piece, remember which facets must flip; flip the smaller half."""
    count = len(neighbours)
    state = np.zeros(count, np.int8)  # 0 unseen, 1 keep, -1 flip
    queue = np.empty(count, np.int64)
    two_sided = True
    for seed in range(count):
        if state[seed] != 0:
            continue
        state[seed] = 1
        queue[0] = seed
        head, tail, kept = 0, 1, 0
        while head < tail:
            facet = queue[head]
            head += 1
            kept += state[facet]
            for edge in range(3):
                other = neighbours[facet, edge]
                if other < 0:
                    continue
                wanted = state[facet] if same[facet, edge] else -state[facet]
                if state[other] == 0:
                    state[other] = wanted
                    queue[tail] = other
                    tail += 1
                elif state[other] != wanted:
                    two_sided = False
        if kept < 0:
            for i in range(tail):
                state[queue[i]] = -state[queue[i]]
    return state < 0, two_sided


_SHOWN = 6
_MOST_NESTED = 2000  # with more closed pieces than this none is taken for a hollow


class Shells(NamedTuple):
    """Connected pieces of a skin."""

    labels: Indices
    """Piece of each facet, shape (m,)."""
    closed: Indices
    """1 where a piece has no border, shape (k,)."""
    volumes: Floats
    """Volume a closed piece encloses, negative where its facets look inward; 0 for open ones [m^3], shape (k,)."""
    low: Floats
    """Lower corners of their bounding boxes [m], shape (k, 3)."""
    high: Floats
    """Upper corners, shape (k, 3)."""


def wind_alike(skin: Skin, path: Path) -> Skin:
    """Wind the facets of every piece alike; the majority of a piece stays as it is.

    Raises:
        MeshError: The surface has only one side (a Moebius strip), so no winding is right.
    """
    wound, flips, two_sided = wind_consistently(skin.faces)
    if not two_sided:
        raise MeshError(f"{path}: the surface is one-sided (like a Moebius strip). Repair the part.")
    if not flips:
        return skin
    note = f"turned {flips} facets that were wound the other way"
    return Skin(skin.vertices, wound, skin.source, (*skin.notes, note))


def turn_outward(skin: Skin) -> Skin:
    """Let closed pieces look outward, and those within others (hollows) inward; open pieces stay."""
    shells = find_shells(skin)
    depth = _depths(skin.vertices, skin.faces, shells)
    wrong = (shells.closed == 1) & ((shells.volumes < 0.0) != (depth % 2 == 1))
    if not wrong.any():
        return skin
    faces = np.where(wrong[shells.labels][:, None], skin.faces[:, ::-1], skin.faces)
    what = "the whole part inside out: its" if len(wrong) == 1 else f"{wrong.sum()} of {len(wrong)} bodies: their"
    notes = (*skin.notes, f"turned {what} normals pointed inward")
    return Skin(skin.vertices, np.ascontiguousarray(faces), skin.source, notes)


def find_shells(skin: Skin) -> Shells:
    """Label connected pieces and measure them."""
    adjacency = find_adjacency(skin.faces)
    count, labels = label_pieces(facet_links(adjacency), len(skin.faces))
    closed = np.ones(count, dtype=np.int32)
    closed[labels[(adjacency.facets < 0).any(axis=1)]] = 0
    corners = skin.vertices[skin.faces]
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, labels, corners.min(axis=1))
    np.maximum.at(high, labels, corners.max(axis=1))
    centred = corners - 0.5 * (low + high)[labels][:, None, :]
    sixfold = np.einsum("mj,mj->m", centred[:, 0], np.cross(centred[:, 1], centred[:, 2]))
    volumes = np.where(closed == 1, np.bincount(labels, weights=sixfold, minlength=count) / 6.0, 0.0)
    return Shells(labels, closed, volumes, low, high)


def describe_shells(skin: Skin) -> tuple[str, ...]:
    """Notes on a part of several bodies: how many, how large, how many hollows."""
    shells = find_shells(skin)
    if len(shells.closed) == 1:
        return ()
    hollow = shells.volumes < 0.0
    notes = []
    if hollow.any():
        notes.append(f"hollow inside: {_count(int(hollow.sum()), 'closed shell')} within others")
    sizes = 1e3 * (shells.high - shells.low)[~hollow]
    if len(sizes) > 1:
        sizes = sizes[np.argsort(-sizes.max(axis=1), kind="stable")]
        shown = "; ".join(" x ".join(f"{length:.4g}" for length in size) for size in sizes[:_SHOWN])
        more = f"; and {len(sizes) - _SHOWN} more" if len(sizes) > _SHOWN else ""
        notes.append(
            f"{len(sizes)} bodies in one file ({int(shells.closed[~hollow].sum())} of them closed), "
            f"of {shown}{more} mm: all are kept; the path lies on the one its region belongs to"
        )
    return tuple(notes)


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' if number != 1 else ''}"


def _depths(vertices: Floats, faces: Indices, shells: Shells) -> Indices:
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
        point = vertices[faces[order[first[inner]]]].mean(axis=0)
        for outer in closed[around]:
            if outer != inner:
                members = order[first[outer] : first[outer + 1]]
                depth[inner] += abs(_turns_around(point, vertices, faces, members)) > 0.5
    return depth


@njit(cache=True, error_model="numpy")
def _turns_around(point, vertices, faces, members):  # type: ignore[no-untyped-def]
    """Winding number of a closed piece about a point (van Oosterom and Strackee's solid angles)."""
    total = 0.0
    for facet in members:
        a, b, c = (
            vertices[faces[facet, 0]] - point,
            vertices[faces[facet, 1]] - point,
            vertices[faces[facet, 2]] - point,
        )
        la, lb, lc = np.sqrt((a * a).sum()), np.sqrt((b * b).sum()), np.sqrt((c * c).sum())
        triple = (
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        )
        below = la * lb * lc + (a * b).sum() * lc + (b * c).sum() * la + (c * a).sum() * lb
        total += 2.0 * np.arctan2(triple, below)
    return total / (4.0 * np.pi)


# Find facets of a skin that pass through each other (vertices and faces -> pairs).

MOST_FACETS = 400_000
"""Larger parts are not searched, for the time it takes."""

_MOST_PAIRS = 100_000


def describe_crossing_facets(skin: Skin) -> tuple[str, ...]:
    """A note on facets that pass through each other: how many, and where the first is.

    They are reported, not mended: a path on a region away from them is not concerned.
    """
    if len(skin.faces) > MOST_FACETS:
        return (f"not searched for facets that pass through each other: more than {MOST_FACETS:,} facets",)
    pairs = find_crossing_facets(skin.vertices, skin.faces)
    if len(pairs) == 0:
        return ()
    where = place(skin.vertices[skin.faces[pairs[0, 0]]])
    count = f"{len(pairs)}" if len(pairs) < _MOST_PAIRS else f"at least {len(pairs)}"
    return (f"self-intersecting: {count} pairs of facets pass through each other, the first at {where}; left as it is",)


def find_crossing_facets(vertices: Floats, faces: Indices) -> Indices:
    """Pairs of facets without a common vertex, one with an edge through the inside of the other, shape (k, 2)."""
    corners = np.ascontiguousarray(vertices[faces])
    low, high, right, first, size, items = build_boxes(corners.min(axis=1), corners.max(axis=1))
    pairs = np.empty((_MOST_PAIRS, 2), np.int32)
    count = _search(corners, faces, low, high, right, first, size, items, pairs)
    return pairs[:count]


@njit(cache=True, error_model="numpy")
def _search(corners, faces, low, high, right, first, size, items, pairs):  # type: ignore[no-untyped-def]
    stack = np.empty(128, np.int64)
    found = 0
    box_low, box_high = np.empty(3), np.empty(3)
    for facet in range(len(faces)):
        for k in range(3):
            box_low[k] = min(corners[facet, 0, k], corners[facet, 1, k], corners[facet, 2, k])
            box_high[k] = max(corners[facet, 0, k], corners[facet, 1, k], corners[facet, 2, k])
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not _overlap(low, high, node, box_low, box_high):
                continue
            if right[node] >= 0:
                stack[top], stack[top + 1] = right[node], node + 1
                top += 2
                continue
            for i in range(first[node], first[node] + size[node]):
                other = items[i]
                if other > facet and not _share(faces, facet, other) and _cross(corners[facet], corners[other]):
                    pairs[found, 0], pairs[found, 1] = facet, other
                    found += 1
                    if found == len(pairs):
                        return found
    return found


@njit(cache=True, inline="always")
def _overlap(low, high, node, box_low, box_high):  # type: ignore[no-untyped-def]
    return (
        low[node, 0] <= box_high[0]
        and low[node, 1] <= box_high[1]
        and low[node, 2] <= box_high[2]
        and high[node, 0] >= box_low[0]
        and high[node, 1] >= box_low[1]
        and high[node, 2] >= box_low[2]
    )


@njit(cache=True, inline="always")
def _share(faces, a, b):  # type: ignore[no-untyped-def]
    for i in range(3):
        for j in range(3):
            if faces[a, i] == faces[b, j]:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _cross(a, b):  # type: ignore[no-untyped-def]
    """An edge of one triangle passes through the inside of the other."""
    return _pierced(a, b) or _pierced(b, a)


@njit(cache=True, error_model="numpy")
def _pierced(a, b):  # type: ignore[no-untyped-def]
    """An edge of ``b`` passes through the inside of ``a``; touching within rounding does not count."""
    size = 0.0
    for k in range(3):
        size = max(size, abs(a[1, k] - a[0, k]), abs(a[2, k] - a[0, k]))
    slack = 1e-9 * size * size * size
    below = above = 0
    heights = np.empty(3)
    for i in range(3):
        heights[i] = _volume(a[0], a[1], a[2], b[i])
        below += heights[i] < -slack
        above += heights[i] > slack
    if below == 0 or above == 0:
        return False
    for i in range(3):
        j = (i + 1) % 3
        if (heights[i] < -slack and heights[j] > slack) or (heights[i] > slack and heights[j] < -slack):
            u = _volume(a[0], a[1], b[i], b[j])
            v = _volume(a[1], a[2], b[i], b[j])
            w = _volume(a[2], a[0], b[i], b[j])
            least = 1e-9 * (abs(u) + abs(v) + abs(w))
            if (u > least and v > least and w > least) or (u < -least and v < -least and w < -least):
                return True
    return False


@njit(cache=True, inline="always")
def _volume(a, b, c, d):  # type: ignore[no-untyped-def]
    """Six times the signed volume of a tetrahedron."""
    bx, by, bz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    cx, cy, cz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    dx, dy, dz = d[0] - a[0], d[1] - a[1], d[2] - a[2]
    return bx * (cy * dz - cz * dy) + by * (cz * dx - cx * dz) + bz * (cx * dy - cy * dx)
