"""What a programme may call: about a hundred functions of URScript, on a robot.

A generator is a function the programme waits in; each ``yield`` is one step of 2 ms.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from random import Random
from typing import Any

import numpy as np

from polish_sim.arrays import Array
from polish_sim.ur.kinematics import TICK_S
from polish_sim.ur.robot import SimulatedRobot
from polish_sim.ur.script import values
from polish_sim.ur.script.sockets import Sockets, Waiting
from polish_sim.ur.script.values import Pose, array, as_list, as_pose, number, to_text

STOP_A = 4.0  #: Deceleration of a move whose thread is killed [rad/s^2]
MOST_STEPS = 10**9
#: What a programme reads, by the robot's names: angles [rad], speeds [rad/s], [m/s], wrenches [N, N m], [m]
LISTS = {
    "get_actual_joint_positions": "actual_q",
    "get_joint_positions": "actual_q",
    "get_actual_joint_speeds": "actual_qd",
    "get_target_joint_positions": "target_q",
    "get_target_joint_speeds": "target_qd",
    "get_target_joint_accelerations": "target_qdd",
    "get_joint_torques": "free_torques",
    "get_actual_tcp_speed": "actual_tcp_speed",
    "get_target_tcp_speed": "target_tcp_speed",
    "get_tcp_force": "tcp_force",
    "get_target_payload_cog": "payload_cog",
    "get_target_payload_inertia": "payload_inertia",
}
POSES = {
    "get_actual_tcp_pose": "actual_tcp_pose",
    "get_target_tcp_pose": "target_tcp_pose",
    "get_tcp_offset": "tcp_offset",
}


def as_it_is(answer: Any) -> Any:
    """An answer as it is."""
    return answer


def solution(q: Array | None) -> Array:
    """Joint angles; ValueError where there are none."""
    if q is None:
        raise ValueError("no inverse kinematics for this pose")
    return q


ASKED: Mapping[Callable[[Any], Any], Mapping[str, str]] = {
    as_it_is: {
        **dict.fromkeys(("end_force_mode", "end_freedrive_mode", "end_teach_mode"), "end_force_mode"),
        **dict.fromkeys(("ft_rtde_input_enable", "enable_external_ft_sensor"), "ft_input"),
        **dict.fromkeys(("set_payload", "set_target_payload"), "set_payload"),
        **dict.fromkeys(("freedrive_mode", "teach_mode"), "freedrive"),
        "get_freedrive_status": "freedrive_status",
        "zero_ftsensor": "zero_ftsensor",
        "protective_stop": "protective_stop",
        "powerdown": "power_down",
        "is_steady": "steady",
        "rtde_set_watchdog": "set_watchdog",
        "force_mode": "force_mode",
        "force_mode_set_damping": "force_mode_set_damping",
        "force_mode_set_gain_scaling": "force_mode_set_gain_scaling",
        "tool_contact": "tool_contact",
        "set_tcp": "set_tcp",
        "set_gravity": "set_gravity",
    },
    as_pose: {"get_forward_kin": "forward_kin"},
    lambda q: q is not None: {"get_inverse_kin_has_solution": "inverse_kin"},
    lambda q: as_list(solution(q)): {"get_inverse_kin": "inverse_kin"},
    as_list: {
        "get_actual_joint_positions_history": "q_history",
        "get_jacobian": "jacobian",
        "get_jacobian_time_derivative": "jacobian_dot",
        "get_mass_matrix": "mass_matrix",
        "get_coriolis_and_centrifugal_torques": "coriolis",
    },
}
"""What a programme asks the robot's methods, by what is made of the answer."""
MOVES = (
    *("movej", "movel", "movep", "movec", "optimovej", "optimovel"),
    *("servoj", "speedj", "speedl", "stopj", "stopl", "direct_torque"),
)
"""And what it waits for."""
KINDS: Mapping[str, Callable[[Any], Any]] = {
    "Array": lambda value: None if value == "active_tcp" else array(value),
    "Array3": lambda value: array(value, 3),
    "float": number,
    "int": lambda value: int(number(value)),
    "bool": lambda value: bool(number(value)),
    "str": str,
}
"""What is made of a programme's value for a parameter of a type."""
USUAL = {"q": "actual_q", "pos": "actual_q", "qnear": "actual_q", "vel": "actual_qd", "tcp": "tcp_offset"}
"""What of the robot a parameter is that is not given."""
REGISTERS = {"integer": "int", "float": "double", "boolean": "bit"}
"""Kinds of registers, by their words in URScript."""
PLAIN: Mapping[str, Callable[..., Any]] = {
    "get_steptime": lambda: TICK_S,
    "str_cat": lambda op1, op2: to_text(to_text(op1) + to_text(op2)),
    "to_str": lambda val: to_text(val),
    **dict.fromkeys(("str_len", "get_list_length", "length"), len),
    "log": lambda b, f: math.log(f, b),
    "d2r": math.radians,
    "r2d": math.degrees,
    **{
        name: getattr(of, name)
        for of, names in {
            math: "sin cos tan asin acos atan atan2 sqrt floor ceil exp pow",
            values: "pose_trans pose_inv pose_add pose_sub pose_dist point_dist interpolate_pose "
            "wrench_trans norm rpy2rotvec rotvec2rpy",
        }.items()
        for name in names.split()
    },
}
"""What needs no robot, with its parameters as a programme names them."""


