"""Which places of the region the path passes within 0.55 step-overs: the strict coverage (path -> mask, shares)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curve import Curve
from polish_sim.planning.strands import Strands
from polish_sim.planning.triangulation import Triangulation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STRICT = 0.55
"""A place counts as covered if the path passes within this many step-overs."""
CHORD = 0.15
"""Length of the chords the path is measured by, in step-overs."""


def strictly_covered(mesh: Triangulation, runs: Sequence[Curve], stepover: float) -> Mask:
    """Vertices within 0.55 step-overs of the path, on its side of the part.

    Args:
        mesh: The region.
        runs: Each run in contact, an open curve.
        stepover: [m].

    Returns:
        Mask over the vertices, shape (k,).
    """
    path = Strands(runs).sample(CHORD * stepover)
    limit = STRICT * stepover
    reach = float(np.hypot(limit, 0.5 * CHORD * stepover))
    found, index = cKDTree(path.points).query(mesh.vertices, distance_upper_bound=reach)
    rows = np.flatnonzero(np.isfinite(found))
    near = index[rows]
    rows, near = (a[(path.normals[near] * mesh.normals[rows]).sum(axis=1) > 0.0] for a in (rows, near))
    distance = found[rows]
    low, high = path.first[path.run[near]], path.first[path.run[near] + 1] - 1
    for other in (np.maximum(near - 1, low), np.minimum(near + 1, high)):
        chord = path.points[other] - path.points[near]
        away = mesh.vertices[rows] - path.points[near]
        share = (away * chord).sum(axis=1) / np.maximum((chord**2).sum(axis=1), 1e-300)
        foot = np.clip(share, 0.0, 1.0)[:, None] * chord
        distance = np.minimum(distance, np.linalg.norm(away - foot, axis=1))
    covered = np.zeros(len(mesh.vertices), dtype=bool)
    covered[rows[distance <= limit]] = True
    return covered


def share_of_area(areas: Array, covered: Mask) -> float:
    """Share of the area around covered vertices; areas [m^2] and mask (n,)."""
    return float(areas[covered].sum() / areas.sum())
