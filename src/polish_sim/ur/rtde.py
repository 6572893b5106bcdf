"""Port 30004, the Real-Time Data Exchange: versions 1 and 2, recipes, registers claimed by one client at a
time."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from polish_sim.spatial import GRAVITY
from polish_sim.ur.controller import RobotController
from polish_sim.ur.robot import PINS, PLAYING, bits_of

VERSION, CONTROLLER, TEXT, DATA = ord("V"), ord("v"), ord("M"), ord("U")
OUTPUTS, INPUTS, START, PAUSE = ord("O"), ord("I"), ord("S"), ord("P")
FORMATS: Mapping[str, str] = {
    "BOOL": "?", "UINT8": "u1", "UINT32": ">u4", "UINT64": ">u8", "INT32": ">i4", "DOUBLE": ">f8",
    "VECTOR3D": "3>f8", "VECTOR6D": "6>f8", "VECTOR6INT32": "6>i4", "VECTOR6UINT32": "6>u4",
}  # fmt: skip
"""Types as numpy has them."""
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
MOST_RECIPES = 255
MOST_HZ = 500.0
UNSENT = 1 << 20  #: Bytes a slow reader may leave unread before it is dropped


PACKED = {"bit_registers0_to_31": 0, "bit_registers32_to_63": 32}
"""Fields of 32 bits each, and the first of them."""
REGISTERS = {
    "INT32": [f"int_register_{k}" for k in range(48)],
    "DOUBLE": [f"double_register_{k}" for k in range(48)],
    "BOOL": [f"bit_register_{k}" for k in range(64, 128)],
    "UINT32": list(PACKED),
}
"""Registers of either side by type."""


class ProtocolError(Exception):
    """A client sent what no RTDE client sends: it is dropped."""


def _register(name: str, controller: RobotController) -> Any:
    """The value of a register, or 32 bits packed."""
    signal, _, number = name.rpartition("_")
    side, _, field = name.partition("_")
    if field in PACKED:
        first = PACKED[field]
        return bits_of(controller.robot.signals[f"{side}_bit_register"][first : first + 32])
    return controller.robot.signals[signal][int(number)]


SOURCES: Mapping[str, Mapping[str, Any]] = {
    "VECTOR6D": {
        "target_q": "robot.target_q",
        "target_qd": "robot.target_qd",
        "target_qdd": "robot.target_qdd",
        "target_moment": "robot.joint_torques",
        **dict.fromkeys(
            ("target_current", "actual_current", "joint_control_output"),
            lambda c: c.robot.joint_torques / c.torque_constants,
        ),
        "actual_q": "robot.actual_q",
        "actual_qd": "robot.actual_qd",
        "actual_current_as_torque": "robot.joint_torques",
        "actual_TCP_pose": "robot.actual_tcp_pose",
        "actual_TCP_speed": "robot.actual_tcp_speed",
        "actual_TCP_force": "robot.tcp_force",
        "target_TCP_pose": "robot.target_tcp_pose",
        "target_TCP_speed": "robot.target_tcp_speed",
        "tcp_offset": "robot.tcp_offset",
        "payload_inertia": "robot.payload_inertia",
        "ft_raw_wrench": "robot.raw_wrench",
        "wrench_calc_from_currents": "robot.tcp_force",
        "actual_current_window": np.full(6, 10.0),
        "joint_temperatures": np.full(6, 30.0),
        "actual_joint_voltage": np.full(6, 48.0),
    },
    "VECTOR3D": {
        "payload_cog": "robot.payload_cog",
        "elbow_position": lambda c: c.elbow()[:3],
        "elbow_velocity": lambda c: c.elbow()[3:],
        "actual_tool_accelerometer": [0.0, 0.0, GRAVITY],
    },
    "DOUBLE": {
        "timestamp": "robot.time_s",
        "target_speed_fraction": "robot.speed_fraction",
        "payload": "robot.payload_mass",
        "speed_scaling": lambda c: float(c.robot.runtime == PLAYING),
        "actual_robot_voltage": lambda c: 48.0 * c.powered,
        "standard_analog_output0": lambda c: c.robot.signals["standard_analog_out"][0],
        "standard_analog_output1": lambda c: c.robot.signals["standard_analog_out"][1],
        "tcp_force_scalar": lambda c: float(np.linalg.norm(c.robot.tcp_force[:3])),
        "actual_execution_time": 1.0,
        "actual_main_voltage": 48.0,
        "actual_robot_current": 0.5,
        "tool_temperature": 30.0,
        **dict.fromkeys(
            [
                "actual_momentum",
                "standard_analog_input0",
                "standard_analog_input1",
                "io_current",
                "euromap67_24V_voltage",
                "euromap67_24V_current",
                "tool_analog_input0",
                "tool_analog_input1",
                "tool_output_current",
                "joint_position_deviation_ratio",
                "collision_detection_ratio",
            ],
            0.0,
        ),
    },
    "UINT64": {
        "actual_digital_input_bits": 0,
        "actual_digital_output_bits": "robot.digital_out",
    },
    "INT32": {
        "robot_mode": "robot.mode",
        "safety_mode": "robot.safety",
        "safety_status": "robot.safety",
        "tool_output_voltage": 0,
        "time_scale_source": 0,
    },
    "UINT32": {
        "runtime_state": "robot.runtime",
        "robot_status_bits": "status_bits",
        "safety_status_bits": "safety_bits",
        "tool_mode": "joint_mode",
        "analog_io_types": lambda c: c.robot.analog_domain[0] << 2 | c.robot.analog_domain[1] << 3,
        "script_control_line": 0,
        "euromap67_input_bits": 0,
        "euromap67_output_bits": 0,
        "tool_analog_input_types": 0,
    },
    "UINT8": {"tool_output_mode": 0, "tool_digital_output0_mode": 1, "tool_digital_output1_mode": 1},
    "VECTOR6INT32": {"joint_mode": lambda c: [c.joint_mode] * 6},
}
"""Output fields by type: where the controller has them, what asks it for them, or what the cell does not have
at its value of a robot at rest."""
FIELDS: Mapping[str, tuple[str, Any]] = {
    **{
        name: (kind, attrgetter(source) if isinstance(source, str) else source)
        for kind, some in SOURCES.items()
        for name, source in some.items()
    },
    **{
        f"{side}_{name}": (kind, partial(_register, f"{side}_{name}"))
        for side in ("input", "output")
        for kind, names in REGISTERS.items()
        for name in names
    },
}
"""Output fields: type, and value or what asks a controller for it."""


def output_value(controller: RobotController, name: str) -> Any:
    """The value of an output, of a vector an array or a list."""
    value = FIELDS[name][1]
    return value(controller) if callable(value) else value


SETTINGS: Mapping[str, str] = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    **{f"{group}_digital_output{end}": "UINT8" for group in PINS for end in ("", "_mask")},
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
}
"""Input fields that are no registers: type."""


def _input_type(name: str) -> str:
    is_register = name.startswith("input_") and name in FIELDS
    return FIELDS[name][0] if is_register else SETTINGS.get(name, NOT_FOUND)


class Recipe(NamedTuple):
    """Names in the order of a package's data, and how that is packed."""

    names: list[str]
    data: np.dtype[np.void]


