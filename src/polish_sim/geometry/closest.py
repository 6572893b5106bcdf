"""Closest point on many quadratic Bezier triangles, by a tree of boxes (points -> facets and barycentrics)."""

from __future__ import annotations

import numpy as np
from numba import njit

from polish_sim.geometry.bvh import box_distance2
from polish_sim.geometry.closest_on_patch import closest_on_patch, flat_distance2

_CANDIDATES = 32


@njit(cache=True)
def closest_in_tree(control, tree, x, y, z, hint, limit):  # type: ignore[no-untyped-def]
    """Closest point of all patches.

    Flat triangles, which bound the patches' distances from both sides, sort out all but a few patches.

    Args:
        control: Control points [m], shape (m, 6, 3).
        tree: Boxes over the patches.
        x: Point [m].
        y: Point [m].
        z: Point [m].
        hint: A patch that may be close, or -1.
        limit: Distance beyond which nothing is looked for [m].

    Returns:
        Squared distance [m^2], facet (-1 if none within the limit), u, v.
    """
    best, facet, best_u, best_v = limit * limit, -1, 0.0, 0.0
    if hint >= 0:
        distance2, u, v = closest_on_patch(control[hint], x, y, z)
        if distance2 < best:
            best, facet, best_u, best_v = distance2, hint, u, v
    upper = np.sqrt(best)
    nodes, bounds = np.empty(64, np.int32), np.empty(64)
    items, lowers, found = np.empty(_CANDIDATES, np.int32), np.empty(_CANDIDATES), 0
    nodes[0], bounds[0] = 0, box_distance2(tree.low, tree.high, 0, x, y, z)
    top = 1
    while top > 0:
        top -= 1
        if bounds[top] >= upper * upper:
            continue
        node = nodes[top]
        if tree.right[node] >= 0:
            _push_children(tree, node, x, y, z, nodes, bounds, top)
            top += 2
            continue
        for i in range(tree.first[node], tree.first[node] + tree.size[node]):
            item = tree.items[i]
            flat = np.sqrt(flat_distance2(control[item], x, y, z))
            if item == hint or flat - tree.bulge[item] > upper:
                continue
            upper = min(upper, flat + tree.bulge[item])
            items[found], lowers[found] = item, flat - tree.bulge[item]
            found += 1
            if found == _CANDIDATES:
                best, facet, best_u, best_v = _best_of(
                    control, items, lowers, found, x, y, z, best, facet, best_u, best_v
                )
                upper, found = min(upper, np.sqrt(best)), 0
    return _best_of(control, items, lowers, found, x, y, z, best, facet, best_u, best_v)


@njit(cache=True)
def _best_of(control, items, lowers, found, x, y, z, best, facet, best_u, best_v):  # type: ignore[no-untyped-def]
    """Closest of the best so far and some candidates, the last found first: it is usually the closest."""
    for i in range(found - 1, -1, -1):
        if lowers[i] > 0.0 and lowers[i] * lowers[i] > best:
            continue
        distance2, u, v = closest_on_patch(control[items[i]], x, y, z)
        if distance2 < best:
            best, facet, best_u, best_v = distance2, items[i], u, v
    return best, facet, best_u, best_v


@njit(cache=True, inline="always")
def _push_children(tree, node, x, y, z, nodes, bounds, top):  # type: ignore[no-untyped-def]
    """Put both children of a node on the stack, the closer one on top."""
    left, right = node + 1, tree.right[node]
    left_bound = box_distance2(tree.low, tree.high, left, x, y, z)
    right_bound = box_distance2(tree.low, tree.high, right, x, y, z)
    left_first = left_bound < right_bound
    if left_bound == right_bound:
        # Within both boxes: try the one whose middle is nearer.
        left_first = _to_middle(tree, left, x, y, z) < _to_middle(tree, right, x, y, z)
    near, far = (1, 0) if left_first else (0, 1)
    nodes[top + near], bounds[top + near] = left, left_bound
    nodes[top + far], bounds[top + far] = right, right_bound


@njit(cache=True, inline="always")
def _to_middle(tree, node, x, y, z):  # type: ignore[no-untyped-def]
    """Squared distance to the middle of a box, in units of half of it along each axis."""
    total = 0.0
    for k in range(3):
        q = x if k == 0 else (y if k == 1 else z)
        low, high = tree.low[node, k], tree.high[node, k]
        d = 2.0 * q - low - high
        total += d * d / max((high - low) ** 2, 1e-300)
    return total


@njit(cache=True)
def closest_points(control, tree, points, hints):  # type: ignore[no-untyped-def]
    """Closest facet (n,) and barycentric coordinates (n, 3) for points (n, 3); hints (n,) or -1."""
    facets = np.empty(len(points), np.int32)
    barycentric = np.empty((len(points), 3))
    for i in range(len(points)):
        _, facet, u, v = closest_in_tree(control, tree, points[i, 0], points[i, 1], points[i, 2], hints[i], np.inf)
        facets[i] = facet
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = u, v, 1.0 - u - v
    return facets, barycentric
