"""The cell's robot in torque mode: the model file's arm, its servos replaced by motors (layer 8a)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.scene import lay_part, robot_spec
from polish_sim.cell.serial_chain import read_chain
from polish_sim.config import Scenario
from polish_sim.errors import InputError
from polish_sim.geometry.mesh import PartMesh
from polish_sim.motion.serial_chain import SerialChain

CLAMP_N: Final = 100.0
"""The head's slide is clamped while a hand guides the tool: dry friction far above its weight [N]."""


class LaidPart(NamedTuple):
    """A part that lies before the arm."""

    mesh: PartMesh
    T_base_part: NDArray[np.float64]
    """Shape (4, 4)."""


def build_torque_arm(scenario: Scenario, joints: Sequence[str], part: LaidPart | None = None) -> mujoco.MjModel:
    """Compile the arm with one motor a joint, the scenario's joint friction and its unknown payload.

    Args:
        scenario: Head, time step and ``guide``.
        joints: Names of the driven joints, from base to flange.
        part: What lies on the table before it, or None for an arm alone; its contact is not computed.

    Returns:
        The model. Nothing holds its weight but the motors: the model file's balancing of the links is taken off.
    """
    spec, guide = robot_spec(scenario), scenario.guide
    for body in spec.bodies:
        body.gravcomp = 0.0
    limits = {actuator.target: float(actuator.forcerange[1]) for actuator in spec.actuators}
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for name, coulomb, viscous in zip(joints, guide.coulomb_nm, guide.viscous_nm_s_rad, strict=True):
        joint, limit = spec.joint(name), limits[name]
        joint.frictionloss, joint.damping[0] = coulomb, viscous
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=[-limit, limit])
        motor.set_to_motor()
    for home in spec.keys:
        home.ctrl = [0.0] * len(joints)
    spec.joint("head_slide").frictionloss = CLAMP_N
    if guide.payload_kg > 0.0:
        tool = spec.site("tool")
        size = 0.02  # a lump of this radius [m]
        tool.parent.add_body(
            name="payload", pos=tool.pos, mass=guide.payload_kg, explicitinertial=True,
            inertia=[0.4 * guide.payload_kg * size**2] * 3,
        )  # fmt: skip
    if part is not None:
        lay_part(spec, part.mesh, part.T_base_part)
    return spec.compile()


def chain_of_file(file: Path, joints: Sequence[str]) -> SerialChain:
    """The chain of an MJCF somebody identified, e.g. identified.xml.

    Raises:
        InputError: The file is no model, or has not these joints.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except (ValueError, OSError) as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"guide.model_file '{file}' is not a robot's MJCF: {reason}. Give an identified.xml."
        ) from error
    try:
        return read_chain(model, joints)
    except InputError as error:
        raise InputError(f"guide.model_file '{file}' is not this arm's: {error}") from error
