"""A log's motion replayed in free space: what the simulated arm does and needs for it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from polish_sim.arrays import Array
from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.cell.scene import build_scene
from polish_sim.config import RobotConfig, Scenario, SpindleConfig
from polish_sim.exchange.robot_log import RobotRecording
from polish_sim.planning.toolpath import interpolate

SCENARIO = Scenario(experiment="compare", robot=RobotConfig(), spindle=SpindleConfig(speed_rpm=0.0))
MOTION_HZ = 4.0  #: What of a measured motion was commanded [Hz]
CLOCK_S = 0.005  #: On which it is looked at [s]
LEAD_S = 0.5  #: In which the arm gets up to the speed a log begins with [s]
_NO_TOOL = 1e-3  #: Mass of a tool that is not there [kg]


class CarriedPayload(NamedTuple):
    """What the real arm carried."""

    mass: float = 0.0  #: [kg]
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)  #: From the flange, its axes [m]


class Replay(NamedTuple):
    """The simulated arm at the log's times, shape (n, 6)."""

    q: Array  #: By the encoders [rad]
    qd: Array  #: [rad/s]
    torque: Array  #: Of the motors, the arm's weight included [N m]


def replay(robot: RobotConfig, log: RobotRecording, payload: CarriedPayload) -> Replay:
    """Play a log's commanded joints, or its measured ones, on the servos of an arm.

    The arm is bare but for the ``payload``, which its controller does not know. A log that begins in
    motion gets a run-up to its start.

    Raises:
        ReachError: Links would touch each other.
        ProtectiveStop: The simulation ran away.
    """
    model = bare_arm(robot, payload)
    dt = model.opt.timestep
    wanted = commands_of(log)
    t = np.arange(-round(LEAD_S / dt), round(log.time[-1] / dt) + 1) * dt
    inside = np.maximum(t, 0.0)
    q, qd = wanted(inside), wanted(inside, 1)
    # From rest to the first speed at a constant acceleration.
    lead = t < 0.0
    first = qd[0]
    share = 1.0 + t[lead, None] / LEAD_S
    q[lead] = q[0] - first * LEAD_S * 0.5 * (1.0 - share**2)
    qd[lead] = first * share
    played = play_joints(model, robot, SCENARIO.seed, JointTargets(q, qd))
    still = np.zeros_like(q)
    if not robot.elastic:
        played.torque[:] += rigid_torques(robot, played.q, still, still, payload)
    return Replay(*(
        interpolate(log.time, t, values)
        for values in (played.read, played.qd, played.torque)
    ))  # fmt: skip


def commands_of(log: RobotRecording) -> CubicSpline:
    """The commanded joints over the log's time; those measured if it has none, without what their gears add.

    A measured motion repeats its gears' error 202 times a turn: played as a command, the rotors' inertia
    would make torque of it. It is low-passed, forwards and backwards, at `MOTION_HZ`.
    """
    if "q_desired_rad" in log.values:
        return CubicSpline(log.time, log.values["q_desired_rad"])
    t = np.arange(log.time[0], log.time[-1], CLOCK_S)
    q = CubicSpline(log.time, log.values["q_rad"])(t)
    low = butter(2, MOTION_HZ, fs=1.0 / CLOCK_S, output="sos")
    return CubicSpline(
        t, sosfiltfilt(low, q, axis=0, padtype="odd", padlen=min(len(t) - 1, round(1.0 / CLOCK_S)))
    )


def rigid_torques(robot: RobotConfig, q: Array, qd: Array, qdd: Array, payload: CarriedPayload) -> Array:
    """Torques the bare arm with its rotors and payload takes without friction, (n, 6) [N m]."""
    model = bare_arm(robot, payload)
    model.body_gravcomp[:] = model.dof_frictionloss[:] = model.dof_damping[:] = 0.0
    model.dof_armature[:6] = robot.real.rotor_kg_m2
    model.jnt_stiffness[:] = 0.0
    data = mujoco.MjData(model)
    torques = np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:6] = q[k]
        data.qvel[:6] = qd[k]
        data.qacc[:6] = qdd[k]
        mujoco.mj_inverse(model, data)
        torques[k] = data.qfrc_inverse[:6]
    return torques


def bare_arm(robot: RobotConfig, payload: CarriedPayload) -> mujoco.MjModel:
    """Compile an arm in free space, a payload on its flange for its tool; the robot compensates neither."""
    model = build_scene(replace(SCENARIO, robot=robot))
    mount = model.body("tool_mount").id
    head = model.body("head").id
    mass = max(payload.mass, _NO_TOOL)
    for body in (mount, head):
        scale = (mass if body == mount else _NO_TOOL) / model.body_mass[body]
        model.body_inertia[body] *= scale
        model.body_mass[body] *= scale
    model.body_ipos[mount] = payload.center
    model.body_gravcomp[mount] = 0.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def warm(robot: RobotConfig) -> RobotConfig:
    """The arm warm, its table exact and no packet missed: logs do not show these."""
    real = replace(robot.real, cold_friction=0.0, kinematics="exact", missed_every_s=0.0)
    return replace(robot, real=real)
