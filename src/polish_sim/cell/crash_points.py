"""Sample points on spindle, sensor, wrist and forearm that must stay out of the part (layer 8a)."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

BODIES = ("tool_mount", "link_6", "link_5", "link_4", "link_3")
_AROUND = 8
_ALONG = (-1.0, -0.33, 0.33, 1.0)


def crash_points(model: mujoco.MjModel) -> tuple[Array, NDArray[np.int64]]:
    """Rings of points on the drawn cylinders of the links behind the pad.

    Args:
        model: The compiled scene.

    Returns:
        Points in their bodies' frames [m], shape (k, 3), and the body of each, shape (k,).
    """
    angles = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points, bodies = [], []
    for body in (model.body(name).id for name in BODIES):
        for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == 2)):
            if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_CYLINDER:
                continue
            radius, half = model.geom_size[geom, :2]
            R = Rotation.from_quat(model.geom_quat[geom], scalar_first=True)
            for height in _ALONG:
                local = np.column_stack([radius * ring, np.full(_AROUND, half * height)])
                points.append(R.apply(local) + model.geom_pos[geom])
                bodies.append(np.full(_AROUND, body))
    return np.concatenate(points), np.concatenate(bodies).astype(np.int64)
