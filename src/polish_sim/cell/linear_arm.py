"""The real arm as a linear model about a pose: links and rotors on the gears' springs, and how the gears shake it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array
from polish_sim.cell.gears import RealArm, slip
from polish_sim.cell.guards import FOLLOW_S
from polish_sim.cell.real_arm import build_real_arm, gear_twists, weights
from polish_sim.cell.scene import build_scene, tool_on_flange
from polish_sim.cell.wrist_sensor import carried_payload
from polish_sim.config import Scenario
from polish_sim.motion.kinematics import track
from polish_sim.spatial import transform

if TYPE_CHECKING:
    from polish_sim.cell.stroke import Stroke


class JointsAbout(NamedTuple):
    """What the linear motion of an arm about a pose consists of."""

    arm: RealArm
    inertia: Array  #: Of the links and all they carry [kg m^2], shape (6, 6)
    jacobian: Array  #: Of the tool point (linear; angular), shape (6, 6)
    axis: Array  #: Tool z in the base frame, shape (3,)
    head: float  #: Mass of the head, which the inertia includes [kg]
    carried: float  #: Mass the wrist sensor carries [kg]
    weight: Array  #: Torques that hold the weight [N m], shape (6,)


def joints_about(scenario: Scenario, q: Array) -> list[JointsAbout]:
    """The elastic arm of a scenario at rest with its encoders at each of ``q`` (n, 6) [rad], nothing around it.

    What is drawn of the arm, and its damping, are those of the first pose.
    """
    model = build_scene(scenario, None, None)
    data = mujoco.MjData(model)
    data.qpos[:6] = q[0]
    arm = build_real_arm(scenario, model, data, q[0])
    tool, head = model.site("tool").id, float(model.body("head").mass[0])
    abouts, rested = [], data.qpos[:6] - q[0]
    for pose, weight in zip(q, weights(model, q + rested), strict=True):
        data.qpos[:6] = pose + rested
        mujoco.mj_forward(model, data)
        inertia, J = np.zeros((model.nv, model.nv)), np.zeros((6, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        mujoco.mj_jacSite(model, data, J[:3], J[3:], tool)
        axis = data.site_xmat[tool].reshape(3, 3)[:, 2].copy()
        carried = float(carried_payload(model, data).mass)
        abouts.append(JointsAbout(arm, inertia[:6, :6], J[:, :6], axis, head, carried, weight))
    return abouts


class MotionMatrices(NamedTuple):
    """M x'' + D x' + K x = 0 of links and rotors x (12,) [rad] about a pose, each (12, 12)."""

    mass: Array
    stiffness: Array
    damping: Array


_ABOUT = 2.0 * math.pi * 20.0  # where the damping of the hysteresis is matched [rad/s]


class Gears(NamedTuple):
    """Linear gears about a pose, shape (6,) each."""

    stiffness: Array  #: [N m/rad]
    damping: Array  #: [N m s/rad]


def gears_about(scenario: Scenario, about: JointsAbout, slipping: Array) -> Gears:
    """The gears under the weight and the contact force, with what `slipping_gears` says of their hysteresis."""
    torque = about.weight + scenario.process.contact_force_n * about.axis @ about.jacobian[:3]
    more = gear_twists(scenario.robot.real, np.stack([torque - 1e-3, torque + 1e-3]))
    return Gears(2e-3 / (more[1] - more[0]) + slipping.real, np.array(about.arm.coupling) + slipping.imag / _ABOUT)


def motion_matrices(about: JointsAbout, gears: Gears) -> MotionMatrices:
    """Links on gears on rotors on servos; the head slides on its spring.

    Coulomb friction of the motors is left out; it damps.
    """
    arm, tool = about.arm, about.axis @ about.jacobian[:3]
    mass = np.zeros((12, 12))
    mass[:6, :6], mass[6:, 6:] = about.inertia - about.head * np.outer(tool, tool), np.diag(arm.inertia)
    matrices = []
    for gear, servo in ((gears.stiffness, arm.kp), (gears.damping, arm.kv + (1.0 + arm.cold) * np.array(arm.viscous))):
        twisted = np.diag(gear)
        matrices.append(np.block([[twisted, -twisted], [-twisted, twisted + np.diag(servo)]]))
    return MotionMatrices(mass, *matrices)


