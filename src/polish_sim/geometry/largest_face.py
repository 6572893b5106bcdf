"""The largest smooth face of a part and where it looks, whatever way the part is turned (mesh -> direction).

Nothing here refers to the coordinate axes: candidates are the mesh's own normals, ties go to the face with more
facets and then to the later one in the file (most programs write the bottom first).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry.features import facet_normals, smooth_edges
from polish_sim.geometry.topology import Adjacency, facet_links, find_adjacency, label_pieces

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

_SAMPLE = 20_000
"""Facets from which candidate directions are drawn."""

_LEADER_ANGLE = np.radians(23.7)
"""Every facet of the sample looks within this angle of a candidate [rad]."""

_APART = np.radians(5.0)
"""Candidates closer than this are one [rad]."""

_BUCKET = 1.05
"""Candidates whose bounds differ by less than this factor are tried in the order of the file."""

_SAME = 1e-3
"""Areas this close are equal, relative."""

_TRIES = 8
"""Candidates tried on the whole mesh at most."""

_SHIFTS = 3
"""Times a direction is moved to the mean normal of what it sees."""


class FacetGraph(NamedTuple):
    """A mesh made ready for looking at it from many sides: facets, and which of them are joined smoothly."""

    normals: Floats
    """Unit normals of the facets, shape (m, 3)."""
    areas: Floats
    """Areas of the facets [m^2], shape (m,)."""
    adjacency: Adjacency
    """Neighbours across edges."""
    links: NDArray[np.int64]
    """Pairs of facets joined smoothly, each once, shape (k, 2)."""


class Face(NamedTuple):
    """A smooth face as seen from one side."""

    direction: Floats
    """Unit mean normal, shape (3,)."""
    area: float
    """Area [m^2]."""
    facets: int
    """Number of its facets."""


def facet_graph(vertices: Floats, faces: Ints) -> FacetGraph:
    """Prepare a mesh, vertices (n, 3) [m] and faces (m, 3)."""
    normals, areas = facet_normals(vertices, faces)
    adjacency = find_adjacency(faces)
    links = facet_links(adjacency, smooth_edges(normals, adjacency))
    return FacetGraph(normals, areas, adjacency, links[links[:, 0] < links[:, 1]])


def largest_face(graph: FacetGraph, cone: float) -> Face:
    """Find the largest set of smoothly joined facets that look within a cone about their mean normal.

    Args:
        graph: The mesh.
        cone: Half angle of the cone [rad].

    Returns:
        The face.
    """
    candidates, bounds = _candidates(graph, cone)
    order = np.argsort(-np.floor(np.log(bounds / bounds.max()) / np.log(_BUCKET) + 1e-9), kind="stable")
    found: list[tuple[int, Face]] = []
    best = 0.0
    for at in order[:_TRIES]:
        # The bound counts all facets that look this way, joined or not; it is drawn from a sample.
        if _BUCKET * bounds[at] < best:
            continue
        face = _settle(graph, candidates[at], cone, 1)
        found.append((int(at), face))
        best = max(best, face.area)
    level = [(at, face) for at, face in found if face.area >= (1.0 - _SAME) * best]
    chosen = max(level, key=lambda pair: (pair[1].facets, pair[0]))[1]
    return _settle(graph, chosen.direction, cone, _SHIFTS)


def _candidates(graph: FacetGraph, cone: float) -> tuple[Floats, Floats]:
    """Directions many facets look in, in the order of the file, and the area that looks so, (c, 3) and (c,)."""
    step = max(len(graph.areas) // _SAMPLE, 1)
    normals, areas = graph.normals[::step], graph.areas[::step] * step
    leaders: list[Floats] = []
    left = areas > 0.0
    while left.any():
        direction = normals[int(left.argmax())]
        left &= normals @ direction < np.cos(_LEADER_ANGLE)
        for _ in range(_SHIFTS):
            direction = _mean(normals, areas * (normals @ direction > np.cos(cone)), direction)
        if all(direction @ other < np.cos(_APART) for other in leaders):
            leaders.append(direction)
    directions = np.array(leaders)
    bounds = np.array([areas[normals @ direction > np.cos(cone)].sum() for direction in directions])
    return directions, np.maximum(bounds, 1e-300)


def _settle(graph: FacetGraph, direction: Floats, cone: float, rounds: int) -> Face:
    """Turn a direction to the mean normal of the largest face seen from it."""
    face = Face(direction, 0.0, 0)
    for _ in range(rounds):
        looks = graph.normals @ direction > np.cos(cone)
        if not looks.any():
            break
        links = graph.links[looks[graph.links[:, 0]] & looks[graph.links[:, 1]]]
        labels = label_pieces(links, len(looks))[1]
        sizes: Floats = np.bincount(labels, weights=np.where(looks, graph.areas, 0.0)).astype(np.float64)
        piece = labels == _first_largest(sizes)
        direction = _mean(graph.normals, np.where(piece, graph.areas, 0.0), direction)
        face = Face(direction, float(sizes.max()), int(np.count_nonzero(piece)))
    return face


def _first_largest(sizes: Floats) -> int:
    """The first of the (nearly) largest, so that rounding does not choose."""
    return int(np.flatnonzero(sizes >= (1.0 - _SAME) * sizes.max())[0])


def _mean(normals: Floats, weights: Floats, otherwise: Floats) -> Floats:
    total = weights @ normals
    length = float(np.linalg.norm(total))
    return np.asarray(total / length) if length > 1e-9 * float(weights.sum()) else otherwise
