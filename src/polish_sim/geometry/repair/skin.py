"""A triangle skin under repair: what the repairs pass on to each other (mesh repairs)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import place_in_mm

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
