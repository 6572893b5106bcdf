"""Directions along creases and borders, the same seen from both sides (sharp edges -> tangents at their ends)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

CORNER_ANGLE = np.radians(40.0)
"""A crease that turns by more than this at a vertex has a corner there [rad]."""

STRAIGHT_DOMINANCE = 4.0
"""Where an edge this many times longer meets a short one, the long one is a straight line."""


class CreaseTangents(NamedTuple):
    """Unit directions at both ends of every facet edge, from the lower to the higher vertex index."""

    start: Floats
    """At the end with the lower vertex index, shape (m, 3, 3)."""
    end: Floats
    """At the other end, shape (m, 3, 3)."""
    border: Bools
    """Edges with one facet, shape (m, 3)."""


def crease_tangents(vertices: Floats, faces: Ints, neighbours: Ints, smooth: Bools) -> CreaseTangents:
    """Find the direction of creases and borders at the ends of each edge.

    Where a crease runs through a vertex its direction is that of the circle through the vertex and its two
    neighbours; at a corner it mirrors the edge's other end, so that the edge is an arc.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        neighbours: Facets across edges, -1 at borders, shape (m, 3).
        smooth: Edges that are neither crease nor border, shape (m, 3).

    Returns:
        Directions; on smooth edges they are the chord's.
    """
    low = np.minimum(faces, np.roll(faces, -1, axis=1))
    high = np.maximum(faces, np.roll(faces, -1, axis=1))
    chord = vertices[high] - vertices[low]
    unit_chord = chord / np.linalg.norm(chord, axis=-1, keepdims=True)
    sharp = np.unique(np.column_stack([low[~smooth], high[~smooth]]), axis=0)
    tangent, through = _vertex_tangents(vertices, sharp)
    start, start_known = _oriented(tangent[low], unit_chord), through[low] & ~smooth
    end, end_known = _oriented(tangent[high], unit_chord), through[high] & ~smooth
    start_way = np.where(start_known[..., None], start, unit_chord)
    end_way = np.where(end_known[..., None], end, unit_chord)
    mirrored_start = np.where((end_known & ~start_known)[..., None], _mirror(end, unit_chord), start_way)
    mirrored_end = np.where((start_known & ~end_known)[..., None], _mirror(start, unit_chord), end_way)
    return CreaseTangents(mirrored_start, mirrored_end, neighbours < 0)


def _vertex_tangents(vertices: Floats, sharp: Ints) -> tuple[Floats, Bools]:
    """Direction of the sharp line through each vertex, shape (n, 3), and whether there is one, shape (n,)."""
    count = len(vertices)
    ends = np.concatenate([sharp[:, 0], sharp[:, 1]])
    others = np.concatenate([sharp[:, 1], sharp[:, 0]])
    order = np.argsort(ends, kind="stable")
    degree = np.bincount(ends, minlength=count)
    first = np.concatenate([[0], np.cumsum(degree)[:-1]])
    two = np.flatnonzero(degree == 2)
    before = vertices[two] - vertices[others[order[first[two]]]]
    after = vertices[others[order[first[two] + 1]]] - vertices[two]
    size_before, size_after = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    before, after = before / size_before[:, None], after / size_after[:, None]
    circle = before / size_before[:, None] + after / size_after[:, None]
    long_before = size_before > STRAIGHT_DOMINANCE * size_after
    long_after = size_after > STRAIGHT_DOMINANCE * size_before
    direction = np.where(long_before[:, None], before, np.where(long_after[:, None], after, circle))
    tangent = np.zeros((count, 3))
    tangent[two] = direction / np.maximum(np.linalg.norm(direction, axis=1), 1e-300)[:, None]
    through = np.zeros(count, dtype=bool)
    through[two] = (before * after).sum(axis=1) > np.cos(CORNER_ANGLE)
    return tangent, through


def _oriented(tangents: Floats, chords: Floats) -> Floats:
    return np.where((tangents * chords).sum(axis=-1, keepdims=True) < 0.0, -tangents, tangents)


def _mirror(directions: Floats, chords: Floats) -> Floats:
    """Direction at the other end of a circular arc over the chord."""
    return 2.0 * (directions * chords).sum(axis=-1, keepdims=True) * chords - directions
