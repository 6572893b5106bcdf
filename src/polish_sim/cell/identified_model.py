"""An identified robot written back as a MJCF: the shipped model with other inertias and friction (layer 8a)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.models import robot_model_path
from polish_sim.motion.serial_chain import inertia_at_origin

Array = NDArray[np.float64]


class IdentifiedJoints(NamedTuple):
    """Numbers to be written; friction and rotors may be missing, then they stay."""

    parameters: Array
    """Ten parameters of each joint's own body about the joint's origin, shape (n, 10)."""
    damping: Array | None = None
    """[N m s/rad], shape (n,)."""
    frictionloss: Array | None = None
    """[N m], shape (n,)."""
    armature: Array | None = None
    """[kg m^2], shape (n,)."""


def identified_xml(joints: Sequence[str], found: IdentifiedJoints) -> str:
    """The robot's MJCF with identified numbers.

    Args:
        joints: Names of the joints, shape (n,).
        found: What was identified; physically consistent, or the model would not compile.

    Returns:
        A complete model; meshes are found in the installed package.
    """
    spec = mujoco.MjSpec.from_file(str(robot_model_path()))
    spec.modelname = "ur5e_identified"
    spec.meshdir = str(robot_model_path().parent / "meshes")
    for number, name in enumerate(joints):
        joint = spec.joint(name)
        _write_inertia(joint.parent, np.asarray(joint.pos), found.parameters[number])
        if found.damping is not None:
            joint.damping[0] = found.damping[number]
        if found.frictionloss is not None:
            joint.frictionloss = found.frictionloss[number]
        if found.armature is not None:
            joint.armature = found.armature[number]
    spec.compile()
    return str(spec.to_xml())


def _write_inertia(body: mujoco.MjsBody, origin: Array, parameters: Array) -> None:
    mass, center = float(parameters[0]), parameters[1:4] / parameters[0]
    about_center = inertia_at_origin(parameters) - mass * (
        float(center @ center) * np.eye(3) - np.outer(center, center)
    )
    body.mass, body.ipos = mass, center + origin
    I = about_center  # noqa: E741
    body.fullinertia = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]
    body.explicitinertial = True
