"""A log's motion replayed in free space: what the simulated arm does and needs for it, and torques, ripple
and friction of its joints beside the robot's."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import mujoco
import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from polish_sim.arms import arm_table
from polish_sim.arrays import Array
from polish_sim.cell.playback import JointTargets, play_joints
from polish_sim.cell.real_arm import take_arm
from polish_sim.cell.scene import build_scene
from polish_sim.compare.figures import SPEEDS, delay, fit_friction, friction_curve, nrms, ripple
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
    center: tuple[float, ...] = (0.0, 0.0, 0.0)  #: From the flange, its axes [m]


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


JOINTS = range(6)
_SHARP = 0.01  #: Speed in which Coulomb's friction changes its sign where it is taken off [rad/s]


class JointComparison(NamedTuple):
    """Curves on the log's rows and what was measured of them."""

    time: Array  #: [s], shape (n,)
    measured_q: Array  #: [rad], shape (n, 6)
    simulated_q: Array
    measured: Array  #: Torques [N m], shape (n, 6); empty, (0, 6), if the log has none
    simulated: Array
    curves: Array  #: Friction by speed, measured and simulated, shape (2, 6, k) [N m]
    figures: dict[str, Any]


def compare_joints(robot: RobotConfig, log: RobotRecording, payload: CarriedPayload) -> JointComparison:
    """Replay a log and measure both sides alike; raises as `replay`."""
    take_arm(robot)
    robot = warm(robot)
    played = replay(robot, log, payload)
    measured = log.torques(arm_table(robot.arm).torque_constants)
    q = log.values["q_rad"]
    figures: dict[str, Any] = {
        "motion_delay_s": delay(log.time, q, played.q),
        "motion_rms_rad": np.sqrt(np.mean((q - played.q) ** 2, axis=0)).tolist(),
    }
    curves = np.full((2, 6, len(SPEEDS) - 1), np.nan)
    if len(measured):
        commands = commands_of(log)
        qd = commands(log.time, 1)
        qdd = commands(log.time, 2)
        rigid = rigid_torques(robot, commands(log.time), qd, qdd, payload)
        figures |= {
            "nrms": nrms(measured, played.torque).tolist(),
            "delay_s": delay(log.time, measured, played.torque),
        }
        for side, (torque, prefix) in enumerate(((measured, ""), (played.torque, "simulated_"))):
            found = [_one_joint(log.time, q[:, j], qd[:, j], torque[:, j], rigid[:, j]) for j in JOINTS]
            figures |= {prefix + name: [one[name] for one in found] for name in found[0]}
            curves[side] = [friction_curve(qd[:, j], torque[:, j], rigid[:, j]) for j in JOINTS]
        off = curves[1] / curves[0] - 1.0
        figures["friction_curve_error"] = [_largest(row) for row in off]
    return JointComparison(log.time, q, played.q, measured, played.torque, curves, figures)


def _one_joint(time: Array, q: Array, qd: Array, torque: Array, rigid: Array) -> dict[str, float]:
    found = fit_friction(qd, torque, rigid)
    sign = np.tanh(qd / _SHARP)
    share = np.where(rigid * qd > 0.0, found.driving, found.driven)
    rubbing = sign * (found.coulomb + found.viscous * np.abs(qd) + share * np.abs(rigid))
    line = ripple(time, q, qd, torque - rigid - rubbing)
    names = {"coulomb_nm": found.coulomb, "viscous_nm_s_rad": found.viscous, "driving": found.driving}
    return {"ripple_cycles": line.cycles, "ripple_nm": line.amplitude, **names, "driven": found.driven}


def _largest(values: Array) -> float:
    there = values[np.isfinite(values)]
    return float(there[np.abs(there).argmax()]) if len(there) else float("nan")
