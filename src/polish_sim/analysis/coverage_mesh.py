"""An inspected region as a coloured mesh with the time under the pad at every vertex (Inspection -> coverage.ply)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from polish_sim.planning import Inspection

Array = NDArray[np.float64]

HOLLOW = (204, 121, 167)
"""Colour of what the pad cannot touch."""
BARE = (213, 94, 0)
"""Colour of what it never comes to."""

COMMENT = (
    "lengths in mm; exposure_s: seconds under the pad; strict: within 0.55 step-overs of the path; "
    "hollow: tighter than the pad"
)


def write_coverage_mesh(file: Path, found: Inspection) -> None:
    """Write the region as binary PLY: x, y, z in mm, colour, and per vertex exposure_s, strict and hollow.

    Args:
        file: Where to.
        found: What was measured.
    """
    mesh, quality = found.ground.mesh, found.quality
    hollow = hollow_vertices(found)
    vertices = np.zeros(
        len(mesh.vertices),
        dtype=[(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
        + [(name, "u1") for name in ("red", "green", "blue")]
        + [("exposure_s", "<f4"), ("strict", "u1"), ("hollow", "u1")],
    )
    for k, name in enumerate("xyz"):
        vertices[name], vertices["n" + name] = 1e3 * mesh.vertices[:, k], mesh.normals[:, k]
    colors = _colors(quality.exposure.times, hollow)
    for k, name in enumerate(("red", "green", "blue")):
        vertices[name] = colors[:, k]
    vertices["exposure_s"], vertices["strict"], vertices["hollow"] = quality.exposure.times, found.strict, hollow
    triangles = np.zeros(len(mesh.triangles), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    triangles["count"], triangles["corners"] = 3, mesh.triangles
    header = ply_header(vertices, len(triangles), COMMENT)
    file.write_bytes(header.encode("ascii") + vertices.tobytes() + triangles.tobytes())


def hollow_vertices(found: Inspection) -> NDArray[np.bool_]:
    """Vertices of the region on facets the pad cannot touch, shape (v,)."""
    mesh, hollow = found.ground.mesh, found.quality.reach.hollow
    out = np.zeros(len(mesh.vertices), dtype=bool)
    own = mesh.owners < len(hollow)
    out[mesh.triangles[own][hollow[mesh.owners[own]] > 0.5]] = True
    return out


def _colors(times: Array, hollow: NDArray[np.bool_]) -> NDArray[np.uint8]:
    top = float(np.percentile(times, 99.0)) or 1.0
    colors = np.asarray(colormaps["viridis"](np.clip(times / top, 0.0, 1.0), bytes=True))[:, :3].copy()
    colors[times <= 0.0] = BARE
    colors[hollow] = HOLLOW
    return colors


def ply_header(vertices: NDArray[np.void], faces: int, comment: str) -> str:
    """Header of a binary PLY file with these vertices, so many triangles and a comment of one line."""
    kinds = {"f": "float", "u": "uchar"}
    names = vertices.dtype.names or ()
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {comment}",
        f"element vertex {len(vertices)}",
        *(f"property {kinds[vertices.dtype[name].kind]} {name}" for name in names),
        f"element face {faces}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return "\n".join(lines) + "\n"