def recipe_of(names: list[str], types: list[str]) -> Recipe:
    """The recipe of fields that all exist."""
    return Recipe(names, np.dtype([("", FORMATS[kind]) for kind in types]))


def apply_inputs(controller: RobotController, values: Mapping[str, Any]) -> None:
    """Set registers, slider and outputs as a client's package says."""
    robot = controller.robot
    robot.written.update(dict.fromkeys(values, robot.ticks))
    for name, value in values.items():
        first = PACKED.get(name.removeprefix("input_"))
        if first is not None:
            robot.signals["input_bit_register"][first : first + 32] = [
                bool(value >> k & 1) for k in range(32)
            ]
        elif name.startswith("input_"):
            signal, _, number = name.rpartition("_")
            robot.signals[signal][int(number)] = value
    if values.get("speed_slider_mask"):
        robot.set_speed_fraction(values.get("speed_slider_fraction", robot.speed_fraction))
    for group, count in PINS.items():
        bits = values.get(f"{group}_digital_output", 0)
        mask = values.get(f"{group}_digital_output_mask", 0)
        for index in range(count):
            if mask >> index & 1:
                robot.write(f"{group}_digital_out", index, bits >> index & 1)
    for index in (0, 1):
        if values.get("standard_analog_output_mask", 0) >> index & 1:
            robot.write("standard_analog_out", index, values.get(f"standard_analog_output_{index}", 0.0))
            robot.analog_domain[index] = values.get("standard_analog_output_type", 0) >> index & 1
    if "external_force_torque" in values and np.isfinite(values["external_force_torque"]).all():
        robot.external = np.array(values["external_force_torque"])


