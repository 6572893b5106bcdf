"""A robot's joints beside the simulation's: torques, ripple and friction by joint (log -> replay ->
figures)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from polish_sim.arms import arm_table
from polish_sim.arrays import Array
from polish_sim.cell.real_arm import take_arm
from polish_sim.compare.figures import SPEEDS, delay, fit_friction, friction_curve, nrms, ripple
from polish_sim.compare.replay import CarriedPayload, commands_of, replay, rigid_torques, warm
from polish_sim.config import RobotConfig
from polish_sim.exchange.robot_log import RobotRecording

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
