"""Ports 30001 and 30002, states and messages; port 30003, the real-time state."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from polish_sim.motion import JOINT_LIMITS
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.motion.makes import used_arm
from polish_sim.ur.controller import VERSION, RobotController, framed, message
from polish_sim.ur.rtde import output_numbers

ROBOT_STATE = 16
STATE_HZ = 10.0
BOX, SUB_TYPE = 7, 1  #: Controller of an e-Series


def version_message(controller: RobotController) -> bytes:
    """The first message a client receives."""
    body = struct.pack(">B9sBBii10s", 9, b"URControl", *controller.version, b"01-01-2026")
    return message(VERSION, controller.robot.time_s, body)


def robot_state(controller: RobotController, configuration: bool) -> bytes:
    """The state of robot, joints, tool and boards; with kinematics and ``configuration``, which do not
    change."""
    r = controller.robot
    playing = r.runtime
    stopped = r.safety != 1
    parts = [
        _part(
            0,
            ">Q3?x3?bx3dx",
            int(1e6 * r.time_s),
            True,
            True,
            controller.powered,
            stopped,
            playing == 2,
            playing == 4,
            r.mode,
            r.speed_fraction,
            float(playing == 2),
            1.0,
        ),
        _joints(controller),
        _part(2, ">18xfB4xfB", 48.0, r.tool_voltage, 30.0, controller.joint_mode),
        _part(
            3,
            ">ii18x2b2d3f4xB9x",
            r.digital_in,
            r.digital_out,
            *r.analog_domain,
            *r.analog_out,
            30.0,
            48.0,
            0.5,
            r.safety,
        ),
        _part(4, ">12d", *r.actual_tcp_pose, *r.tcp_offset),
        _part(7, ">6d8x", *r.tcp_force),
        _part(8, ">4x"),
    ]
    if configuration:
        theta, d, a, alpha = NOMINAL
        parts.append(_part(5, ">6I24d4x", *range(6), *theta, *a, *d, *alpha))
        limits = np.column_stack([np.full(6, np.pi), np.full(6, 40.0)])
        parts.append(
            _part(
                6,
                ">12d12d5d24d4x3i4x",
                *JOINT_LIMITS.ravel(),
                *limits.ravel(),
                1.05,
                1.4,
                0.25,
                1.2,
                0.05,
                *a,
                *d,
                *alpha,
                *theta,
                BOX,
                used_arm().type_number,
                SUB_TYPE,
            )
        )
    return framed(ROBOT_STATE, b"".join(parts))


def _joints(controller: RobotController) -> bytes:
    r = controller.robot
    columns = zip(r.actual_q, r.target_q, r.actual_qd, r.joint_torques / 10.0, strict=True)
    joints = (struct.pack(">3d4fB", *column, 48.0, 30.0, 30.0, controller.joint_mode) for column in columns)
    return framed(1, b"".join(joints))


REALTIME: Sequence[str | int] = [
    "timestamp", "target_q", "target_qd", "target_qdd", "target_current", "target_moment",
    "actual_q", "actual_qd", "actual_current", "joint_control_output",
    "actual_TCP_pose", "actual_TCP_speed", "actual_TCP_force", "target_TCP_pose", "target_TCP_speed",
    "actual_digital_input_bits", "joint_temperatures", "actual_execution_time", 1,
    "robot_mode", "joint_mode", "safety_mode", 6, "actual_tool_accelerometer", 6,
    "speed_scaling", "actual_momentum", 2, "actual_main_voltage", "actual_robot_voltage",
    "actual_robot_current", "actual_joint_voltage", "actual_digital_output_bits", "runtime_state",
    "elbow_position", "elbow_velocity", "safety_status", 3, "payload", "payload_cog", "payload_inertia",
]  # fmt: skip
"""What port 30003 sends: outputs of RTDE, and how many numbers in between are not used."""


def realtime_state(controller: RobotController) -> bytes:
    """The 1220 bytes of port 30003."""
    values = list[float]()
    for part in REALTIME:
        values += output_numbers(controller, part) if isinstance(part, str) else [0.0] * part
    return struct.pack(f">i{len(values)}d", 4 + 8 * len(values), *values)


def _part(kind: int, form: str, *values: float) -> bytes:
    return framed(kind, struct.pack(form, *values))
