"""What hangs together in a triangulation: pieces, triangles around vertices, edges at its border; compiled."""

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


@njit(cache=True, error_model="numpy")
def triangles_by_vertex(triangles, count):  # type: ignore[no-untyped-def]
    """Triangles vertex by vertex.

    Args:
        triangles: Vertex indices, shape (m, 3).
        count: Number of vertices.

    Returns:
        Where the triangles around each vertex begin, shape (count + 1,), and they, shape (3 m,).
    """
    starts = np.zeros(count + 1, np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            starts[triangles[t, k] + 1] += 1
    for v in range(count):
        starts[v + 1] += starts[v]
    place, members = starts.copy(), np.empty(3 * len(triangles), np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            v = triangles[t, k]
            members[place[v]] = t
            place[v] += 1
    return starts, members


@njit(cache=True, error_model="numpy")
def lonely_edges(triangles, starts, members):  # type: ignore[no-untyped-def]
    """Which edges have a triangle on one side only.

    Args:
        triangles: Vertex indices, shape (m, 3).
        starts: Where the triangles around each vertex begin, shape (n + 1,).
        members: They, shape (3 m,).

    Returns:
        Whether no other triangle has the edge from corner k to k + 1, shape (m, 3).
    """
    lonely = np.ones(triangles.shape, np.bool_)
    for t in range(len(triangles)):
        for k in range(3):
            a, b = triangles[t, k], triangles[t, (k + 1) % 3]
            for j in range(starts[a], starts[a + 1]):
                other = members[j]
                if other != t and (triangles[other, 0] == b or triangles[other, 1] == b or triangles[other, 2] == b):
                    lonely[t, k] = False
    return lonely
