"""Refuse meshes that are not the skin of one part, and say why (mesh -> mesh or MeshError)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import MeshError
from polish_sim.geometry.topology import facet_links, find_adjacency, find_edge_faults, label_pieces

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

_COUNT_WORDS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def check_edges(vertices: Floats, faces: Ints, path: Path) -> None:
    """Refuse edges shared by three or more facets.

    Raises:
        MeshError: Names how many edges, and where the first one is [mm].
    """
    faults = find_edge_faults(faces)
    if faults.crowded:
        x, y, z = vertices[faults.first_crowded].mean(axis=0) * 1e3
        raise MeshError(
            f"{path}: the mesh is broken: {faults.crowded} edges are shared by more than two facets, the first "
            f"at ({x:.3f}, {y:.3f}, {z:.3f}) mm, so inside and outside are not defined. "
            "Repair the part (make it one manifold solid) and export it again."
        )


def check_bodies(vertices: Floats, faces: Ints, path: Path) -> None:
    """Refuse a file with several bodies; hollows inside one closed body are allowed.

    Raises:
        MeshError: Names how many bodies there are and how large they are.
    """
    count, labels = label_pieces(facet_links(find_adjacency(faces)), len(faces))
    if count == 1:
        return
    bodies = [label for label in range(count) if not _is_hollow(vertices, faces[labels == label])]
    if len(bodies) <= 1:
        return
    sizes = sorted((_extents(vertices, faces[labels == label]) for label in bodies), key=max, reverse=True)
    shown = "; ".join(" x ".join(f"{length * 1e3:.4g}" for length in size) for size in sizes[:6])
    more = f"; and {len(sizes) - 6} more" if len(sizes) > 6 else ""
    raise MeshError(
        f"{path}: {_COUNT_WORDS.get(len(bodies), str(len(bodies)))} bodies in one file, of {shown}{more} mm. "
        "Export one part per file."
    )


def _is_hollow(vertices: Floats, faces: Ints) -> bool:
    """A closed piece whose facets look inward bounds an empty space inside a body."""
    if find_edge_faults(faces).open:
        return False
    a, b, c = (vertices[faces[:, corner]] - vertices[faces[0, 0]] for corner in range(3))
    return float((a * np.cross(b, c)).sum()) < 0.0


def _extents(vertices: Floats, faces: Ints) -> tuple[float, ...]:
    return tuple(float(length) for length in np.ptp(vertices[faces.ravel()], axis=0))
