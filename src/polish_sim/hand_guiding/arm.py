"""The arm of `run teach`: torque mode, what its controller believes of it, and where it starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell import tool_on_flange
from polish_sim.cell.scene import lay_part, robot_with_tool
from polish_sim.config import HandConfig, Scenario
from polish_sim.errors import InputError
from polish_sim.geometry.mesh import PartMesh
from polish_sim.hand_guiding.cell import GuidedArm, Hand
from polish_sim.hand_guiding.law import Belief, GuidingLimits, Lent, gains_of
from polish_sim.identification.model_file import friction_by_load, read_robot_model
from polish_sim.identification.robot_model import ARM_JOINTS, read_chain
from polish_sim.motion import forward, inverse_near
from polish_sim.motion.serial_chain import SerialChain, chain_model

# The cell's robot in torque mode: the model file's arm, its servos replaced by motors.

#: The head's slide is clamped while a hand guides: dry friction far above its weight [N]
CLAMP_N = 100.0
#: Step of the encoders up to which a released arm stands still with an assist that goes by them
COARSEST_RAD = 2e-5
START_RAD = 1e-5  #: Way after which the assist takes an elastic joint for started or turned back


def torque_arm(scenario: Scenario, part: tuple[PartMesh, Array] | None = None) -> mujoco.MjModel:
    """Compile the arm with one motor for each joint, the scenario's joint friction and unknown payload.

    Elastic joints have the friction of their own motors, their rotors for armature and rigid gears here.
    Nothing holds its weight but the motors: the model file's balancing of the links is taken off. ``part``:
    what lies on the table before it, and its pose there (4, 4), or None; its contact is not computed.
    """
    guide = scenario.guide
    real = scenario.robot.real
    spec = robot_with_tool(scenario)
    friction = guide.coulomb_nm, guide.viscous_nm_s_rad
    if scenario.robot.elastic:
        friction = real.coulomb_nm, real.viscous_nm_s_rad
        for name, rotor in zip(ARM_JOINTS, real.rotor_kg_m2, strict=True):
            spec.joint(name).armature = rotor
    for body in spec.bodies:
        body.gravcomp = 0.0
    limits = {actuator.target: actuator.forcerange[1] for actuator in spec.actuators}
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for name, coulomb, viscous in zip(ARM_JOINTS, *friction, strict=True):
        joint = spec.joint(name)
        limit = limits[name]
        joint.frictionloss = coulomb
        joint.damping[0] = viscous
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, forcerange=[-limit, limit]
        )
        motor.set_to_motor()
    for home in spec.keys:
        home.ctrl = [0.0] * len(ARM_JOINTS)
    spec.joint("head_slide").frictionloss = CLAMP_N
    if guide.payload_kg > 0.0:
        tool = spec.site("tool")
        size = 0.02  # a lump of this radius [m]
        tool.parent.add_body(
            name="payload", pos=tool.pos, mass=guide.payload_kg, explicitinertial=True,
            inertia=[0.4 * guide.payload_kg * size**2] * 3,
        )  # fmt: skip
    if part is not None:
        lay_part(spec, *part)
    return spec.compile()


def chain_of_file(file: Path) -> SerialChain:
    """The chain of an identified MJCF, e.g. identified.xml; InputError if it is none, or has not the arm's
    joints."""
    try:
        return read_chain(read_robot_model(file), ARM_JOINTS)
    except InputError as error:
        raise InputError(f"guide.model_file '{file}' is not this arm's: {error}") from error


HOME = (
    1.300932701746,
    -1.591205400892,
    1.509041313016,
    -1.488632238919,
    -1.570796326795,
    -0.269863625049,
)
"""Joint angles the hand's moves are centred on, the model file's home [rad]."""
DIRECTIONS: Mapping[str, tuple[float, float, float]] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0)}
"""Unit vectors in the base frame."""


def believe_arm(scenario: Scenario) -> Belief:
    """The model the arm's controller uses: without the payload, or a file's, scaled by the scenario's errors.

    Friction is a file's only where the joints are elastic: what it is there, no rigid model says exactly.
    """
    guide = scenario.guide
    # The controller does not know the payload.
    unloaded = torque_arm(replace(scenario, guide=replace(guide, payload_kg=0.0)))
    own = read_chain(unloaded, ARM_JOINTS)
    chain = chain_of_file(Path(guide.model_file)) if guide.model_file else own
    real = scenario.robot.real
    rubbing = own
    load = np.zeros((2, 6))
    if scenario.robot.elastic:
        rubbing = chain
        load = np.tile([[real.coulomb_driving], [real.coulomb_driven]], 6)
        if guide.model_file:
            load = friction_by_load(Path(guide.model_file))
    return Belief(
        chain_model(chain, guide.mass_scale), guide.friction_scale * rubbing.frictionloss,
        guide.friction_scale * rubbing.damping, np.array(guide.creep_rad_s),
        np.array(unloaded.actuator_forcerange[:, 1]), *(guide.friction_scale * load),
    )  # fmt: skip


def guided_arm(scenario: Scenario, mode: str, model: Any, belief: Belief, hand: Hand) -> GuidedArm:
    """The arm with its law in a mode and fresh limits; InputError for an unknown mode."""
    guide = scenario.guide
    limits = GuidingLimits(
        guide.joint_speed_limit_rad_s, guide.tool_speed_limit_m_s, guide.energy_limit_j, Lent()
    )
    gains = gains_of(mode, guide, scenario.simulation.timestep_s)
    if not scenario.robot.elastic:
        return GuidedArm(model, belief, gains, limits, hand)
    real = replace(scenario.robot.real, servo_side=guide.encoder_side)
    if gains.assist > 0.0 and real.encoder_rad > COARSEST_RAD:
        raise InputError(
            f"robot.real.encoder_rad = {real.encoder_rad:g} rad is too coarse for --mode {mode}: when it is "
            f"released the arm would drive on. Give {COARSEST_RAD:g} or less, or --mode classical."
        )
    gains = gains._replace(encoder=real.encoder_rad, start=START_RAD * (gains.assist > 0.0))
    return GuidedArm(model, belief, gains, limits, hand, real, scenario.seed)


def hand_of(config: HandConfig) -> Hand:
    """The hand of a scenario."""
    return Hand(
        config.stiffness_n_m, config.damping_n_s_m, config.turn_stiffness_nm_rad, config.turn_damping_nm_s_rad
    )


def home_pose() -> Array:
    """Tool pose at home in the base frame, shape (4, 4)."""
    return forward(np.array(HOME)) @ tool_on_flange()


def joints_for(T_base_tool: Array, near: Array) -> Array:
    """Joint angles (6,) [rad] that bring the tool to a pose; ReachError if there are none."""
    return inverse_near(T_base_tool @ np.linalg.inv(tool_on_flange()), near)
