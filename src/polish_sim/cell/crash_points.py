"""Sample points on shaft, spindle, sensor, wrist and forearm that must stay out of the part (layer 8a)."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.models import robot_model_path

Array = NDArray[np.float64]

BODIES = ("tool_mount", "link_6", "link_5", "link_4", "link_3")
_SHAFT = "head_shaft"
_SPACING = 0.03  # one point is kept in each cube of this side [m]
_AROUND = 12  # points of a ring around the shaft


def crash_points(model: mujoco.MjModel, arm: str = "") -> tuple[Array, NDArray[np.int64]]:
    """Points spread over the drawn meshes of the links behind the pad, and over the shaft it turns on.

    Args:
        model: The compiled scene.
        arm: What the names of the arm with the tool begin with.

    Returns:
        Points in their bodies' frames [m], shape (k, 3), and the body of each, shape (k,).
    """
    on_shaft = _on_cylinder(model, model.geom(f"{arm}{_SHAFT}").id)
    points, bodies = [on_shaft], [np.full(len(on_shaft), model.body(f"{arm}head").id)]
    for body in (model.body(arm + name).id for name in BODIES):
        drawn = (model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        for geom in np.flatnonzero(drawn):
            R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
            spread = _thinned(R.apply(_vertices(model, int(model.geom_dataid[geom]))) + model.geom_pos[geom])
            points.append(spread)
            bodies.append(np.full(len(spread), body))
    return np.concatenate(points), np.concatenate(bodies).astype(np.int64)


@cache
def shaft_points() -> Array:
    """Points on the shaft, frame of the tool with the head's spring at rest [m], shape (k, 3)."""
    model = mujoco.MjModel.from_xml_path(str(robot_model_path()))
    points = _on_cylinder(model, model.geom(_SHAFT).id)
    points.setflags(write=False)
    return points


def _on_cylinder(model: mujoco.MjModel, geom: int) -> Array:
    """Points around a cylinder from end to end, frame of its body [m], shape (k, 3)."""
    radius, half = model.geom_size[geom, :2]
    around = np.linspace(0.0, 2.0 * np.pi, _AROUND, endpoint=False)
    rings = np.linspace(-half, half, int(np.ceil(2.0 * half / _SPACING)) + 1)
    angle, z = (grid.ravel() for grid in np.meshgrid(around, rings))
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
    return np.asarray(R.apply(points) + model.geom_pos[geom])


def _vertices(model: mujoco.MjModel, mesh: int) -> Array:
    start = model.mesh_vertadr[mesh]
    return np.asarray(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], dtype=np.float64)


def _thinned(points: Array) -> Array:
    _, kept = np.unique(np.round(points / _SPACING).astype(int), axis=0, return_index=True)
    return points[kept]
