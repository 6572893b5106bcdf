"""Port 29999: the dashboard, a line for a line."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from polish_sim.ur.controller import UNLOCK_TICKS, RobotController
from polish_sim.ur.robot import IDLE, NORMAL, PAUSED, PLAYING, POWER_OFF, PROTECTIVE, RUNNING, STOPPED

GREETING = "Connected: Universal Robots Dashboard Server"
SERIAL = "20265500001"
MODES = {POWER_OFF: "POWER_OFF", IDLE: "IDLE", RUNNING: "RUNNING"}
SAFETY = {NORMAL: "NORMAL", PROTECTIVE: "PROTECTIVE_STOP"}
STATES = {STOPPED: "STOPPED", PLAYING: "PLAYING", PAUSED: "PAUSED"}
LONGEST = 4096  #: Of a line
BYE = "Disconnected"


def _done(act: Callable[[RobotController, str], object], said: str) -> Callable[[RobotController, str], str]:
    def command(controller: RobotController, words: str) -> str:
        act(controller, words)
        return said

    return command


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


COMMANDS: Mapping[str, str | Callable[[RobotController, str], str]] = {
    "load": lambda c, name: f"File not found: {name}",
    "play": _play,
    "stop": _done(lambda c, _: c.stop("by the dashboard"), "Stopped"),
    "pause": _pause,
    "quit": BYE,
    "shutdown": _done(lambda c, _: c.power(POWER_OFF), "Shutting down"),
    "running": lambda c, _: f"Program running: {str(c.robot.runtime == PLAYING).lower()}",
    "popup": _done(lambda c, text: c.popup(text, "Message", False, False, False), "showing popup"),
    "close popup": _done(lambda c, _: c.close_popup(), "closing popup"),
    "close safety popup": "closing safety popup",
    "polyscopeversion": _version,
    "version": _version,
    "programstate": lambda c, _: f"{STATES[c.robot.runtime]} {c.program or 'null'}",
    "power on": _done(lambda c, _: c.power(IDLE), "Powering on"),
    "power off": _done(lambda c, _: c.power(POWER_OFF), "Powering off"),
    "brake release": _done(lambda c, _: c.power(RUNNING), "Brake releasing"),
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
"""What each command does and answers, by its words in lower case."""


def answer(controller: RobotController, line: str) -> str:
    """The answer to a line; the longest command that it begins with counts."""
    words = line.split()
    for count in range(len(words), 0, -1):
        command = COMMANDS.get(" ".join(words[:count]).lower())
        if command is not None:
            return command if isinstance(command, str) else command(controller, " ".join(words[count:]))
    return f"could not understand: '{line}'"
