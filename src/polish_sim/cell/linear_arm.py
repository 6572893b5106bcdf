"""The real arm as a linear model about a pose: links and rotors on the gears' springs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.gears import RealArm
from polish_sim.cell.real_arm import build_real_arm, gear_twists, joint_inertia, weights
from polish_sim.cell.scene import build_scene
from polish_sim.config import RealArmConfig, Scenario


class JointsAbout(NamedTuple):
    """What the linear motion of an arm about a pose consists of."""

    arm: RealArm
    inertia: Array  #: Of the links and all they carry [kg m^2], shape (6, 6)
    jacobian: Array  #: Of the tool point (linear; angular), shape (6, 6)
    axis: Array  #: Tool z in the base frame, shape (3,)
    head: float  #: Mass of the head, which the inertia includes [kg]
    torque: Array  #: Of the gears, under the weight and the contact force [N m], shape (6,)
    real: RealArmConfig


def joints_about(scenario: Scenario, q: Array) -> list[JointsAbout]:
    """The elastic arm of a scenario at rest with its encoders at each of ``q`` (n, 6) [rad], nothing around
    it; it is to press with the contact force.

    What is drawn of the arm, and its damping, are those of the first pose.
    """
    model = build_scene(scenario)
    data = mujoco.MjData(model)
    data.qpos[:6] = q[0]
    real, force = scenario.robot.real, scenario.process.contact_force_n
    arm = build_real_arm(real, scenario.seed, model, data, q[0])
    tool = model.site("tool").id
    head = float(model.body("head").mass[0])
    abouts = []
    rested = data.qpos[:6] - q[0]
    for pose, weight in zip(q, weights(model, q + rested), strict=True):
        data.qpos[:6] = pose + rested
        mujoco.mj_forward(model, data)
        inertia, J = joint_inertia(model, data), np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, J[:3], J[3:], tool)
        axis = data.site_xmat[tool].reshape(3, 3)[:, 2].copy()
        torque = weight + force * axis @ J[:3, :6]
        abouts.append(JointsAbout(arm, inertia[:6, :6], J[:, :6], axis, head, torque, real))
    return abouts


class MotionMatrices(NamedTuple):
    """M x'' + D x' + K x = 0 of links and rotors x (12,) [rad] about a pose, each (12, 12)."""

    mass: Array
    stiffness: Array
    damping: Array


def motion_matrices(about: JointsAbout) -> MotionMatrices:
    """Links on gears on rotors on servos; the head slides on its spring. The gears swing by so little that
    their hysteresis is a spring.

    Coulomb friction of the motors is left out; it damps.
    """
    arm = about.arm
    more = gear_twists(about.real, np.stack([about.torque - 1e-3, about.torque + 1e-3]))
    stiffness = 2e-3 / (more[1] - more[0]) + arm.lost_torque / arm.rise
    tool = about.axis @ about.jacobian[:3]
    mass = np.zeros((12, 12))
    mass[:6, :6], mass[6:, 6:] = about.inertia - about.head * np.outer(tool, tool), np.diag(arm.inertia)
    matrices = []
    for gear, servo in (
        (stiffness, arm.kp),
        (arm.coupling, arm.kv + (1.0 + arm.cold) * np.array(arm.viscous)),
    ):
        twisted = np.diag(gear)
        matrices.append(np.block([[twisted, -twisted], [-twisted, twisted + np.diag(servo)]]))
    return MotionMatrices(mass, *matrices)


_ABOVE: Final = 1.1  # the servos hold rotors that the resting shape leaves alone


def arm_modes(abouts: Sequence[JointsAbout], springs: float) -> Array:
    """Frequency at which the arm swings along the tool axis, pressing on the part, in each of n poses, shape
    (n,) [rad/s]; ``springs``: head and pad in series [N/m].

    One for all modes that share the axis: Rayleigh's quotient of the shape into which the tool's force bends
    the arm, and a tenth more. On twenty poses the loop of ``hybrid-adaptive`` has the largest gain margin
    with its notch there (`python -m benchmarks.arm_notch`).
    """
    modes = []
    for about in abouts:
        moving = motion_matrices(about)
        tool = np.append(about.axis @ about.jacobian[:3], np.zeros(6))
        bent = np.linalg.solve(moving.stiffness + springs * np.outer(tool, tool), tool)
        modes.append(math.sqrt(tool @ bent / (bent @ moving.mass @ bent)))
    return _ABOVE * np.array(modes)
