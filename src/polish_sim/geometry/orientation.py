"""Which side of the part looks up: the named one, or the one with the largest smooth face (mesh -> up)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import unknown_name
from polish_sim.geometry.features import facet_normals, smooth_edges
from polish_sim.geometry.topology import facet_links, find_adjacency, label_pieces

SIDES = {
    "z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
}
"""Unit vectors of the six sides; earlier ones win ties."""

UP_CONE = np.radians(46.0)
"""A facet looks up when its normal is within this angle of up [rad]; a 45 deg slope does, whatever its rounding."""

_TIE = 1.01


def choose_up(vertices: NDArray[np.float64], faces: NDArray[np.int32], up: str) -> tuple[NDArray[np.float64], str]:
    """Turn a side's name into a direction.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        up: One of the six sides, or "auto": the side on which the largest smooth face, seen from that
            side, has the largest area.

    Returns:
        Unit vector, shape (3,), and a note for the user.

    Raises:
        InputError: Unknown side; lists the known ones.
    """
    if up in SIDES:
        return np.array(SIDES[up]), f"up is {up} (as asked)"
    if up != "auto":
        raise unknown_name("side for --up", up, [*SIDES, "auto"])
    areas = {side: _largest_face_seen(vertices, faces, np.array(SIDES[side])) for side in SIDES}
    best = "z"
    for side, area in areas.items():
        if area > _TIE * areas[best]:
            best = side
    return np.array(SIDES[best]), f"up is {best} (assumed: the side with the largest smooth face; --up sets it)"


def _largest_face_seen(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], direction: NDArray[np.float64]
) -> float:
    """Area [m^2] of the largest smooth face that looks this way, projected along the direction."""
    normals, areas = facet_normals(vertices, faces)
    adjacency = find_adjacency(faces)
    height = normals @ direction
    looks_up = height > np.cos(UP_CONE)
    keep = smooth_edges(normals, adjacency) & looks_up[:, None] & looks_up[adjacency.facets]
    count, labels = label_pieces(facet_links(adjacency, keep), len(faces))
    seen = np.where(looks_up, areas * height, 0.0)
    return float(np.bincount(labels, weights=seen, minlength=count).max())