@dataclass
class RtdeSession:
    """One client of the port: feed it bytes, it answers; see ``package`` for what it gets each tick."""

    controller: RobotController
    send: Callable[[bytes], None]
    client: str = ""  #: Its address
    version: int = 1
    started: bool = False
    answered: bool = True  #: Whether it has sent data since its last package
    outputs: dict[int, tuple[Recipe, float]] = field(default_factory=dict)
    inputs: dict[int, Recipe] = field(default_factory=dict)
    _due: dict[int, float] = field(default_factory=dict)
    _buffer: bytes = b""

    def feed(self, data: bytes) -> None:
        """Take bytes in pieces of any size; ProtocolError where they are no packages."""
        self._buffer += data
        while len(self._buffer) >= 3:
            size, kind = struct.unpack_from(">HB", self._buffer)
            if size < 3:
                raise ProtocolError(f"a package of {size} bytes")
            if len(self._buffer) < size:
                return
            body = self._buffer[3:size]
            self._buffer = self._buffer[size:]
            self._take(kind, body)

    def _take(self, kind: int, body: bytes) -> None:
        try:
            if kind == VERSION:
                (asked,) = struct.unpack(">H", body)
                accepted = asked in (1, 2)
                self.version = asked if accepted else self.version
                self._reply(VERSION, bytes([accepted]))
            elif kind == CONTROLLER:
                self._reply(CONTROLLER, struct.pack(">4I", *self.controller.version))
            elif kind == OUTPUTS:
                self._set_outputs(body)
            elif kind == INPUTS:
                self._set_inputs(body)
            elif kind in (START, PAUSE):
                self.started = kind == START and bool(self.outputs or self.inputs)
                self._due = dict.fromkeys(self.outputs, self.controller.robot.ticks + 1.0)
                self._reply(kind, bytes([self.started if kind == START else True]))
            elif kind == DATA:
                self._take_data(body)
            elif kind != TEXT:
                raise ProtocolError(f"a package of type {kind}")
        except (struct.error, UnicodeDecodeError, IndexError) as error:
            raise ProtocolError(str(error)) from error

    def _set_outputs(self, body: bytes) -> None:
        rate = 125.0
        if self.version == 2:
            (rate,) = struct.unpack_from(">d", body)
            body = body[8:]
        names = _names(body)
        types = [FIELDS.get(name, (NOT_FOUND,))[0] for name in names]
        number = 0
        if NOT_FOUND not in types and names and 1.0 <= rate <= MOST_HZ and len(self.outputs) < MOST_RECIPES:
            number = len(self.outputs) + 1 if self.version == 2 else 1
            self.outputs[number] = recipe_of(names, types), rate
        self._reply(OUTPUTS, (bytes([number]) if self.version == 2 else b"") + ",".join(types).encode())

    def _set_inputs(self, body: bytes) -> None:
        names = _names(body)
        number = 0
        claimed = self.controller.claimed
        types = [
            IN_USE
            if claimed.get(name, self) is not self and name != "external_force_torque"
            else _input_type(name)
            for name in names
        ]
        if not {NOT_FOUND, IN_USE} & set(types) and names and len(self.inputs) < MOST_RECIPES:
            number = len(self.inputs) + 1
            self.inputs[number] = recipe_of(names, types)
            claimed.update(dict.fromkeys(names, self))
            self.controller.client_back()
        self._reply(INPUTS, bytes([number]) + ",".join(types).encode())

    def _take_data(self, body: bytes) -> None:
        number = body[0]
        data = body[1:]
        if number not in self.inputs:
            raise ProtocolError(f"data for recipe {number}, which there is not")
        names, form = self.inputs[number]
        if len(data) < (size := form.itemsize):
            self._warn(f"{len(data)} bytes for input recipe {number} of {size}: ignored")
            return
        values = dict(zip(names, np.frombuffer(data, form, 1)[0].item(), strict=True))
        self.controller.link.take(lambda: apply_inputs(self.controller, values))
        self.answered = True

    def packages(self) -> Iterator[bytes]:
        """The data due at this tick, once it is started."""
        if not self.started:
            return
        now = self.controller.robot.ticks
        for number, (recipe, rate) in self.outputs.items():
            if now + 1e-6 < self._due.get(number, -1.0):
                continue
            self._due[number] = max(self._due.get(number, -1.0), now - 1.0) + MOST_HZ / rate
            values = tuple(output_value(self.controller, name) for name in recipe.names)
            prefix = bytes([number]) if self.version == 2 else b""
            yield _package(DATA, prefix + np.array(values, recipe.data).tobytes())
            self.answered = False

    def close(self) -> None:
        """Say so and give back what was claimed."""
        self.controller.client_gone(self)
        claimed = self.controller.claimed
        for name in [name for name, owner in claimed.items() if owner is self]:
            del claimed[name]

    def _warn(self, text: str) -> None:
        """Say what was wrong, here and to the client."""
        self.controller.note(f"RTDE: {text}")
        said = [bytes([len(word)]) + word for word in (text.encode(), b"RTDE")]
        self._reply(TEXT, b"".join(said) + b"\2" if self.version == 2 else b"\2" + text.encode())

    def _reply(self, kind: int, body: bytes) -> None:
        self.send(_package(kind, body))


def _package(kind: int, body: bytes) -> bytes:
    return struct.pack(">HB", 3 + len(body), kind) + body


def _names(body: bytes) -> list[str]:
    """Names separated by commas; a comma at the end names nothing."""
    return [name for name in body.decode("ascii").strip("\0").split(",") if name]
