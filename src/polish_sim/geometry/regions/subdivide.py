"""Halve edges of triangles in the parameter domain of their patches, without gaps (Cut, edges -> Cut)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry.clip import Cut

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

_EQUAL = 1.0 + 1e-6
"""Of two diagonals or edges of one length the first is taken, however rounding has it."""


class Edges(NamedTuple):
    """Edges of triangles, each once."""

    ends: Ints
    """Vertex numbers, the lower first, shape (e, 2)."""
    of_facet: Ints
    """Number of the edge from corner k to corner k + 1, shape (m, 3)."""


def find_edges(faces: NDArray[np.int32]) -> Edges:
    """List the edges of triangles, faces (m, 3)."""
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    low, high = np.minimum(start, end), np.maximum(start, end)
    size = int(high.max(initial=0)) + 1
    keys, which = np.unique(low * size + high, return_inverse=True)
    return Edges(np.stack([keys // size, keys % size], axis=1), which.reshape(-1, 3))


def spread_to_longest(edges: Edges, lengths: Floats, marked: Bools) -> Bools:
    """Mark the longest edge of every facet with a marked edge too, so that facets stay well shaped.

    Args:
        edges: The edges.
        lengths: Their lengths [m], shape (e,).
        marked: Edges to be halved, shape (e,).

    Returns:
        The edges to be halved, shape (e,).
    """
    of_facet = lengths[edges.of_facet]
    longest = edges.of_facet[np.arange(len(of_facet)), (of_facet * _EQUAL >= of_facet.max(axis=1)[:, None]).argmax(1)]
    marked = marked.copy()
    while True:
        touched = marked[edges.of_facet].any(axis=1)
        if marked[longest[touched]].all():
            return marked
        marked[longest[touched]] = True


def halve_edges(cut: Cut, places: Floats, edges: Edges, marked: Bools) -> tuple[Cut, Ints]:
    """Halve the marked edges and split the triangles beside them.

    Args:
        cut: The triangles.
        places: Positions of their vertices, which decide between diagonals [m], shape (n, 3).
        edges: Their edges.
        marked: Edges to be halved, shape (e,).

    Returns:
        The triangles, and where the middle of each halved edge is found: rows of (facet, edge) of the triangles
        given, shape (k, 2). New vertices are numbered in that order after the n old ones.
    """
    number = np.full(len(marked), -1, dtype=np.int64)
    number[marked] = len(places) + np.arange(int(marked.sum()))
    halves = marked[edges.of_facet]
    ids = np.concatenate([cut.faces, number[edges.of_facet]], axis=1)
    middles = 0.5 * (cut.barycentric + np.roll(cut.barycentric, -1, axis=1))
    nodes = np.concatenate([cut.barycentric, middles], axis=1)
    rows, corners = [np.flatnonzero(~halves.any(axis=1))], [np.array([[0, 1, 2]])]
    for turn in range(3):
        pattern = np.roll(halves, -turn, axis=1)
        one = np.flatnonzero(pattern[:, 0] & ~pattern[:, 1] & ~pattern[:, 2])
        two = np.flatnonzero(pattern[:, 0] & pattern[:, 1] & ~pattern[:, 2])
        first = _first_diagonal(places, cut, two, turn)
        rows += [one, two[first], two[~first]]
        corners += [_turned(fan, turn) for fan in (_HALVED_ONE, _HALVED_TWO, _HALVED_TWO_OTHERWISE)]
    rows.append(np.flatnonzero(halves.all(axis=1)))
    corners.append(_HALVED_THREE)
    facets = np.concatenate([np.repeat(r, len(c)) for r, c in zip(rows, corners, strict=True)])
    local = np.concatenate([np.tile(c, (len(r), 1)) for r, c in zip(rows, corners, strict=True)])
    parts = Cut(cut.parents[facets], nodes[facets[:, None], local], ids[facets[:, None], local].astype(cut.faces.dtype))
    _, first_at = np.unique(edges.of_facet.ravel(), return_index=True)
    at = first_at[marked]
    return parts, np.stack([at // 3, at % 3], axis=1)


# Corners 0, 1, 2; the middles of edges 0-1, 1-2, 2-0 are 3, 4, 5.
_HALVED_ONE = np.array([[0, 3, 2], [3, 1, 2]])
_HALVED_TWO = np.array([[3, 1, 4], [0, 3, 4], [0, 4, 2]])
_HALVED_TWO_OTHERWISE = np.array([[3, 1, 4], [0, 3, 2], [3, 4, 2]])
_HALVED_THREE = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])


def _turned(fan: Ints, turn: int) -> Ints:
    """The same triangles with corner ``turn`` in place of corner 0."""
    return np.where(fan < 3, (fan + turn) % 3, 3 + (fan + turn) % 3)


def _first_diagonal(places: Floats, cut: Cut, facets: Ints, turn: int) -> Bools:
    """Whether the diagonal from corner 0 to the middle of edge 1 is the shorter one."""
    corner = places[cut.faces[facets][:, [turn, (turn + 1) % 3, (turn + 2) % 3]]]
    one = np.linalg.norm(corner[:, 0] - 0.5 * (corner[:, 1] + corner[:, 2]), axis=1)
    other = np.linalg.norm(corner[:, 2] - 0.5 * (corner[:, 0] + corner[:, 1]), axis=1)
    return np.asarray(one <= _EQUAL * other)
