"""Write the robot's visual meshes (binary STL, m): ``python -m polish_sim.models.generate_robot_meshes``.

Each mesh is a set of turned bodies with rounded edges, in the frame of its link (the DH frame), shaped after
the proportions of a UR5e: joint housings along the joint axes, tubes between them. They are for the eye only.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from polish_sim.models.solids import Solid, revolve

Array = NDArray[np.float64]
SEGMENTS = 40
FILLET_STEPS = 4


class Turned(NamedTuple):
    """A cylinder with rounded edges."""

    start: tuple[float, float, float]
    """Centre of the first end [m]."""
    end: tuple[float, float, float]
    """Centre of the second end [m]."""
    radius: float
    """Radius [m]."""
    fillet_start: float = 0.002
    """Radius of the first end's rounded edge [m]."""
    fillet_end: float = 0.002
    """Radius of the second end's rounded edge [m]."""


MESHES: dict[str, tuple[Turned, ...]] = {
    "base_shell": (
        Turned((0, 0, 0), (0, 0, 0.020), 0.0745, 0.001, 0.006),
        Turned((0, 0, 0.010), (0, 0, 0.0965), 0.0635, 0.001, 0.003),
        Turned((0, -0.050, 0.052), (0, 0.078, 0.052), 0.024, 0.001, 0.003),
    ),
    "base_seam": (
        Turned((0, 0, 0.090), (0, 0, 0.1025), 0.0605),
        Turned((0, 0.07, 0.052), (0, 0.088, 0.052), 0.014),
    ),
    "link_1_shell": (
        Turned((0, -0.060, 0), (0, -0.002, 0), 0.0605, 0.003, 0.001),
        Turned((0, 0, -0.052), (0, 0, 0.068), 0.0605, 0.003, 0.003),
    ),
    "link_1_cap": (Turned((0, 0, -0.067), (0, 0, -0.050), 0.0575, 0.012, 0.001),),
    "link_2_seam": (
        Turned((0.425, 0, 0.060), (0.425, 0, 0.080), 0.0575),
        Turned((0, 0, 0.070), (0, 0, 0.085), 0.0545),
    ),
    "link_2_shell": (
        Turned((0.425, 0, 0.0725), (0.425, 0, 0.190), 0.0605, 0.003, 0.003),
        Turned((0.425, 0, 0.138), (0, 0, 0.138), 0.0500, 0.010, 0.010),
        Turned((0.372, 0, 0.138), (0.350, 0, 0.138), 0.0530, 0.002, 0.002),
        Turned((0.075, 0, 0.138), (0.053, 0, 0.138), 0.0530, 0.002, 0.002),
        Turned((0, 0, 0.0805), (0, 0, 0.188), 0.0580, 0.003, 0.003),
    ),
    "link_2_cap": (
        Turned((0.425, 0, 0.188), (0.425, 0, 0.205), 0.0575, 0.001, 0.012),
        Turned((0, 0, 0.186), (0, 0, 0.203), 0.0550, 0.001, 0.012),
    ),
    "link_3_shell": (
        Turned((0.3922, 0, -0.042), (0.3922, 0, 0.0765), 0.0580, 0.003, 0.003),
        Turned((0.3922, 0, 0.007), (0, 0, 0.007), 0.0395, 0.010, 0.010),
        Turned((0.340, 0, 0.007), (0.318, 0, 0.007), 0.0425, 0.002, 0.002),
        Turned((0.064, 0, 0.007), (0.042, 0, 0.007), 0.0425, 0.002, 0.002),
        Turned((0, 0, -0.036), (0, 0, 0.0625), 0.0435, 0.003, 0.003),
    ),
    "link_3_cap": (
        Turned((0.3922, 0, -0.056), (0.3922, 0, -0.040), 0.0550, 0.012, 0.001),
        Turned((0, 0, -0.049), (0, 0, -0.034), 0.0410, 0.010, 0.001),
    ),
    "link_4_seam": (
        Turned((0, -0.078, 0), (0, -0.060, 0), 0.0405),
        Turned((0, 0, 0.040), (0, 0, 0.054), 0.0405),
    ),
    "link_4_shell": (
        Turned((0, -0.0665, 0), (0, 0.040, 0), 0.0435, 0.003, 0.003),
        Turned((0, 0, 0), (0, 0, 0.0465), 0.0435, 0.003, 0.003),
    ),
    "link_4_cap": (Turned((0, 0.038, 0), (0, 0.053, 0), 0.0410, 0.001, 0.010),),
    "link_5_seam": (Turned((0, 0, 0.040), (0, 0, 0.054), 0.0385),),
    "link_5_shell": (
        Turned((0, 0.0480, 0), (0, -0.040, 0), 0.0435, 0.003, 0.003),
        Turned((0, 0, 0), (0, 0, 0.0475), 0.0435, 0.003, 0.004),
    ),
    "link_5_cap": (Turned((0, -0.038, 0), (0, -0.053, 0), 0.0410, 0.001, 0.010),),
    "link_6_shell": (Turned((0, 0, -0.0475), (0, 0, -0.002), 0.0400, 0.003, 0.003),),
    "sensor_body": (
        Turned((0, 0, -0.001), (0, 0, 0.010), 0.0380, 0.001, 0.001),
        Turned((0, 0, 0.007), (0, 0, 0.040), 0.0400, 0.003, 0.003),
    ),
    "spindle_housing": (
        Turned((0, 0, 0.048), (0, 0, 0.140), 0.0320, 0.002, 0.004),
        Turned((0, 0, 0.130), (0, 0, 0.152), 0.0260, 0.002, 0.006),
        *(
            Turned((0, 0, 0.062 + h), (0, 0, 0.067 + h), 0.0335, 0.001, 0.001)
            for h in (0.0, 0.008, 0.016, 0.024)
        ),
    ),
    "spindle_trim": (
        Turned((0, 0, 0.040), (0, 0, 0.052), 0.0400, 0.001, 0.002),
        Turned((0, 0, 0.112), (0, 0, 0.118), 0.0325, 0.001, 0.001),
        Turned((0, 0, 0.148), (0, 0, 0.160), 0.0200, 0.002, 0.004),
        Turned((0.020, 0, 0.106), (0.044, 0, 0.106), 0.0090, 0.001, 0.002),
        Turned((0.042, 0, 0.106), (0.060, 0, 0.106), 0.0070, 0.001, 0.003),
    ),
}
"""Turned bodies of every mesh file, in the frame of the link that the name begins with (the tool's:
tool_mount)."""


