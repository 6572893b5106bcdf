"""A triangle skin under repair, and the merging of a triangle soup to one (triangles -> vertices and
faces)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, Ints, longest_side
from polish_sim.errors import place_in_mm
from polish_sim.geometry.topology import find_edge_faults, label_pieces

WELD = 1e-5  #: Gaps up to this share of the part's size are closed when exact merging leaves the mesh open


class ScanNoise(NamedTuple):
    """What a scan leaves unknown of a surface after smoothing, rms; 0 of one that is not scanned."""

    offset: float = 0.0  #: Of its places along the normal [m]
    slope: float = 0.0  #: Of its normals [rad]


NOISELESS = ScanNoise()


class Skin(NamedTuple):
    """Vertices and facets, and the repairs made so far."""

    vertices: Array  #: Vertices [m], shape (n, 3); some may be unused
    faces: Ints  #: Vertex indices, shape (m, 3)
    #: The triangle of the file each facet stems from, -1 for facets that close holes, shape (m,)
    source: Ints
    notes: tuple[str, ...] = ()  #: What was repaired, for the user
    noise: ScanNoise = NOISELESS  #: Of a scan, what smoothing left of it

    @property
    def size(self) -> float:
        """Longest side of the bounding box of the vertices in use [m]."""
        return longest_side(self.vertices[np.unique(self.faces)])

    def keep(self, kept: Bools | Ints, note: str) -> Skin:
        """The skin with these facets only, and a note about it."""
        return Skin(self.vertices, self.faces[kept], self.source[kept], (*self.notes, note))


def place(points: Array) -> str:
    """The middle of points (k, 3) [m], for messages."""
    return place_in_mm(points.reshape(-1, 3).mean(axis=0))


def merge_vertices(triangles: Array) -> tuple[Array, Ints, tuple[str, ...]]:
    """Merge equal corners of a triangle soup (m, 3, 3) [m]; weld tiny gaps if that makes the mesh less open.

    The vertices (n, 3) [m] are in the order of their first appearance.
    """
    corners = np.ascontiguousarray(triangles.reshape(-1, 3)) + 0.0  # -0.0 and 0.0 are the same place
    first, index = number_rows(corners.view(np.uint64))
    vertices = corners[first]
    faces = index.reshape(-1, 3)
    gaps = find_edge_faults(faces).open
    if gaps == 0:
        return vertices, faces, ()
    tolerance = WELD * longest_side(vertices)
    welded = _weld(vertices, faces, tolerance)
    collapsed = (welded == np.roll(welded, 1, axis=1)).any(axis=1)
    faults = find_edge_faults(welded[~collapsed])
    if faults.open >= gaps or faults.crowded > find_edge_faults(faces).crowded:
        return vertices, faces, ()
    return (
        vertices,
        welded,
        (f"closed gaps up to {tolerance * 1e3:.1g} mm at {gaps - faults.open} border edges",),
    )


def number_rows(rows: NDArray[np.uint64]) -> tuple[Indices, Ints]:
    """Number equal rows alike in the order of appearance: each number's first row (k,), each row's number
    (n,)."""
    mixed = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        mixed = (mixed ^ column) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    _, first, index = np.unique(mixed, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first[index]], rows):  # two rows mixed to one number
        _, first, index = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty(len(order), dtype=np.int32)
    rank[order] = np.arange(len(order))
    return first[order], rank[index.ravel()]


def _weld(vertices: Array, faces: Ints, tolerance: float) -> Ints:
    # Vertices of a damaged file crowd by the thousand: one of those within a hundredth stands for all.
    first, index = number_rows(np.rint(100.0 / tolerance * vertices).view(np.uint64))
    pairs = cKDTree(vertices[first]).query_pairs(tolerance, output_type="ndarray")
    labels = label_pieces(pairs, len(first))[1][index]
    representative = np.unique(labels, return_index=True)[1].astype(np.int32)
    return representative[labels][faces]
