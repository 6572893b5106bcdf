"""Closest point on many quadratic Bezier triangles, by a tree of boxes (points -> facets and
barycentrics)."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Ints, boxes_of, next_corners, norms
from polish_sim.geometry.closest_on_patch import closest_on_patch, flat_distance2
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record, bare, part

LEAF_SIZE = 2
DEEPEST = 24  #: Beyond this depth nodes are halved, which bounds the depth of the whole tree to about 45


class BoxTree(NamedTuple):
    """Binary tree of axis-aligned boxes in depth-first order; node 0 is the root."""

    low: Array  #: Lower corners [m], shape (k, 3)
    high: Array  #: Upper corners [m], shape (k, 3)
    right: Ints  #: Right child (the left one is the next node); -1 for a leaf, shape (k,)
    first: Ints  #: First item of a node in ``items``, shape (k,)
    size: Ints  #: Number of items below a node, shape (k,)
    items: Ints  #: Patch indices, shape (m,)
    bulge: Array  #: How far each patch may be from its flat triangle [m], shape (m,)


def build_box_tree(control: Array) -> BoxTree:
    """Build the tree over patches with control points (m, 6, 3) [m]; a Bezier patch lies within the box of
    these."""
    # P - flat = sum of 2 u v e with e an edge's control point beside its middle, and u v + v w + w u <= 1/3.
    middles = 0.5 * (control[:, :3] + next_corners(control[:, :3]))
    bulge = 2.0 / 3.0 * norms(control[:, 3:] - middles).max(axis=1)
    low, high, right, first, size, items = build_boxes(control)
    return BoxTree(low, high, right, first, size, items, bulge)


def build_boxes(corners: Array) -> tuple[Array, Array, Ints, Ints, Ints, Ints]:
    """Build the tree over the boxes around corners (m, k, 3) [m]: the first six fields of
    :class:`BoxTree`."""
    lows, highs = boxes_of(corners)
    count = len(lows)
    capacity = max(2 * count, 1)
    items = np.arange(count, dtype=np.int32)
    low, high = np.empty((capacity, 3)), np.empty((capacity, 3))
    right = np.full(capacity, -1, np.int32)
    first = np.zeros(capacity, np.int32)
    size = np.zeros(capacity, np.int32)
    nodes = _build(lows, highs, 0.5 * (lows + highs), items, low, high, right, first, size)
    return low[:nodes], high[:nodes], right[:nodes], first[:nodes], size[:nodes], items


# Written without array expressions and slices, which take several times as long to compile.


@njit
def _build(lows, highs, centers, items, low, high, right, first, size):  # type: ignore[no-untyped-def]
    """Fill the tree depth first with an explicit stack; return the number of nodes."""
    begins, ends = np.empty(128, np.int64), np.empty(128, np.int64)
    parents, depths = np.empty(128, np.int64), np.empty(128, np.int64)
    begins[0], ends[0], parents[0], depths[0] = 0, len(lows), -1, 0
    top, nodes = 1, 0
    while top > 0:
        top -= 1
        begin, end, parent, depth = begins[top], ends[top], parents[top], depths[top]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        first[node], size[node] = begin, end - begin
        _enclose(items, begin, end, lows, highs, low[node], high[node])
        if end - begin <= LEAF_SIZE:
            continue
        middle = _split(items, begin, end, centers) if depth < DEEPEST else begin
        if middle == begin or middle == end:  # noqa: SIM109  (a tuple takes longer to compile)
            middle = (begin + end) // 2
        # The left child, on top, is the next node; the right one writes its number to its parent.
        begins[top], ends[top], parents[top], depths[top] = middle, end, node, depth + 1
        begins[top + 1], ends[top + 1], parents[top + 1], depths[top + 1] = begin, middle, -1, depth + 1
        top += 2
    return nodes


@part
def _enclose(items, begin, end, lows, highs, low, high):  # type: ignore[no-untyped-def]
    """Write the box around some items' boxes to low and high."""
    for k in range(3):
        low[k], high[k] = np.inf, -np.inf
        for i in range(begin, end):
            low[k] = min(low[k], lows[items[i], k])
            high[k] = max(high[k], highs[items[i], k])


@part
def _split(items, begin, end, centers):  # type: ignore[no-untyped-def]
    """Sort items to both sides of the middle of their centers' box across its longest side.

    Returns where the second side begins; ``begin`` if all centers coincide.
    """
    low, high = np.empty(3), np.empty(3)
    _enclose(items, begin, end, centers, centers, low, high)
    axis = 0
    for k in range(1, 3):
        axis = k if high[k] - low[k] > high[axis] - low[axis] else axis
    middle = begin
    for i in range(begin, end):
        if 2.0 * centers[items[i], axis] < low[axis] + high[axis]:
            items[i], items[middle] = items[middle], items[i]
            middle += 1
    return middle


