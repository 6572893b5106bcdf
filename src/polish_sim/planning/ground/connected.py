"""Connected pieces of a set of vertices of a triangulation (triangles and mask -> labels)."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def label_pieces(triangles, inside):  # type: ignore[no-untyped-def]
    """Number the connected pieces of a set of vertices, in the order of their first vertices.

    Args:
        triangles: Vertex indices, shape (m, 3).
        inside: The set, shape (n,).

    Returns:
        The number of pieces, and each vertex's piece, -1 outside, shape (n,).
    """
    parent = np.arange(len(inside))
    for t in range(len(triangles)):
        for k in range(3):
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]
            if inside[a] and inside[b]:
                a, b = _root(parent, a), _root(parent, b)
                parent[max(a, b)] = min(a, b)
    labels = np.full(len(inside), -1, np.int64)
    count = 0
    for v in range(len(inside)):
        if inside[v]:
            root = _root(parent, v)
            if root == v:
                labels[v] = count
                count += 1
            else:
                labels[v] = labels[root]
    return count, labels


@njit(cache=True, error_model="numpy", inline="always")
def _root(parent, v):  # type: ignore[no-untyped-def]
    """Representative of a vertex's piece; the way there is halved for the next time."""
    while parent[v] != v:
        parent[v] = parent[parent[v]]
        v = parent[v]
    return v
