"""Part and coloured path for 3D viewers: PLY and glTF (plan -> mesh files)."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from polish_sim.exchange.path_tube import PART_COLOR, path_tube
from polish_sim.exchange.setup import ExportSetup
from polish_sim.planning import PlanResult

GLTF_FROM_WORK = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""glTF's y is up; the work frame's z mostly is."""


def ply_bytes(result: PlanResult, setup: ExportSetup) -> bytes:
    """Part and path as one binary PLY with a colour per vertex, metres, work frame."""
    part, path = _meshes(result)
    both: Any = trimesh.util.concatenate([part, path])
    return bytes(both.export(file_type="ply"))


def glb_bytes(result: PlanResult, setup: ExportSetup) -> bytes:
    """Part and path as two named meshes of one binary glTF, metres, y up as glTF has it."""
    part, path = _meshes(result)
    scene: Any = trimesh.Scene()
    scene.add_geometry(part, geom_name="part", node_name="part", transform=GLTF_FROM_WORK)
    scene.add_geometry(path, geom_name="path", node_name="path", transform=GLTF_FROM_WORK)
    return bytes(scene.export(file_type="glb"))


def _meshes(result: PlanResult) -> tuple[Any, Any]:
    tube = path_tube(result)
    grey = np.tile(np.array(PART_COLOR, dtype=np.uint8), (len(result.mesh.vertices), 1))
    return _mesh(result.mesh.vertices, result.mesh.faces, grey), _mesh(tube.vertices, tube.faces, tube.colors)


def _mesh(vertices: NDArray[np.float64], faces: NDArray[np.int32], colors: NDArray[np.uint8]) -> Any:
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