@njit(inline="always")
def box_distance2(low, high, node, point):  # type: ignore[no-untyped-def]
    """Squared distance of a point to a node's box [m^2]."""
    dx = max(low[node, 0] - point[0], 0.0, point[0] - high[node, 0])
    dy = max(low[node, 1] - point[1], 0.0, point[1] - high[node, 1])
    dz = max(low[node, 2] - point[2], 0.0, point[2] - high[node, 2])
    return dx * dx + dy * dy + dz * dz


_CANDIDATES = 32


class SearchRoom(Record):
    """Memory of a search, for one thread; allocated anew at each point it takes a tenth of the time."""

    nodes: Annotated[Ints, (64,)]  #: Still to be looked at, the last one first
    bounds: Annotated[Array, (64,)]  #: Squared distance of each one's box [m^2]
    items: Annotated[Ints, (_CANDIDATES,)]  #: Patches that may be the closest
    lowers: Annotated[Array, (_CANDIDATES,)]  #: What each one is away at least [m]


@bare
def closest_in_tree(control, tree, search, point, hint, limit):  # type: ignore[no-untyped-def]
    """Closest point of all patches (m, 6, 3) to a point [m]: squared distance [m^2], facet (-1 if none), u,
    v.

    Flat triangles, which bound the patches' distances from both sides, sort out all but a few patches.
    ``search`` is memory; ``hint`` is a patch that may be close, or -1; beyond ``limit`` [m] nothing is looked
    for.
    """
    best, facet, best_u, best_v = limit * limit, -1, 0.0, 0.0
    if hint >= 0:
        distance2, u, v = closest_on_patch(control[hint], point)
        if distance2 < best:
            best, facet, best_u, best_v = distance2, hint, u, v
    upper = np.sqrt(best)
    nodes, bounds, items, lowers = search.nodes, search.bounds, search.items, search.lowers
    found = 0
    nodes[0], bounds[0] = 0, box_distance2(tree.low, tree.high, 0, point)
    top = 1
    while top > 0:
        top -= 1
        if bounds[top] >= upper * upper:
            continue
        node = nodes[top]
        if tree.right[node] >= 0:
            _push_children(tree, node, point, nodes, bounds, top)
            top += 2
            continue
        for i in range(tree.first[node], tree.first[node] + tree.size[node]):
            item = tree.items[i]
            flat = np.sqrt(flat_distance2(control[item], point))
            if item == hint or flat - tree.bulge[item] > upper:
                continue
            upper = min(upper, flat + tree.bulge[item])
            items[found] = item
            lowers[found] = flat - tree.bulge[item]
            found += 1
            if found == _CANDIDATES:
                best, facet, best_u, best_v = _best_of(
                    control, items, lowers, found, point, best, facet, best_u, best_v
                )
                upper, found = min(upper, np.sqrt(best)), 0
    return _best_of(control, items, lowers, found, point, best, facet, best_u, best_v)


@part
def _best_of(  # type: ignore[no-untyped-def]
    control, items, lowers, found, point, best, facet, best_u, best_v
):
    """Closest of the best so far and some candidates, the last found first: it is usually the closest."""
    for i in range(found - 1, -1, -1):
        if lowers[i] > 0.0 and lowers[i] * lowers[i] > best:
            continue
        distance2, u, v = closest_on_patch(control[items[i]], point)
        if distance2 < best:
            best, facet, best_u, best_v = distance2, items[i], u, v
    return best, facet, best_u, best_v


@njit(inline="always")
def _push_children(tree, node, point, nodes, bounds, top):  # type: ignore[no-untyped-def]
    """Put both children of a node on the stack, the closer one on top."""
    left, right = node + 1, tree.right[node]
    left_bound = box_distance2(tree.low, tree.high, left, point)
    right_bound = box_distance2(tree.low, tree.high, right, point)
    near, far = (1, 0) if left_bound < right_bound else (0, 1)
    nodes[top + near], bounds[top + near] = left, left_bound
    nodes[top + far], bounds[top + far] = right, right_bound


@njit
def closest_points(control, tree, search, points, hints):  # type: ignore[no-untyped-def]
    """Closest facet (n,) and barycentric coordinates (n, 3) for points (n, 3); hints (n,) or -1."""
    facets = np.empty(len(points), np.int32)
    barycentric = np.empty((len(points), 3))
    for i in range(len(points)):
        place = points[i, 0], points[i, 1], points[i, 2]
        _, facet, u, v = closest_in_tree(control, tree, search, place, hints[i], np.inf)
        facets[i] = facet
        barycentric[i, 0], barycentric[i, 1], barycentric[i, 2] = u, v, 1.0 - u - v
    return facets, barycentric
