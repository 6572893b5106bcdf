"""Find facets of a skin that pass through each other (vertices and faces -> pairs)."""

from __future__ import annotations

import numpy as np
from numba import njit

from polish_sim.geometry.bvh import build_boxes
from polish_sim.geometry.repair.skin import Floats, Ints, Skin, place

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


def find_crossing_facets(vertices: Floats, faces: Ints) -> Ints:
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