def slipping_gears(arm: RealArm, swing: float) -> Array:
    """Torque of the gears' hysteresis by their twist at an amplitude ``swing`` [rad], complex, shape (6,) [N m/rad].

    By harmonic balance; the imaginary part leads, and damps.
    """
    return np.array([_slipping(arm, j, swing) for j in range(6)])


def _slipping(arm: RealArm, j: int, swing: float) -> complex:
    if swing == 0.0:
        return complex(arm.lost_torque[j] / arm.rise)
    phase = np.linspace(0.0, 2.0 * math.pi, 401)
    twist, torque, torques = swing * np.cos(phase), 0.0, np.empty(400)
    for _ in range(3):
        for k in range(400):
            torque = torques[k] = slip.py_func(torque, twist[k + 1] - twist[k], arm.lost_torque[j], arm.rise)
    return complex(np.mean(2.0 * torques * np.exp(-1j * phase[1:])) / swing)


# Where the wrists turn fast, the gears' transmission error shakes the arm, and the sensor feels what it carries shake.

ROWS = 400  #: Places along a motion that are looked at
SWING = 5e-5  #: Amplitude of the gears' twist the shaking is computed at [rad]


class Shaking(NamedTuple):
    """The largest jump of the wrist sensor's reading that the gears' error makes along some strokes."""

    jump_n: float  #: As the guard of ``safety.jump_limit_n`` measures it [N]
    at_m: float  #: Arc length of the path there [m]
    joint: int  #: The joint with the largest share, 1 to 6
    speed_rad_s: float  #: Its speed there [rad/s]


def measure_shaking(scenario: Scenario, strokes: Sequence[Stroke], q_start: Array) -> Shaking:
    """Estimate how the gears' transmission error shakes the sensor's load along strokes that begin at ``q_start`` (6,).

    Each joint excites the linear arm at its gear's period and at half of it, as if its speed held; jumps of several
    joints add as their squares do.
    """
    worst = Shaking(0.0, 0.0, 0, 0.0)
    for stroke in strokes:
        motion = stroke.motion
        rows = np.unique(np.linspace(0, len(motion.positions) - 1, ROWS).astype(int))
        R = Rotation.from_quat(motion.quaternions[rows], scalar_first=True).as_matrix()
        poses = np.array([transform(*pose) for pose in zip(R, motion.positions[rows], strict=True)])
        q = track(poses, tool_on_flange(), q_start).q
        twists = np.concatenate([motion.velocities, motion.spins], axis=1)[rows] * motion.rates[rows, None]
        q_start, abouts = q[-1], joints_about(scenario, q)
        slipping = slipping_gears(abouts[0].arm, SWING)
        for row, about, twist in zip(rows, abouts, twists, strict=True):
            speed = np.linalg.solve(about.jacobian, twist)
            jumps = reading_jumps(scenario, about, gears_about(scenario, about, slipping), speed)
            jump, j = float(np.linalg.norm(jumps)), int(jumps.argmax())
            if jump > worst.jump_n:
                at = stroke.start_s + float(motion.places[row])
                worst = Shaking(jump, at, j + 1, float(abs(speed[j])))
    return worst


def reading_jumps(scenario: Scenario, about: JointsAbout, gears: Gears, speed: Array) -> Array:
    """Jump of the reading by each joint's gear turning at ``speed`` (6,) [rad/s], shape (6,) [N]."""
    real, jumps = scenario.robot.real, np.zeros(6)
    mass, stiffness, damping = motion_matrices(about, gears)
    corner = 2.0 * math.pi * (scenario.sensor.bandwidth_hz or math.inf)
    for j in range(6):
        for harmonic, share in ((1, 1.0), (2, real.second_harmonic)):
            omega = harmonic * 2.0 * real.gear_ratio * abs(speed[j])
            push = np.zeros(12, complex)
            push[j] = 0.5 * share * real.gear_error_rad[j] * (gears.stiffness[j] + 1j * omega * gears.damping[j])
            push[6 + j] = -push[j]
            swings = np.linalg.solve(stiffness + 1j * omega * damping - omega**2 * mass, push)
            force = about.carried * omega**2 * np.linalg.norm(about.jacobian[:3] @ swings[:6])
            jumps[j] += force * omega * FOLLOW_S / math.hypot(1.0, omega * FOLLOW_S) / math.hypot(1.0, omega / corner)
    return jumps
