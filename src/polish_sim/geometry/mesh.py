"""The part as the user's file gives it: read, put in metres, merged, checked, turned up (STL -> PartMesh)."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry.mesh_check import check_bodies, check_edges
from polish_sim.geometry.mesh_repair import drop_bad_facets, flip_slivers, merge_vertices, orient_outward
from polish_sim.geometry.orientation import choose_up
from polish_sim.geometry.stl import read_stl
from polish_sim.geometry.units import check_size, metres_per_unit


@dataclass(frozen=True, eq=False)
class PartMesh:
    """A part's checked triangle mesh in the work frame (the STL's frame in metres)."""

    vertices: NDArray[np.float64]
    """Vertices [m], shape (n, 3)."""
    faces: NDArray[np.int32]
    """Vertex indices, counter-clockwise seen from outside, shape (m, 3)."""
    up: NDArray[np.float64]
    """Unit vector away from the table, shape (3,)."""
    name: str
    path: Path
    sha256: str
    """Hash of the file."""
    unit: str
    """Unit the file was read in."""
    stl_facets: NDArray[np.int32]
    """Number of each facet in the file, shape (m,)."""
    notes: tuple[str, ...]
    """What was assumed or repaired, for the user."""


def load_part(path: str | Path, unit: str = "mm", up: str = "auto") -> PartMesh:
    """Load a part from an STL file, check it and repair what can be repaired without guessing.

    Args:
        path: Binary or ASCII STL file.
        unit: Unit of the file's numbers: mm, cm, m or inch.
        up: Side that looks away from the table: x, y, z, -x, -y, -z, or auto for the side with the
            largest smooth face.

    Returns:
        The mesh in metres, with notes about what was assumed.

    Raises:
        MeshError: The file is no usable part; the message says why and what to do.
        InputError: Unknown unit or side.
    """
    path = Path(path)
    scale = metres_per_unit(unit)
    triangles, content = read_stl(path)
    check_size(float(np.ptp(triangles.reshape(-1, 3), axis=0).max()), unit, path)
    vertices, faces, merge_notes = merge_vertices(triangles * scale)
    faces, stl_facets, drop_notes = drop_bad_facets(vertices, faces, path)
    check_edges(vertices, faces, path)
    faces, flip_notes = flip_slivers(vertices, faces)
    faces, orient_notes = orient_outward(vertices, faces, path)
    check_bodies(vertices, faces, path)
    direction, up_note = choose_up(vertices, faces, up)
    vertices, faces = _compact(vertices, faces)
    for array in (vertices, faces, direction, stl_facets):
        array.setflags(write=False)
    return PartMesh(
        vertices=vertices,
        faces=faces,
        up=direction,
        name=path.stem,
        path=path,
        sha256=hashlib.sha256(content).hexdigest(),
        unit=unit,
        stl_facets=stl_facets,
        notes=(_size_note(vertices, faces, unit), *merge_notes, *drop_notes, *flip_notes, *orient_notes, up_note),
    )


def _compact(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Leave out vertices no facet uses."""
    used, compact = np.unique(faces, return_inverse=True)
    return vertices[used], compact.reshape(-1, 3).astype(np.int32)


def _size_note(vertices: NDArray[np.float64], faces: NDArray[np.int32], unit: str) -> str:
    x, y, z = np.ptp(vertices, axis=0) * 1e3
    return f"read in {unit}: {x:.4g} x {y:.4g} x {z:.4g} mm, {len(faces)} facets"
