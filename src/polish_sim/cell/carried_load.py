"""A load bolted to the robot's tool, which no host is told of (layer 8a)."""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class CarriedLoad(NamedTuple):
    """A rigid body in the axes of the link it is bolted to."""

    mass: float
    """[kg]."""
    center: Array
    """From the body's origin [m], shape (3,)."""
    inertia: Array
    """About its centre [kg m^2], shape (3, 3)."""


def carry(model: mujoco.MjModel, body: str, load: CarriedLoad) -> None:
    """Make a load part of a body of a compiled model.

    Args:
        model: The model, changed in place.
        body: The body it is bolted to.
        load: The load.
    """
    number = model.body(body).id
    mass, center = float(model.body_mass[number]), model.body_ipos[number].copy()
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[number])
    R = turn.reshape(3, 3)
    together = mass + load.mass
    middle = (mass * center + load.mass * load.center) / together
    inertia = _about(middle, mass, center, R @ np.diag(model.body_inertia[number]) @ R.T)
    inertia += _about(middle, load.mass, load.center, load.inertia)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(axes).ravel())
    model.body_mass[number], model.body_ipos[number] = together, middle
    model.body_inertia[number], model.body_iquat[number] = moments, quaternion
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _about(point: Array, mass: float, center: Array, inertia: Array) -> Array:
    """Inertia about a point of a body whose inertia about its centre is given."""
    arm = center - point
    return np.asarray(inertia + mass * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm)))
