"""Which places of the region the path passes within 0.55 step-overs: the strict coverage (path -> mask, shares)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.ground.triangulation import Triangulation
from polish_sim.planning.quality.strands import Strands

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STRICT = 0.55
"""A place counts as covered if the path passes within this many step-overs."""
CHORD = 0.15
"""Length of the chords the path is measured by, in step-overs."""


SAMPLES = 100_000
"""The share of area is counted on so many points, one in each equal share of the region's area."""


def strictly_covered(points: Array, normals: Array, runs: Sequence[Curve], stepover: float) -> Mask:
    """Places within 0.55 step-overs of the path, on its side of the part.

    Args:
        points: Places [m], shape (k, 3).
        normals: Unit surface normals there, shape (k, 3).
        runs: Each run in contact, an open curve.
        stepover: [m].

    Returns:
        Mask over the points, shape (k,).
    """
    path = Strands(runs).sample(CHORD * stepover)
    limit = STRICT * stepover
    reach = float(np.hypot(limit, 0.5 * CHORD * stepover))
    found, index = cKDTree(path.points).query(points, distance_upper_bound=reach)
    rows = np.flatnonzero(np.isfinite(found))
    near = index[rows]
    same_side = (path.normals[near] * normals[rows]).sum(axis=1) > 0.0
    rows, near = rows[same_side], near[same_side]
    distance = found[rows]
    low, high = path.first[path.run[near]], path.first[path.run[near] + 1] - 1
    for other in (np.maximum(near - 1, low), np.minimum(near + 1, high)):
        chord = path.points[other] - path.points[near]
        away = points[rows] - path.points[near]
        share = (away * chord).sum(axis=1) / np.maximum((chord**2).sum(axis=1), 1e-300)
        foot = np.clip(share, 0.0, 1.0)[:, None] * chord
        distance = np.minimum(distance, np.linalg.norm(away - foot, axis=1))
    covered = np.zeros(len(points), dtype=bool)
    covered[rows[distance <= limit]] = True
    return covered


def strict_share(mesh: Triangulation, part_facets: int, runs: Sequence[Curve], stepover: float) -> float:
    """Share of the region's area within 0.55 step-overs of the path, closed holes left out.

    Counted on points spread within every triangle: the vertices alone stand in rows, as paths do.

    Args:
        mesh: The region.
        part_facets: Number of facets that are the part's; those after them close holes.
        runs: Each run in contact, an open curve.
        stepover: [m].

    Returns:
        The share, 0 to 1.
    """
    own = np.flatnonzero(mesh.owners < part_facets)
    ends = np.cumsum(mesh.areas[own])
    # One point anywhere in each of so many equal shares of the area: regular steps would fall into step with the rows
    # of a regular mesh. Always the same points.
    jitter, first, second = np.random.default_rng(0).random((3, SAMPLES))
    marks = (np.arange(SAMPLES) + jitter) / SAMPLES * ends[-1]
    triangle = own[np.minimum(np.searchsorted(ends, marks), len(own) - 1)]
    folded = first + second > 1.0
    first, second = np.where(folded, 1.0 - first, first), np.where(folded, 1.0 - second, second)
    weights = np.stack([first, second, 1.0 - first - second], axis=1)[:, :, None]
    corners = mesh.triangles[triangle]
    points, normals = ((weights * values[corners]).sum(axis=1) for values in (mesh.vertices, mesh.normals))
    return float(strictly_covered(points, normals, runs, stepover).mean())
