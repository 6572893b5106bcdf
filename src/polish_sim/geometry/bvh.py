"""A tree of boxes over patches, to find the few a point could be closest to (control points -> boxes)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

LEAF_SIZE = 2

BINS = 12
"""Places along each axis where a split is tried."""

DEEPEST = 24
"""Beyond this depth nodes are halved, which bounds the depth of the whole tree to about 45."""


class BoxTree(NamedTuple):
    """Binary tree of axis-aligned boxes in depth-first order; node 0 is the root."""

    low: NDArray[np.float64]
    """Lower corners [m], shape (k, 3)."""
    high: NDArray[np.float64]
    """Upper corners [m], shape (k, 3)."""
    right: NDArray[np.int32]
    """Right child (the left one is the next node); -1 for a leaf, shape (k,)."""
    first: NDArray[np.int32]
    """First item of a node in ``items``, shape (k,)."""
    size: NDArray[np.int32]
    """Number of items below a node, shape (k,)."""
    items: NDArray[np.int32]
    """Patch indices, shape (m,)."""
    bulge: NDArray[np.float64]
    """How far each patch may be from its flat triangle [m], shape (m,)."""


def build_box_tree(control: NDArray[np.float64]) -> BoxTree:
    """Build the tree over patches; a Bezier patch lies within the box of its control points.

    Args:
        control: Control points [m], shape (m, 6, 3).
    """
    # P - flat = sum of 2 u v e with e an edge's control point beside its middle, and u v + v w + w u <= 1/3.
    middles = 0.5 * (control[:, :3] + np.roll(control[:, :3], -1, axis=1))
    bulge = 2.0 / 3.0 * np.linalg.norm(control[:, 3:] - middles, axis=2).max(axis=1)
    low, high, right, first, size, items = build_boxes(control.min(axis=1), control.max(axis=1))
    return BoxTree(low, high, right, first, size, items, bulge)


@njit(cache=True)
def build_boxes(lows, highs):  # type: ignore[no-untyped-def]
    """Build the tree over boxes, corners (m, 3) [m]: the first six fields of :class:`BoxTree`."""
    count = len(lows)
    centers = 0.5 * (lows + highs)
    items = np.arange(count).astype(np.int32)
    capacity = max(2 * count, 1)
    low, high = np.empty((capacity, 3)), np.empty((capacity, 3))
    right = np.full(capacity, -1, np.int32)
    first, size = np.zeros(capacity, np.int32), np.zeros(capacity, np.int32)
    # Depth first with an explicit stack; a right child tells its parent where it landed.
    stack = np.empty((128, 4), np.int64)
    stack[0] = 0, count, -1, 0
    top, nodes = 1, 0
    while top > 0:
        top -= 1
        begin, end, parent, depth = stack[top]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        first[node], size[node] = begin, end - begin
        _enclose(items[begin:end], lows, highs, low[node], high[node])
        if end - begin <= LEAF_SIZE:
            continue
        middle = _split(items[begin:end], centers, lows, highs) + begin if depth < DEEPEST else begin
        if middle in (begin, end):
            middle = (begin + end) // 2
            axis = np.argmax(high[node] - low[node])
            _select(items, centers[:, axis], begin, end - 1, middle)
        stack[top] = middle, end, node, depth + 1
        stack[top + 1] = begin, middle, -1, depth + 1
        top += 2
    return low[:nodes], high[:nodes], right[:nodes], first[:nodes], size[:nodes], items


@njit(cache=True)
def _enclose(items, lows, highs, low, high):  # type: ignore[no-untyped-def]
    """Write the box around some items' boxes to low and high."""
    low[:], high[:] = np.inf, -np.inf
    for item in items:
        for k in range(3):
            low[k] = min(low[k], lows[item, k])
            high[k] = max(high[k], highs[item, k])


@njit(cache=True)
def _split(items, centers, lows, highs):  # type: ignore[no-untyped-def]
    """Sort items to two sides such that the boxes' areas, weighted by their items, are smallest.

    Large facets beside small ones (a part's flat bottom under its freeform top) end in boxes of their own.

    Returns:
        How many are on the first side; 0 if all centers coincide.
    """
    low, high = np.empty(3), np.empty(3)
    _enclose(items, centers, centers, low, high)
    box_low, box_high = np.empty((BINS, 3)), np.empty((BINS, 3))
    count, cost_left = np.zeros(BINS, np.int64), np.empty(BINS)
    best, best_axis, best_bin = np.inf, -1, -1
    for axis in range(3):
        if high[axis] <= low[axis]:
            continue
        scale = BINS * (1.0 - 1e-9) / (high[axis] - low[axis])
        box_low[:], box_high[:], count[:] = np.inf, -np.inf, 0
        for item in items:
            b = int((centers[item, axis] - low[axis]) * scale)
            count[b] += 1
            for k in range(3):
                box_low[b, k] = min(box_low[b, k], lows[item, k])
                box_high[b, k] = max(box_high[b, k], highs[item, k])
        _sweep(box_low, box_high, count, cost_left)
        box_low[:], box_high[:], count[:] = box_low[::-1].copy(), box_high[::-1].copy(), count[::-1].copy()
        cost_right = np.empty(BINS)
        _sweep(box_low, box_high, count, cost_right)
        for b in range(BINS - 1):
            cost = cost_left[b] + cost_right[BINS - 2 - b]
            if cost < best:
                best, best_axis, best_bin = cost, axis, b
    if best_axis < 0:
        return 0
    scale = BINS * (1.0 - 1e-9) / (high[best_axis] - low[best_axis])
    middle = 0
    for i in range(len(items)):
        if int((centers[items[i], best_axis] - low[best_axis]) * scale) <= best_bin:
            items[i], items[middle] = items[middle], items[i]
            middle += 1
    return middle


@njit(cache=True)
def _sweep(box_low, box_high, count, cost):  # type: ignore[no-untyped-def]
    """Area times number of items of bins 0 .. b, for every b."""
    low, high, total = np.full(3, np.inf), np.full(3, -np.inf), 0
    for b in range(BINS):
        total += count[b]
        for k in range(3):
            low[k], high[k] = min(low[k], box_low[b, k]), max(high[k], box_high[b, k])
        x, y, z = high[0] - low[0], high[1] - low[1], high[2] - low[2]
        cost[b] = total * (x * y + y * z + z * x) if total > 0 else 0.0


@njit(cache=True)
def _select(items, keys, begin, end, wanted):  # type: ignore[no-untyped-def]
    """Quickselect: bring the item of rank ``wanted`` to its place, smaller ones before it."""
    while end > begin:
        pivot = keys[items[(begin + end) // 2]]
        i, j = begin, end
        while i <= j:
            while keys[items[i]] < pivot:
                i += 1
            while keys[items[j]] > pivot:
                j -= 1
            if i <= j:
                items[i], items[j] = items[j], items[i]
                i += 1
                j -= 1
        if wanted <= j:
            end = j
        elif wanted >= i:
            begin = i
        else:
            return


@njit(cache=True, inline="always")
def box_distance2(low, high, node, x, y, z):  # type: ignore[no-untyped-def]
    """Squared distance of a point to a node's box [m^2]."""
    dx = max(low[node, 0] - x, 0.0, x - high[node, 0])
    dy = max(low[node, 1] - y, 0.0, y - high[node, 1])
    dz = max(low[node, 2] - z, 0.0, z - high[node, 2])
    return dx * dx + dy * dy + dz * dz
