"""The tool as it really is, and what its weight does to the wrist sensor (layer 8a)."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.wrist_sensor import GRAVITY, Payload

Array = NDArray[np.float64]


def carried_payload(model: mujoco.MjModel, data: mujoco.MjData, arm: str = "") -> Payload:
    """The tool as it is: everything mounted on the sensor of the ``arm``; ``data`` at rest."""
    bodies = [model.body(f"{arm}tool_mount").id, model.body(f"{arm}head").id]
    mass = model.body_mass[bodies]
    center = (mass @ data.xipos[bodies]) / mass.sum()
    sensor, tool = data.site(f"{arm}sensor"), data.site(f"{arm}tool")
    R_sensor_base = sensor.xmat.reshape(3, 3).T
    return Payload(float(mass.sum()), R_sensor_base @ (center - sensor.xpos), R_sensor_base @ (tool.xpos - sensor.xpos))


def weight_of(payload: Payload, R_base_sensor: Array) -> Array:
    """What a tool at rest loads the sensor with.

    Args:
        payload: The tool.
        R_base_sensor: How the sensor stands, shape (n, 3, 3).

    Returns:
        Wrench in sensor axes about the sensor's origin [N, N m], shape (n, 6).
    """
    force = payload.mass * GRAVITY * R_base_sensor[:, 2, :]
    return np.concatenate([force, np.cross(payload.center, force)], axis=1)