class BuiltIns(Sockets):
    """The functions by their names in URScript; without robot and listener they can be named, not called."""

    robot: SimulatedRobot
    listener: Any  #: The controller, which shows what a programme says

    def __init__(self) -> None:
        super().__init__()
        self.popup_open = False
        self.random = Random(0)
        self.mover: Any = None  #: The thread that moves the robot now
        self._current: Any = None  #: And the one that runs
        self._waypoint = Pose((0.0,) * 6)
        self._flags: dict[int, bool] = {}
        self._kinds = {**KINDS, "Angles": self._joints, "Joints": self._goal, "Place": self._pose}

    def table(self) -> dict[str, Callable[..., Any]]:
        """All functions by name."""
        hidden = {"table", "close_all"}
        words = {*vars(BuiltIns), *vars(Sockets)} - hidden
        found = {word: getattr(self, word) for word in words if word[0] != "_"}
        found |= {**PLAIN, **self._passed_on()}
        for group in ("standard_digital", "configurable_digital", "tool_digital", "standard_analog"):
            found |= self._pins(group)
        found["get_digital_in"] = found["get_standard_digital_in"]
        found["set_digital_out"] = found["set_standard_digital_out"]
        for convert, state in ((as_list, LISTS), (as_pose, POSES)):
            found |= {name: self._reader(convert, of) for name, of in state.items()}
        found |= {name: self._moves(name) for name in MOVES}
        found["servoc"] = found["movep"]
        for made, methods in ASKED.items():
            found |= {name: self._asked(made, of) for name, of in methods.items()}
        for word, kind in REGISTERS.items():
            found |= self._registers(word, kind)
        return found

    def _passed_on(self) -> dict[str, Callable[..., Any]]:
        """What only asks or sets something, with its parameters as a programme names them."""
        return {
            "textmsg": lambda s1, s2="": self.listener.text(to_text(s1) + to_text(s2)),
            "random": lambda: self.random.random(),
            "set_flag": lambda n, b: self._flags.update({int(n) % 32: bool(b)}),
            "get_flag": lambda n: self._flags.get(int(n) % 32, False),
            "force": lambda: float(np.linalg.norm(self.robot.tcp_force[:3])),
            "is_within_safety_limits": lambda pose: self.robot.within_safety_limits(
                array(pose), isinstance(pose, Pose)
            ),
            "get_tool_analog_in": lambda n: self.robot.read("tool_analog_in", _index(n)),
            "get_target_waypoint": lambda: self._waypoint,
            "get_actual_tool_flange_pose": lambda: as_pose(
                self.robot.forward_kin(self.robot.actual_q, np.zeros(6))
            ),
            "get_target_payload": lambda: float(self.robot.payload_mass),
        }

    def _reader(self, convert: Callable[[Any], Any], of: str) -> Callable[[], Any]:
        return lambda: convert(getattr(self.robot, of))

    def _asked(self, convert: Callable[[Any], Any], method: str) -> Callable[..., Any]:
        """A method of the robot, with values of a programme made what its parameters are."""
        _, *parameters = inspect.signature(getattr(SimulatedRobot, method)).parameters.values()
        usual = {p.name for p in parameters if p.name in USUAL and p.annotation == "Array"}
        signature = inspect.Signature([p.replace(default=None) if p.name in usual else p for p in parameters])

        def asked(*placed: Any, **named: Any) -> Any:
            given = signature.bind(*placed, **named).arguments
            values = {
                name: self._kinds[signature.parameters[name].annotation.split()[0]](value)
                for name, value in given.items()
            }
            for name in usual:
                if values.get(name) is None:
                    values[name] = getattr(self.robot, USUAL[name])
            return convert(getattr(self.robot, method)(**values))

        asked.__signature__ = signature  # type: ignore[attr-defined]
        return asked

    def _pins(self, group: str) -> dict[str, Callable[..., Any]]:
        return {
            f"get_{group}_in": lambda n: self.robot.read(f"{group}_in", _index(n)),
            f"get_{group}_out": lambda n: self.robot.read(f"{group}_out", _index(n)),
            f"set_{group}_out": lambda n, b: self.robot.write(f"{group}_out", _index(n), number(b)),
        }

    def _registers(self, word: str, kind: str) -> dict[str, Callable[..., Any]]:
        """Registers of RTDE, 0 to 47; bits to 127."""
        taken, given = f"input_{kind}_register", f"output_{kind}_register"
        return {
            f"read_input_{word}_register": lambda address: self.robot.read(taken, _index(address)),
            f"read_output_{word}_register": lambda address: self.robot.read(given, _index(address)),
            f"write_output_{word}_register": lambda address, value: self.robot.write(
                given, _index(address), number(value)
            ),
        }

    def set_tool_voltage(self, voltage: Any) -> None:
        """Accepted: there is nothing at the tool's connector."""
        if number(voltage) not in (0.0, 12.0, 24.0):
            raise ValueError("0, 12 or 24 V")

    # Time and talk.

    def sync(self) -> Waiting:
        """Give the rest of the step away."""
        yield

    def sleep(self, t: Any) -> Waiting:
        """Wait [s]."""
        for _ in range(_steps(t)):
            yield

    def popup(
        self, s: Any, title: Any = "Popup", warning: Any = False, error: Any = False, blocking: Any = False
    ) -> Waiting:
        """Show a message; a blocking one holds the thread until it is closed."""
        self.listener.popup(to_text(s), to_text(title), bool(warning), bool(error), bool(blocking))
        self.popup_open = bool(blocking)
        while blocking and self.popup_open:
            yield

    def to_num(self, val: Any) -> float | int:
        """The number a text says."""
        return int(val) if str(val).strip().lstrip("+-").isdecimal() and len(val) < 10 else float(val)

    # Moves.

    def _taken(self) -> SimulatedRobot:
        """The robot, for the thread that moves it from now on; another that moves it is refused."""
        if self.mover is not None and self.mover is not self._current:
            raise ValueError("another thread is already moving the robot")
        self.mover = self._current
        return self.robot

    def _until(self, done: Callable[[], bool] | None = None) -> Waiting:
        """Wait for a motion of the thread that has the robot; one that is killed stops it."""
        try:
            yield
            while not (done or self.robot.move_done)():
                yield
        except GeneratorExit:
            self.robot.stopj(STOP_A)
            raise
        finally:
            self.mover = None

    def _for(self, steps: int) -> Waiting:
        left = iter(range(steps - 1))
        return self._until(lambda: next(left, None) is None)

    def _moves(self, method: str) -> Callable[..., Waiting]:
        """A motion of the robot, waited for, or held for a time [s] if it says one."""
        asked = self._asked(as_it_is, method)

        def moves(*placed: Any, **named: Any) -> Waiting:
            self._taken()
            t = asked(*placed, **named)
            yield from self._until() if t is None else self._for(max(_steps(t), 1))

        moves.__signature__ = inspect.signature(asked)  # type: ignore[attr-defined]
        return moves

    def _joints(self, target: Any) -> Array:
        if not isinstance(target, Pose):
            return array(target)
        return solution(self.robot.inverse_kin(array(target), self.robot.target_q, tcp=self.robot.tcp_offset))

    def _goal(self, target: Any) -> Array:
        """Joint angles of a way point."""
        goal = self._joints(target)
        self._waypoint = as_pose(self.robot.forward_kin(goal, self.robot.tcp_offset))
        return goal

    def _pose(self, target: Any) -> Array:
        if isinstance(target, Pose):
            goal = array(target)
        else:
            goal = self.robot.forward_kin(array(target), self.robot.tcp_offset)
        self._waypoint = as_pose(goal)
        return goal


def _index(n: Any) -> int:
    """The number of a register or pin."""
    if n < 0:
        raise IndexError
    return int(n)


def _steps(t: Any) -> int:
    """Steps in a time [s]."""
    return min(max(math.ceil(number(t) / TICK_S - 1e-6), 0), MOST_STEPS)