def turned_solid(body: Turned) -> Solid:
    """Closed mesh of a turned body, in its link's frame.

    Args:
        body: What to make.

    Returns:
        The mesh [m].
    """
    start, end = np.array(body.start, dtype=float), np.array(body.end, dtype=float)
    length = float(np.linalg.norm(end - start))
    arc = np.linspace(0.0, np.pi / 2, FILLET_STEPS + 1)
    f0, f1 = body.fillet_start, body.fillet_end
    upper = np.column_stack([body.radius - f1 + f1 * np.sin(arc), length - f1 + f1 * np.cos(arc)])
    lower = np.column_stack([body.radius - f0 + f0 * np.cos(arc), f0 - f0 * np.sin(arc)])
    axle = np.array([[1e-5, 0.0], [1e-5, length]])
    solid = revolve(np.vstack([upper, lower, axle]), SEGMENTS)
    return Solid(solid.vertices @ _frame_along(end - start).T + start, solid.faces)


def _frame_along(axis: Array) -> Array:
    """A rotation whose z axis points along `axis`, shape (3, 3)."""
    z = axis / np.linalg.norm(axis)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def write_meshes(folder: Path) -> list[Path]:
    """Write one STL file per mesh.

    Args:
        folder: Existing folder to write to.

    Returns:
        The files written.
    """
    paths = []
    for name, bodies in MESHES.items():
        solids = [turned_solid(body) for body in bodies]
        starts = np.cumsum([0] + [len(solid.vertices) for solid in solids[:-1]])
        faces = [solid.faces + start for solid, start in zip(solids, starts, strict=True)]
        path = folder / f"{name}.stl"
        trimesh.Trimesh(np.vstack([s.vertices for s in solids]), np.vstack(faces), process=False).export(path)
        paths.append(path)
    return paths


if __name__ == "__main__":
    for written in write_meshes(Path(__file__).resolve().parent / "meshes"):
        print(written)
