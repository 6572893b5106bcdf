"""Which way the part is turned up: as named, along a vector, or its largest smooth face up (mesh -> up)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, Ints
from polish_sim.errors import InputError, unknown_name
from polish_sim.geometry.features import facet_normals, flat_faces, smooth_edges
from polish_sim.geometry.topology import Adjacency, facet_links, find_adjacency, label_pieces
from polish_sim.scenario_file import numbers_of

SIDES = {
    "z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
}
"""Unit vectors of the six sides."""

#: A facet looks up when its normal is within this angle of up [rad]; a 45 deg slope does
UP_CONE = np.radians(46.0)
REST_ANGLE = np.radians(20.0)  #: Resting on a flat face turns the largest smooth face by no more [rad]
REST_SHARE = 0.2  #: A flat face counts when its area is at least this share of the largest smooth face's
_AXIS_NOISE = 1e-6  #: A direction this close to an axis is that axis: rounding of the file's numbers [rad]

# The largest smooth face of a part and where it looks.
#
# Candidates are the mesh's own normals, ties go to the file's own z, then to the face with more facets and
# then to the later one in the file (most programs write the bottom first). From a dome with a hole in it many
# directions see as much: the one the whole smooth surface looks in, its axis of symmetry if it has one, is
# taken before the others.

_SAMPLE = 20_000  #: Facets from which candidate directions are drawn
_LEADER_ANGLE = np.radians(23.7)  #: Every facet of the sample looks within this angle of a candidate [rad]
_APART = np.radians(5.0)  #: Candidates closer than this are one [rad]
_SAME = 1e-3  #: Areas this close are equal, relative
_TRIES = 8  #: Candidates tried on the whole mesh at most
_SHIFTS = 3  #: Times a direction is moved to the mean normal of what it sees


class FacetGraph(NamedTuple):
    """A mesh made ready for looking at it from many sides: facets, and which of them are joined smoothly."""

    normals: Array  #: Unit normals of the facets, shape (m, 3)
    areas: Array  #: Areas of the facets [m^2], shape (m,)
    adjacency: Adjacency  #: Neighbours across edges
    links: Indices  #: Pairs of facets joined smoothly, each once, shape (k, 2)


class Face(NamedTuple):
    """A smooth face as seen from one side."""

    direction: Array  #: Unit mean normal, shape (3,)
    area: float  #: Area [m^2]
    doubt: float  #: Uncertainty of its area: the facets the cone ends at, seen whole or not at all [m^2]
    facets: Indices  #: Its facets, shape (k,)


def _facet_graph(vertices: Array, faces: Ints) -> FacetGraph:
    """Prepare a mesh, vertices (n, 3) [m] and faces (m, 3)."""
    normals, areas = facet_normals(vertices, faces)
    adjacency = find_adjacency(faces)
    links = facet_links(adjacency, smooth_edges(normals, adjacency))
    return FacetGraph(normals, areas, adjacency, links[links[:, 0] < links[:, 1]])


def _largest_face(graph: FacetGraph) -> Face:
    """The largest set of smoothly joined facets that look within the cone `UP_CONE` about their mean
    normal."""
    candidates, bounds = _candidates(graph)
    # The bound counts all facets that look this way, joined or not; it is drawn from a sample.
    order = np.argsort(-np.round(bounds / bounds.max(), 3), kind="stable")[:_TRIES]
    found = [(at, _settle(graph, candidates[at], 1)) for at in order]
    best = max(face.area for _, face in found)
    level = [(at, face) for at, face in found if face.area >= (1.0 - _SAME) * best]
    z = np.array(SIDES["z"])
    chosen = max(
        level, key=lambda pair: (np.array_equal(_snap(pair[1].direction), z), len(pair[1].facets), pair[0])
    )[1]
    face = _settle(graph, chosen.direction, _SHIFTS)
    whole = _whole_direction(graph, face)
    # A smooth surface that closes upon itself looks nowhere: a side of the file is as good that sees as much
    # of it.
    for direction in SIDES.values() if whole is None else [whole]:
        straight = _seen_from(graph, np.array(direction))
        if straight.area >= face.area - max(_SAME * face.area, face.doubt, straight.doubt):
            return straight
    return face


def _looks_same(graph: FacetGraph, face: Face, direction: Array) -> bool:
    """Whether a face has the same area from another direction (3,), both projected along it and seen from
    it."""
    # A face's area projected along a direction falls off with the cosine of the angle to its mean normal.
    if face.direction @ direction < 1.0 - _SAME:
        return False
    return _seen_from(graph, direction).area >= (1.0 - _SAME) * face.area


def _seen_from(graph: FacetGraph, direction: Array) -> Face:
    """The largest face seen from a direction, which is left as it is."""
    looks = graph.normals @ direction > np.cos(UP_CONE)
    if not looks.any():
        return Face(direction, 0.0, 0.0, np.empty(0, dtype=np.int64))
    ends = looks[graph.links]
    labels = label_pieces(graph.links[ends.all(axis=1)], len(looks))[1]
    sizes: Array = np.bincount(labels, weights=np.where(looks, graph.areas, 0.0)).astype(np.float64)
    # The first of the (nearly) largest: rounding must not choose.
    facets = np.flatnonzero(labels == np.argmax(sizes >= (1.0 - _SAME) * sizes.max()))
    rim = np.zeros(len(looks), dtype=bool)
    rim[graph.links[ends[:, 0] != ends[:, 1]]] = True
    doubt = float(graph.areas[facets] @ rim[facets])
    return Face(direction, sizes.max(), doubt, facets)


def _candidates(graph: FacetGraph) -> tuple[Array, Array]:
    """Directions many facets look in, in the order of the file, and the area that looks so, (c, 3) and
    (c,)."""
    step = max(len(graph.areas) // _SAMPLE, 1)
    normals = graph.normals[::step]
    areas = graph.areas[::step] * step
    leaders: list[Array] = []
    left = areas > 0.0
    while left.any():
        direction = normals[left.argmax()]
        left &= normals @ direction < np.cos(_LEADER_ANGLE)
        for _ in range(_SHIFTS):
            direction = _mean(normals, areas * (normals @ direction > np.cos(UP_CONE)), direction)
        if all(direction @ other < np.cos(_APART) for other in leaders):
            leaders.append(direction)
    directions = np.array(leaders)
    bounds = np.array([areas[normals @ direction > np.cos(UP_CONE)].sum() for direction in directions])
    return directions, np.maximum(bounds, 1e-300)


def _settle(graph: FacetGraph, direction: Array, rounds: int) -> Face:
    """Turn a direction to the mean normal of the largest face seen from it."""
    face = Face(direction, 0.0, 0.0, np.empty(0, dtype=np.int64))
    for _ in range(rounds):
        face = _seen_from(graph, face.direction)
        mean = _mean(graph.normals[face.facets], graph.areas[face.facets], face.direction)
        face = face._replace(direction=mean)
    return face


def _whole_direction(graph: FacetGraph, face: Face) -> Array | None:
    """Mean normal of the whole smooth surface a face is part of; None where it closes upon itself."""
    if not len(face.facets):
        return None
    labels = label_pieces(graph.links, len(graph.areas))[1]
    weights = np.where(labels == labels[face.facets[0]], graph.areas, 0.0)
    total = weights @ graph.normals
    length = np.linalg.norm(total)
    return (total / length) if length > _SAME * weights.sum() else None


def _mean(normals: Array, weights: Array, otherwise: Array) -> Array:
    total = weights @ normals
    length = np.linalg.norm(total)
    return (total / length) if length > 1e-9 * weights.sum() else otherwise


def choose_up(vertices: Array, faces: Ints, up: str) -> tuple[Array, str]:
    """Find the direction a user's choice means: unit vector (3,), and a note for the user.

    One of the six sides; a vector "X,Y,Z"; or "auto": the part's largest smooth face looks up. If a large
    flat face is (nearly) parallel to the mean of that face, the part stands straight on it, as it would on a
    table. The choice turns with the part, but where a curved face looks the same from one of the file's own
    axes that axis is taken.

    Raises:
        InputError: Neither a side nor a vector; lists what is.
    """
    named = check_up(up)
    if named is not None:
        return named, f"up is {name_direction(named)} (as asked)"
    graph = _facet_graph(vertices, faces)
    direction = _snap(_stand_straight(vertices, faces, graph))
    return (
        direction,
        f"up is {name_direction(direction)} (assumed: the side with the largest smooth face; --up sets it)",
    )


def check_up(up: str) -> Array | None:
    """The direction a choice names, unit vector, shape (3,); None for "auto".

    Raises:
        InputError: They name none; lists what is valid.
    """
    if up in SIDES:
        return np.array(SIDES[up])
    if "," in up:
        return _parse_vector(up)
    if up != "auto":
        raise unknown_name("side for --up", up, [*SIDES, "auto", "X,Y,Z"])
    return None


def _stand_straight(vertices: Array, faces: Ints, graph: FacetGraph) -> Array:
    """Direction (3,) in which the largest smooth face looks, the part put straight on a flat face if it has
    one."""
    found = _largest_face(graph)
    _, areas, normals = flat_faces(vertices, faces, graph.adjacency)
    sides = np.concatenate([normals, -normals])
    sizes = np.concatenate([areas, areas])
    fits = (sides @ found.direction > np.cos(REST_ANGLE)) & (sizes > REST_SHARE * found.area)
    if not fits.any():
        level = (side for side in map(np.array, SIDES.values()) if _looks_same(graph, found, side))
        return next(level, found.direction)
    best = np.flatnonzero(fits & (sizes >= (1.0 - _SAME) * sizes[fits].max()))[0]
    return sides[best]


def name_direction(direction: Array) -> str:
    """Name of a direction: a side's, or the vector."""
    return _side_of(direction) or "(" + ", ".join(f"{value:.4g}" for value in direction + 0.0) + ")"


def side_name(direction: Array) -> str:
    """A direction as ``--up`` takes it: a side's name, else X,Y,Z to the last bit."""
    return _side_of(direction) or ",".join(repr(float(value)) for value in direction)


def _side_of(direction: Array) -> str:
    return next((side for side, vector in SIDES.items() if np.array_equal(direction, vector)), "")


def _snap(direction: Array) -> Array:
    for side in SIDES.values():
        if np.linalg.norm(direction - side) < _AXIS_NOISE:
            return np.array(side)
    return direction


def _parse_vector(text: str) -> Array:
    vector = np.array(numbers_of(text, 3))
    if not vector.any():
        raise InputError(
            f"--up '{text}' is not a direction. Give a side ({', '.join(SIDES)}), auto, or X,Y,Z."
        )
    vector = vector / np.abs(vector).max()
    return vector / np.linalg.norm(vector)
