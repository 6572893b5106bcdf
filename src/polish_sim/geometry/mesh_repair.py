"""Repairs of a triangle soup that need no guessing: drop empty facets, turn facets outward (faces -> faces)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.topology import find_adjacency, find_edge_faults
from polish_sim.geometry.winding import wind_consistently

SLIVER = 1e-6
"""Facets lower than this share of the part's size have no meaningful normal."""

_FLIP_ROUNDS = 10

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


def drop_bad_facets(vertices: Floats, faces: Ints, path: Path) -> tuple[Ints, Ints, tuple[str, ...]]:
    """Drop facets whose corners coincide and facets that occur twice.

    Returns:
        Faces kept, their numbers among those given, notes.

    Raises:
        MeshError: No facet has an area.
    """
    if (facet_heights(vertices, faces) <= SLIVER * float(np.ptp(vertices, axis=0).max())).all():
        raise MeshError(
            f"{path}: all {len(faces)} facets have zero area (all points on a line or in one place). "
            "Export the part again."
        )
    numbers = np.flatnonzero((faces != np.roll(faces, 1, axis=1)).all(axis=1))
    _, first = np.unique(np.sort(faces[numbers], axis=1), axis=0, return_index=True)
    once = numbers[np.sort(first)]
    counts = ((len(faces) - len(numbers), "without area"), (len(numbers) - len(once), "that occur twice"))
    return faces[once], once.astype(np.int32), tuple(f"dropped {count} facets {why}" for count, why in counts if count)


def flip_slivers(vertices: Floats, faces: Ints) -> tuple[Ints, tuple[str, ...]]:
    """Turn the long edge of facets without height, so that the skin stays closed without them.

    A corner that lies on its facet's long edge is connected to the facet beyond that edge instead.
    """
    limit = SLIVER * float(np.ptp(vertices, axis=0).max())
    faces, flips = faces.copy(), 0
    for _ in range(_FLIP_ROUNDS):
        heights = facet_heights(vertices, faces)
        slivers = np.flatnonzero(heights <= limit)
        adjacency = find_adjacency(faces) if len(slivers) else None
        done: set[int] = set()
        for facet in slivers:
            assert adjacency is not None
            edge = int(_edge_lengths(vertices, faces[facet]).argmax())
            other = int(adjacency.facets[facet, edge])
            if other < 0 or done & {int(facet), other}:
                continue
            a, c, b = np.roll(faces[facet], -edge)
            d = faces[other, (adjacency.edges[facet, edge] + 2) % 3]
            pair = np.array([[b, a, d], [c, b, d]], dtype=np.int32)
            if b == d or facet_heights(vertices, pair).min() <= heights[facet]:
                continue
            faces[facet], faces[other] = pair
            done |= {int(facet), other}
        flips += len(done) // 2
        if not done:
            break
    return faces, ((f"flipped the long edge of {flips} facets without height",) if flips else ())


def facet_heights(vertices: Floats, faces: Ints) -> Floats:
    """Smallest height of each facet [m], shape (m,)."""
    longest = _edge_lengths(vertices, faces).max(axis=-1)
    return np.linalg.norm(_area_vectors(vertices, faces), axis=1) / np.maximum(longest, 1e-300)


def _edge_lengths(vertices: Floats, faces: Ints) -> Floats:
    return np.linalg.norm(vertices[np.roll(faces, -1, axis=-1)] - vertices[faces], axis=-1)


def orient_outward(vertices: Floats, faces: Ints, path: Path) -> tuple[Ints, tuple[str, ...]]:
    """Wind all facets of a piece alike, and outward where the piece is closed.

    Raises:
        MeshError: The surface has only one side (a Moebius strip), so no winding is right.
    """
    wound, flips, two_sided = wind_consistently(faces)
    if not two_sided:
        raise MeshError(f"{path}: the surface is one-sided (like a Moebius strip). Repair the part.")
    notes = [f"turned {flips} facets that were wound the other way"] if flips else []
    volume = _signed_volume(vertices, wound)
    if find_edge_faults(wound).open == 0 and volume < 0:
        wound = np.ascontiguousarray(wound[:, ::-1])
        notes.append("turned the whole part inside out: its normals pointed inward")
    return wound, tuple(notes)


def _area_vectors(vertices: Floats, faces: Ints) -> Floats:
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.cross(b - a, c - a)


def _signed_volume(vertices: Floats, faces: Ints) -> float:
    """Volume enclosed by a closed mesh [m^3], negative when its facets are wound inward."""
    centred = vertices - vertices.mean(axis=0)
    return float((centred[faces[:, 0]] * _area_vectors(centred, faces)).sum() / 6.0)
