"""What clients are sent on the ports of text and states: the dashboard, a line for a line (29999); states and
messages (30001, 30002); the real-time state (30003)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from polish_sim.motion import JOINT_LIMITS
from polish_sim.motion.kinematics import NOMINAL, used_arm
from polish_sim.ur.controller import UNLOCK_TICKS, VERSION, RobotController, framed, message
from polish_sim.ur.robot import IDLE, NORMAL, PAUSED, PLAYING, POWER_OFF, PROTECTIVE, RUNNING, STOPPED
from polish_sim.ur.rtde import output_value

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL = "20265500001"
MODES = {POWER_OFF: "POWER_OFF", IDLE: "IDLE", RUNNING: "RUNNING"}
SAFETY = {NORMAL: "NORMAL", PROTECTIVE: "PROTECTIVE_STOP"}
STATES = {STOPPED: "STOPPED", PLAYING: "PLAYING", PAUSED: "PAUSED"}
LONGEST = 4096  #: Of a line
BYE = "Disconnected"


def _play(controller: RobotController, _: str) -> str:
    return "Starting program" if controller.play() else "Failed to execute: play"


def _pause(controller: RobotController, _: str) -> str:
    if controller.robot.runtime == STOPPED:
        return "Failed to execute: pause"
    controller.pause()
    return "Pausing program"


def _unlock(controller: RobotController, _: str) -> str:
    if controller.unlock(UNLOCK_TICKS):
        return "Protective stop releasing"
    return (
        "Cannot unlock protective stop until 5s after occurrence. "
        "Always inspect cause of protective stop before unlocking"
    )


def _log(controller: RobotController, text: str) -> str:
    controller.note(text)
    return "Added log message" if text else "No log message to add"


def _version(controller: RobotController, _: str) -> str:
    major, minor, bugfix, build = controller.version
    return f"URSoftware {major}.{minor}.{bugfix}.{build} (Jan 01 2026)"


COMMANDS: Mapping[str, Any] = {
    "load": lambda c, name: f"File not found: {name}",
    "play": _play,
    "stop": lambda c, _: c.stop("by the dashboard") or "Stopped",
    "pause": _pause,
    "quit": BYE,
    "shutdown": lambda c, _: c.power(POWER_OFF) or "Shutting down",
    "running": lambda c, _: f"Program running: {str(c.robot.runtime == PLAYING).lower()}",
    "popup": lambda c, text: c.popup(text, "Message", False, False, False) or "showing popup",
    "close popup": lambda c, _: c.close_popup() or "closing popup",
    "close safety popup": "closing safety popup",
    "polyscopeversion": _version,
    "version": _version,
    "programstate": lambda c, _: f"{STATES[c.robot.runtime]} {c.program or 'null'}",
    "power on": lambda c, _: c.power(IDLE) or "Powering on",
    "power off": lambda c, _: c.power(POWER_OFF) or "Powering off",
    "brake release": lambda c, _: c.power(RUNNING) or "Brake releasing",
    "unlock protective stop": _unlock,
    "robotmode": lambda c, _: f"Robotmode: {MODES[c.robot.mode]}",
    "get robot model": "UR5",
    "get loaded program": "No program loaded",
    "get serial number": SERIAL,
    "get operational mode": "NONE",
    "addtolog": _log,
    "isprogramsaved": lambda c, _: f"true {c.program or 'null'}",
    "is in remote control": "true",
    "setuserrole": lambda c, role: f"Setting user role: {role}",
    "getuserrole": "PROGRAMMER",
    "safetymode": lambda c, _: f"Safetymode: {SAFETY[c.robot.safety]}",
    "safetystatus": lambda c, _: f"Safetystatus: {SAFETY[c.robot.safety]}",
    "restart safety": "Restarting safety",
}
"""What each command answers, or what does it and answers, by its words in lower case."""


def answer(controller: RobotController, line: str) -> str:
    """The answer to a line; the longest command that it begins with counts."""
    words = line.split()
    for count in range(len(words), 0, -1):
        command = COMMANDS.get(" ".join(words[:count]).lower())
        if command is not None:
            return command if isinstance(command, str) else str(command(controller, " ".join(words[count:])))
    return f"could not understand: '{line}'"


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
        _part(2, ">18xf5xfB", 48.0, 30.0, controller.joint_mode),
        _part(
            3,
            ">4xi18x2b2d3f4xB9x",
            r.digital_out,
            *r.analog_domain,
            *r.signals["standard_analog_out"],
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
    values = np.concatenate([
        np.ravel(output_value(controller, part)) if isinstance(part, str) else np.zeros(part)
        for part in REALTIME
    ])  # fmt: skip
    return struct.pack(">i", 4 + 8 * len(values)) + values.astype(">f8").tobytes()


def _part(kind: int, form: str, *values: float) -> bytes:
    return framed(kind, struct.pack(form, *values))
