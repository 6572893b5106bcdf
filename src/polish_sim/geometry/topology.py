"""How facets hang together: neighbours across edges, borders, connected pieces (faces -> adjacency)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from polish_sim.arrays import Array, Bools, Indices, Ints


class Adjacency(NamedTuple):
    """Neighbours across the three edges of each facet; edge e runs from corner e to corner e + 1."""

    facets: Ints  #: Facet on the other side, -1 at a border, shape (m, 3)
    edges: Ints  #: Which edge of that facet it is, -1 at a border, shape (m, 3)


class EdgeFaults(NamedTuple):
    """Edges at which a mesh is not the skin of a body."""

    open: int  #: Edges with one facet
    crowded: int  #: Edges with more than two facets
    first_crowded: Ints  #: Vertices of the first crowded edge, shape (2,) or (0,)


def find_adjacency(faces: Ints) -> Adjacency:
    """Find the neighbour of each of some consistently wound facets (m, 3) across each edge, and that edge,
    (m, 3) each.

    Edges that are not shared by exactly two oppositely running facets count as borders.
    """
    start, end, order, key = sorted_half_edges(faces)
    a, b = paired_half_edges(order, key)
    opposite = start[a] == end[b]
    a, b = a[opposite], b[opposite]
    facets = np.full(3 * len(faces), -1, dtype=np.int32)
    edges = facets.copy()
    facets[a], facets[b] = b // 3, a // 3
    edges[a], edges[b] = b % 3, a % 3
    return Adjacency(facets.reshape(-1, 3), edges.reshape(-1, 3))


def find_edge_faults(faces: Ints) -> EdgeFaults:
    """Count the edges where the mesh is open or crowded."""
    start, end, order, key = sorted_half_edges(faces)
    begins, counts = equal_runs(key)
    crowded = order[begins[counts > 2]]
    example = np.array([start[crowded[0]], end[crowded[0]]]) if len(crowded) else np.empty(0)
    return EdgeFaults(int((counts == 1).sum()), len(crowded), example.astype(np.int32))


def paired_half_edges(order: Indices, key: Indices) -> tuple[Indices, Indices]:
    """Both half-edges of every edge that has exactly two; see `sorted_half_edges`."""
    begins, counts = equal_runs(key)
    pairs = begins[counts == 2]
    return order[pairs], order[pairs + 1]


def facets_at_edges(faces: Ints | Indices) -> Indices:
    """How many facets share each edge of each facet, shape (m, 3)."""
    _, _, order, key = sorted_half_edges(faces)
    lengths = equal_runs(key)[1]
    counts = np.empty(len(order), dtype=np.int64)
    counts[order] = np.repeat(lengths, lengths)
    return counts.reshape(-1, 3)


def label_pieces(links: Indices | Ints, count: int) -> tuple[int, Ints]:
    """Label connected pieces of a graph of ``count`` nodes by its links (k, 2): how many, and each node's
    label."""
    graph = coo_array((np.ones(len(links), dtype=bool), (links[:, 0], links[:, 1])), shape=(count, count))
    pieces, labels = connected_components(graph, directed=False)
    return pieces, labels.astype(np.int32)


def extremes(labels: Ints, low: Array, high: Array, count: int) -> tuple[Array, Array]:
    """Least of some values and greatest of others, rows (n, ...), over those of each of ``count`` labels
    (n,)."""
    least, most = np.full((count, *low.shape[1:]), np.inf), np.full((count, *high.shape[1:]), -np.inf)
    np.minimum.at(least, labels, low)
    np.maximum.at(most, labels, high)
    return least, most


def corner_fans(adjacency: Adjacency, passable: Bools) -> tuple[int, Ints]:
    """Gather facet corners around each vertex across passable edges (m, 3): how many fans, each corner's (m,
    3)."""
    facet, edge = np.nonzero(passable)
    other, other_edge = adjacency.facets[facet, edge], adjacency.edges[facet, edge]
    here = np.concatenate([3 * facet + edge, 3 * facet + (edge + 1) % 3], dtype=np.int32)
    there = np.concatenate([3 * other + (other_edge + 1) % 3, 3 * other + other_edge], dtype=np.int32)
    count, labels = label_pieces(np.stack([here, there], axis=1), adjacency.facets.size)
    return count, labels.reshape(-1, 3)


def trace_border(adjacency: Adjacency) -> list[Indices]:
    """Border edges, rows of (facet, edge) in the order one walks along them, loop by loop, each (k, 2)."""
    loops, walked = [], set()
    for start in map(tuple, np.argwhere(adjacency.facets < 0).tolist()):
        loop, here = [], start
        while here not in walked:
            walked.add(here)
            loop.append(here)
            facet, edge = here[0], (here[1] + 1) % 3
            # Turn around the edge's end, from facet to facet, until the border is met again.
            while (other := int(adjacency.facets[facet, edge])) >= 0:
                facet, edge = other, (int(adjacency.edges[facet, edge]) + 1) % 3
            here = facet, edge
        if loop:
            loops.append(np.array(loop, dtype=np.int64))
    return loops


def label_within(links: Indices, inside: Bools) -> tuple[int, Indices]:
    """Label connected pieces of the nodes ``inside`` (n,) by links (k, 2): how many; each node's, -1 outside,
    (n,)."""
    labels = np.full(len(inside), -1, dtype=np.int64)
    number = np.cumsum(inside) - 1
    count, labels[inside] = label_pieces(number[links[inside[links].all(axis=1)]], inside.sum())
    return count, labels


def facet_links(adjacency: Adjacency, keep: Bools | None = None) -> Indices:
    """List pairs of neighbouring facets, shape (k, 2); ``keep`` (m, 3) marks the edges that count."""
    linked = adjacency.facets >= 0
    if keep is not None:
        linked &= keep
    facet, edge = np.nonzero(linked)
    return np.column_stack([facet, adjacency.facets[facet, edge]])


def sorted_half_edges(faces: Any) -> tuple[Any, Any, Indices, Indices]:
    """Half-edges in facet order (start, end), and the order and keys that bring equal edges together."""
    start, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    count = int(start.max(initial=0)) + 1
    order = counting_order(high, count)
    order = order[counting_order(low[order], count)]
    return start, end, order, low[order] * np.int64(count) + high[order]


def counting_order(keys: Ints | Indices, count: int) -> Indices:
    """Stable order of numbers below ``count``, in linear time: the rows of a sparse matrix."""
    at = np.arange(len(keys), dtype=np.int32)
    return coo_array((at, (keys, at)), shape=(count, len(keys))).tocsr().data


def equal_runs(sorted_key: Indices) -> tuple[Indices, Indices]:
    """Where each run of equal keys begins, and how long it is."""
    begins = np.flatnonzero(np.concatenate([[True], sorted_key[1:] != sorted_key[:-1]]))
    return begins, np.diff(begins, append=len(sorted_key))
