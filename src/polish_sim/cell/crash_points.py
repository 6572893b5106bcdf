"""Sample points on spindle, sensor, wrist and forearm that must stay out of the part (layer 8a)."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

BODIES = ("tool_mount", "link_6", "link_5", "link_4", "link_3")
_SPACING = 0.03  # one point is kept in each cube of this side [m]


def crash_points(model: mujoco.MjModel, arm: str = "") -> tuple[Array, NDArray[np.int64]]:
    """Points spread over the drawn meshes of the links behind the pad.

    Args:
        model: The compiled scene.
        arm: What the names of the arm with the tool begin with.

    Returns:
        Points in their bodies' frames [m], shape (k, 3), and the body of each, shape (k,).
    """
    points, bodies = [], []
    for body in (model.body(arm + name).id for name in BODIES):
        drawn = (model.geom_bodyid == body) & (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH)
        for geom in np.flatnonzero(drawn):
            R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
            spread = _thinned(R.apply(_vertices(model, int(model.geom_dataid[geom]))) + model.geom_pos[geom])
            points.append(spread)
            bodies.append(np.full(len(spread), body))
    return np.concatenate(points), np.concatenate(bodies).astype(np.int64)


def _vertices(model: mujoco.MjModel, mesh: int) -> Array:
    start = model.mesh_vertadr[mesh]
    return np.asarray(model.mesh_vert[start : start + model.mesh_vertnum[mesh]], dtype=np.float64)


def _thinned(points: Array) -> Array:
    _, kept = np.unique(np.round(points / _SPACING).astype(int), axis=0, return_index=True)
    return points[kept]
