"""Which way the part is turned up: as named, along a vector, or its largest smooth face up (mesh -> up)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError, unknown_name
from polish_sim.geometry.features import flat_faces
from polish_sim.geometry.largest_face import FacetGraph, facet_graph, largest_face, looks_same

Floats = NDArray[np.float64]

SIDES = {
    "z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
}
"""Unit vectors of the six sides."""

UP_CONE = np.radians(46.0)
"""A facet looks up when its normal is within this angle of up [rad]; a 45 deg slope does, whatever its rounding."""

REST_ANGLE = np.radians(20.0)
"""A part rests on a flat face when that turns its largest smooth face away from straight up by no more [rad]."""

REST_SHARE = 0.2
"""A flat face counts when its area is at least this share of the largest smooth face's."""

_SAME = 1e-3
"""Areas this close are equal, relative."""

_AXIS_NOISE = 1e-6
"""A direction this close to an axis is that axis: rounding of the file's numbers [rad]."""


def choose_up(vertices: Floats, faces: NDArray[np.int32], up: str) -> tuple[Floats, str]:
    """Turn the user's words into a direction.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        up: One of the six sides; a vector "X,Y,Z"; or "auto": the part's largest smooth face looks up.
            If a large flat face is (nearly) parallel to the mean of that face, the part stands straight on it,
            as it would on a table. The choice turns with the part, but where a curved face looks the same from
            one of the file's own axes that axis is taken.

    Returns:
        Unit vector, shape (3,), and a note for the user.

    Raises:
        InputError: Neither a side nor a vector; lists what is.
    """
    named = check_up(up)
    if named is not None:
        return named, f"up is {describe(named)} (as asked)"
    graph = facet_graph(vertices, faces)
    direction = _snap(stand_straight(vertices, faces, graph, UP_CONE))
    return direction, f"up is {describe(direction)} (assumed: the side with the largest smooth face; --up sets it)"


def check_up(up: str) -> Floats | None:
    """The direction the user's words name, unit vector, shape (3,); None for "auto".

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


def stand_straight(vertices: Floats, faces: NDArray[np.int32], graph: FacetGraph, cone: float) -> Floats:
    """Direction in which the largest smooth face looks, with the part put straight on a flat face if it has one.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        graph: The same mesh, made ready.
        cone: Facets of one face look within this angle of the direction [rad].

    Returns:
        Unit vector, shape (3,).
    """
    found = largest_face(graph, cone)
    _, areas, normals = flat_faces(vertices, faces, graph.adjacency)
    sides = np.concatenate([normals, -normals])
    sizes = np.concatenate([areas, areas])
    fits = (sides @ found.direction > np.cos(REST_ANGLE)) & (sizes > REST_SHARE * found.area)
    if not fits.any():
        level = (side for side in map(np.array, SIDES.values()) if looks_same(graph, found, side, cone))
        return next(level, found.direction)
    best = int(np.flatnonzero(fits & (sizes >= (1.0 - _SAME) * sizes[fits].max()))[0])
    return np.asarray(sides[best])


def describe(direction: Floats) -> str:
    """Name of a direction: a side's, or the vector."""
    for side, vector in SIDES.items():
        if np.array_equal(direction, vector):
            return side
    return "(" + ", ".join(f"{value:.4g}" for value in direction + 0.0) + ")"


def _snap(direction: Floats) -> Floats:
    for side in SIDES.values():
        if np.linalg.norm(direction - side) < _AXIS_NOISE:
            return np.array(side)
    return direction


def _parse_vector(text: str) -> Floats:
    try:
        vector = np.array([float(word) for word in text.split(",")])
    except ValueError:
        vector = np.empty(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.abs(vector).max() > 0.0:
        raise InputError(f"--up '{text}' is not a direction. Give a side ({', '.join(SIDES)}), auto, or X,Y,Z.")
    vector = vector / np.abs(vector).max()
    return np.asarray(vector / np.linalg.norm(vector))
