"""A tree of boxes over patches, to find the few a point could be closest to (control points -> boxes)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

LEAF_SIZE = 2


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
    low, high, right, first, size, items = _build(control.min(axis=1), control.max(axis=1))
    return BoxTree(low, high, right, first, size, items, bulge)


@njit(cache=True)
def _build(lows, highs):  # type: ignore[no-untyped-def]
    count = len(lows)
    centers = 0.5 * (lows + highs)
    items = np.arange(count).astype(np.int32)
    capacity = max(2 * count, 1)
    low, high = np.empty((capacity, 3)), np.empty((capacity, 3))
    right = np.full(capacity, -1, np.int32)
    first, size = np.zeros(capacity, np.int32), np.zeros(capacity, np.int32)
    # Depth first with an explicit stack; a right child tells its parent where it landed.
    stack = np.empty((128, 3), np.int64)
    stack[0] = 0, count, -1
    top, nodes = 1, 0
    while top > 0:
        top -= 1
        begin, end, parent = stack[top]
        node = nodes
        nodes += 1
        if parent >= 0:
            right[parent] = node
        first[node], size[node] = begin, end - begin
        spread_low, spread_high = np.full(3, np.inf), np.full(3, -np.inf)
        for k in range(3):
            low[node, k], high[node, k] = np.inf, -np.inf
        for i in range(begin, end):
            item = items[i]
            for k in range(3):
                low[node, k] = min(low[node, k], lows[item, k])
                high[node, k] = max(high[node, k], highs[item, k])
                spread_low[k] = min(spread_low[k], centers[item, k])
                spread_high[k] = max(spread_high[k], centers[item, k])
        if end - begin <= LEAF_SIZE:
            continue
        axis = np.argmax(spread_high - spread_low)
        middle = (begin + end) // 2
        _select(items, centers[:, axis], begin, end - 1, middle)
        stack[top] = middle, end, node
        stack[top + 1] = begin, middle, -1
        top += 2
    return low[:nodes], high[:nodes], right[:nodes], first[:nodes], size[:nodes], items


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
