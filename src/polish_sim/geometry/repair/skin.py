"""A triangle skin under repair: what the repairs pass on to each other (mesh repairs)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.errors import place_in_mm
from polish_sim.geometry.topology import find_edge_faults, label_pieces
from polish_sim.kernel_cache import njit

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


class Skin(NamedTuple):
    """Vertices and facets, and what was done to them so far."""

    vertices: Floats
    """Vertices [m], shape (n, 3); some may be unused."""
    faces: Ints
    """Vertex indices, shape (m, 3)."""
    source: Ints
    """The triangle of the file each facet stems from, -1 for facets that close holes, shape (m,)."""
    notes: tuple[str, ...] = ()
    """What was repaired, for the user."""

    @property
    def size(self) -> float:
        """Longest side of the bounding box of the vertices in use [m]."""
        return float(np.ptp(self.vertices[np.unique(self.faces)], axis=0).max())

    def keep(self, kept: NDArray[np.bool_] | Ints, *notes: str) -> Skin:
        """The skin with these facets only, and notes about it."""
        return Skin(self.vertices, self.faces[kept], self.source[kept], (*self.notes, *notes))


def place(points: Floats) -> str:
    """Where something is, for messages: the middle of its points (k, 3) [m]."""
    return place_in_mm(points.reshape(-1, 3).mean(axis=0))


# Merge the corners of a triangle soup to vertices, and weld tiny gaps (triangles -> vertices and faces).

WELD = 1e-5
"""Gaps up to this share of the part's size are closed when exact merging leaves the mesh open."""


def merge_vertices(triangles: Floats) -> tuple[Floats, Ints, tuple[str, ...]]:
    """Merge equal corners of a triangle soup; weld tiny gaps if that makes the mesh less open.

    Args:
        triangles: Corners [m], shape (m, 3, 3).

    Returns:
        Vertices [m] in the order of their first appearance, shape (n, 3); faces, shape (m, 3); notes.
    """
    vertices, faces = merge_equal(triangles)
    gaps = find_edge_faults(faces).open
    if gaps == 0:
        return vertices, faces, ()
    tolerance = WELD * float(np.ptp(vertices, axis=0).max())
    welded = _weld(vertices, faces, tolerance)
    collapsed = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    faults = find_edge_faults(welded[~collapsed])
    if faults.open >= gaps or faults.crowded > find_edge_faults(faces).crowded:
        return vertices, faces, ()
    return vertices, welded, (f"closed gaps up to {tolerance * 1e3:.1g} mm at {gaps - faults.open} border edges",)


def merge_equal(triangles: Floats) -> tuple[Floats, Ints]:
    """Number equal corners alike, in the order of their first appearance."""
    corners = np.ascontiguousarray(triangles.reshape(-1, 3)) + 0.0  # -0.0 and 0.0 are the same place
    first, index = number_rows(corners.view(np.uint64))
    return corners[first], index.reshape(-1, 3)


def number_rows(rows: NDArray[np.uint64]) -> tuple[NDArray[np.int64], Ints]:
    """Number equal rows alike: where each number first appears (k,), and the number of each row (n,)."""
    index = np.empty(len(rows), np.int32)
    return _number(rows, index, 1 << int(2 * len(rows)).bit_length()), index


@njit(cache=True, error_model="numpy")
def _number(bits, index, slots):  # type: ignore[no-untyped-def]
    """Number rows of bits (n, 3) through an open hash table; returns each number's first row."""
    table = np.full(slots, -1, np.int32)
    first = np.empty(len(bits), np.int64)
    mask, count = np.uint64(slots - 1), 0
    for row in range(len(bits)):
        mixed = np.uint64(0x9E3779B97F4A7C15)
        for k in range(3):
            mixed = (mixed ^ bits[row, k]) * np.uint64(0xBF58476D1CE4E5B9)
            mixed ^= mixed >> np.uint64(29)
        slot = mixed & mask
        while table[slot] >= 0:
            other = first[table[slot]]
            if bits[row, 0] == bits[other, 0] and bits[row, 1] == bits[other, 1] and bits[row, 2] == bits[other, 2]:
                break
            slot = (slot + np.uint64(1)) & mask
        if table[slot] < 0:
            table[slot], first[count] = count, row
            count += 1
        index[row] = table[slot]
    return first[:count]


def _weld(vertices: Floats, faces: Ints, tolerance: float) -> Ints:
    pairs = cKDTree(vertices).query_pairs(tolerance, output_type="ndarray")
    pieces, labels = label_pieces(pairs.astype(np.int64), len(vertices))
    representative = np.full(pieces, -1, dtype=np.int32)
    representative[labels[::-1]] = np.arange(len(vertices) - 1, -1, -1, dtype=np.int32)
    return representative[labels][faces]
