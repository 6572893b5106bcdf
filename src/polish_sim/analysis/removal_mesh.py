"""What a run took off the part as a coloured mesh with the exposure at every vertex (RemovalMap -> removal.ply)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from polish_sim.analysis.coverage_mesh import BARE, ply_header
from polish_sim.analysis.removal_plot import SCALE, removal_colors
from polish_sim.removal import RemovalMap

REMOVAL_MESH = "removal.ply"
COMMENT = (
    "lengths in mm; exposure_n_m: pressure x sliding speed x time in N/m; relative: over its mean; "
    "removal_m: depth taken off, 0 without a wear coefficient"
)


def write_removal_mesh(file: Path, removal: RemovalMap) -> None:
    """Write the region as binary PLY: x, y, z in mm, colour, and per vertex exposure_n_m, relative and removal_m.

    Args:
        file: Where to.
        removal: The map.
    """
    vertices = np.zeros(
        len(removal.vertices),
        dtype=[(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
        + [(name, "u1") for name in ("red", "green", "blue")]
        + [(name, "<f4") for name in ("exposure_n_m", "relative", "removal_m")],
    )
    for k, name in enumerate("xyz"):
        vertices[name], vertices["n" + name] = 1e3 * removal.vertices[:, k], removal.normals[:, k]
    colors = np.asarray(removal_colors()(SCALE(removal.relative), bytes=True))[:, :3].copy()
    colors[removal.exposure <= 0.0] = BARE
    for k, name in enumerate(("red", "green", "blue")):
        vertices[name] = colors[:, k]
    vertices["exposure_n_m"], vertices["relative"] = removal.exposure, removal.relative
    vertices["removal_m"] = removal.preston_1_pa * removal.exposure
    triangles = np.zeros(len(removal.triangles), dtype=[("count", "u1"), ("corners", "<i4", (3,))])
    triangles["count"], triangles["corners"] = 3, removal.triangles
    header = ply_header(vertices, len(triangles), COMMENT)
    file.write_bytes(header.encode("ascii") + vertices.tobytes() + triangles.tobytes())
