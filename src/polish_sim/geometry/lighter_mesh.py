"""A mesh with fewer facets, to look at and not to measure on (vertices, faces -> fewer of both)."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, Ints

GRIDS: Final = (400, 300, 220, 160, 120, 90, 60)
"""Cells across the part on which vertices are gathered, finest first."""


class LighterMesh(NamedTuple):
    """Triangles of a mesh or of a lighter copy."""

    vertices: Array
    """[m], shape (n, 3)."""
    faces: Ints
    """Vertex indices, shape (m, 3)."""


def lighter_mesh(vertices: Array, faces: Ints, most_facets: int) -> LighterMesh:
    """Gather the vertices of a fine mesh on a grid until it has no more facets than wanted.

    Args:
        vertices: [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        most_facets: How many facets are wanted at most; the coarsest grid is taken if none gets there.

    Returns:
        The mesh as it is if it is light enough, else the finest lighter copy that is.
    """
    light = LighterMesh(vertices, faces)
    for cells in GRIDS:
        if len(light.faces) <= most_facets:
            break
        light = _gathered(vertices, faces, float(np.ptp(vertices, axis=0).max()) / cells)
    return light


def _gathered(vertices: Array, faces: Ints, cell: float) -> LighterMesh:
    keys = np.round(vertices / cell).astype(np.int64)
    _, group = np.unique(_one_number(keys - keys.min(axis=0)), return_inverse=True)
    count = np.bincount(group)
    middles = np.stack([np.bincount(group, vertices[:, k]) / count for k in range(3)], axis=1)
    fewer = group[faces]
    fewer = fewer[(fewer != np.roll(fewer, 1, axis=1)).all(axis=1)]
    _, once = np.unique(_one_number(np.sort(fewer, axis=1)), return_index=True)
    return LighterMesh(middles, fewer[np.sort(once)].astype(np.int32))


def _one_number(rows: Indices) -> Indices:
    """A number for each row of three not negative ones, (n, 3) -> (n,): sorts much faster than rows."""
    size = rows.max(axis=0, initial=0) + 1
    return np.asarray((rows[:, 0] * size[1] + rows[:, 1]) * size[2] + rows[:, 2])
