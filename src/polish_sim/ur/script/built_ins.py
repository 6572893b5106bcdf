"""What a programme may call: about a hundred functions of URScript, on a robot.

A generator is a function the programme waits in; each ``yield`` is one step of 2 ms.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from polish_sim.arrays import Array
from polish_sim.ur.script import values
from polish_sim.ur.script.sockets import STEP_S, Sockets, Waiting
from polish_sim.ur.script.values import List, Pose, array, as_list, as_pose, number, to_text

if TYPE_CHECKING:
    from polish_sim.ur.robot import Kind, Side, SimulatedRobot
    from polish_sim.ur.script.machine import Machine

STOP_A = 4.0  #: Deceleration of a move whose thread is killed [rad/s^2]
MOST_STEPS = 10**9
OPTIMAL_A, OPTIMAL_V = 5.0, 3.14  #: ``optimovej`` takes a share of these [rad/s^2, rad/s]
OPTIMAL_A_M, OPTIMAL_V_M = 2.5, 1.0  #: ``optimovel`` takes a share of these [m/s^2, m/s]
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


class BuiltIns(Sockets):
    """The functions by their names in URScript."""

    _machine: Machine

    def __init__(self, machine: Machine | None = None) -> None:
        super().__init__()
        if machine is not None:
            self._machine = machine
        self._waypoint = Pose((0.0,) * 6)
        self._flags: dict[int, bool] = {}

    def table(self) -> dict[str, Callable[..., Any]]:
        """All functions by name."""
        hidden = {"table", "close_all"}
        words = (
            word
            for part in (BuiltIns, Sockets)
            for word in vars(part)
            if word[0] != "_" and word not in hidden
        )
        found = {word: getattr(self, word) for word in words}
        maths = ("sin", "cos", "tan", "asin", "acos", "atan", "sqrt", "floor", "ceil", "exp")
        for name in maths:
            found[name] = _of_number(getattr(math, name))
        for name in (
            "pose_trans",
            "pose_inv",
            "pose_add",
            "pose_sub",
            "pose_dist",
            "point_dist",
            "interpolate_pose",
        ):
            found[name] = getattr(values, name)
        for name in ("wrench_trans", "norm", "rpy2rotvec", "rotvec2rpy"):
            found[name] = getattr(values, name)
        for group in ("standard", "configurable", "tool"):
            found |= self._pins(f"{group}_digital", bool)
        found |= {
            "get_digital_in": found["get_standard_digital_in"],
            "set_digital_out": found["set_standard_digital_out"],
        }
        for group in ("standard", "tool"):
            found |= self._pins(f"{group}_analog", number)
        for convert, state in ((as_list, LISTS), (as_pose, POSES)):
            found |= {name: self._reader(convert, of) for name, of in state.items()}
        return (
            found
            | self._registers("integer", "int")
            | self._registers("float", "double")
            | self._registers("boolean", "bool")
        )

    def _reader(self, convert: Callable[[Any], Any], of: str) -> Callable[[], Any]:
        return lambda: convert(getattr(self._robot, of))

    @property
    def _robot(self) -> SimulatedRobot:
        return self._machine.robot

    def _pins(self, group: str, kind: Callable[[Any], float | bool]) -> dict[str, Callable[..., Any]]:
        def reader(side: str) -> Callable[[Any], Any]:
            return lambda n: self._robot.input_output(f"{group}_{side}", int(n))

        def write(n: Any, b: Any) -> None:
            self._robot.input_output(f"{group}_out", int(n), kind(b))

        return {f"get_{group}_in": reader("in"), f"get_{group}_out": reader("out"), f"set_{group}_out": write}

    def _registers(self, word: str, kind: Kind) -> dict[str, Callable[..., Any]]:
        """Registers of RTDE, 0 to 47; bits to 127."""

        def reader(side: Side) -> Callable[[Any], Any]:
            return lambda address: self._robot.register(side, kind, int(address))

        def write(address: Any, value: Any) -> None:
            self._robot.set_register(kind, int(address), number(value))

        return {
            f"read_input_{word}_register": reader("in"),
            f"read_output_{word}_register": reader("out"),
            f"write_output_{word}_register": write,
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

    def get_steptime(self) -> float:
        """Time of a step [s]."""
        return STEP_S

    def textmsg(self, s1: Any, s2: Any = "") -> None:
        """Write to the log."""
        self._machine.listener.text(to_text(s1) + to_text(s2))

    def popup(
        self, s: Any, title: Any = "Popup", warning: Any = False, error: Any = False, blocking: Any = False
    ) -> Waiting:
        """Show a message; a blocking one holds the thread until it is closed."""
        self._machine.listener.popup(to_text(s), to_text(title), bool(warning), bool(error), bool(blocking))
        self._machine.popup_open = bool(blocking)
        while blocking and self._machine.popup_open:
            yield

    # Texts and lists.

    def str_cat(self, op1: Any, op2: Any) -> str:
        """Join two values as text."""
        text = to_text(op1) + to_text(op2)
        return to_text(text)

    def to_str(self, val: Any) -> str:
        """A value as text."""
        return to_text(val)

    def to_num(self, val: Any) -> float | int:
        """The number a text says."""
        return int(val) if str(val).strip().lstrip("+-").isdecimal() and len(val) < 10 else float(val)

    def str_len(self, str: Any) -> int:
        """Characters of a text."""
        return len(str)

    def get_list_length(self, list: Any) -> int:
        """Elements of a list."""
        return len(list)

    length = get_list_length

    def pow(self, base: Any, exponent: Any) -> float:
        """Power."""
        return math.pow(base, exponent)

    def log(self, b: Any, f: Any) -> float:
        """Logarithm of f to the base b."""
        return math.log(f, b)

    def atan2(self, y: Any, x: Any) -> float:
        """Angle of (x, y) [rad]."""
        return math.atan2(y, x)

    def d2r(self, d: Any) -> float:
        """Degrees to radians."""
        return math.radians(d)

    def r2d(self, r: Any) -> float:
        """Radians to degrees."""
        return math.degrees(r)

    def random(self) -> float:
        """A number from 0 to 1; the same series in each programme."""
        return self._machine.random.random()

    def rtde_set_watchdog(self, variable_name: Any, min_frequency: Any, action: Any = "pause") -> None:
        """Stop the programme when an RTDE input is written too rarely."""
        self._robot.set_watchdog(str(variable_name), number(min_frequency), str(action))

    def set_flag(self, n: Any, b: Any) -> None:
        """Set one of 32 flags."""
        self._flags[int(n) % 32] = bool(b)

    def get_flag(self, n: Any) -> bool:
        """Read one of 32 flags."""
        return self._flags.get(int(n) % 32, False)

    # Moves.

    def _until(self, done: Callable[[], bool] | None = None) -> Waiting:
        """Wait for a motion of the thread that has the robot; one that is killed stops it."""
        try:
            yield
            while not (done or self._robot.move_done)():
                yield
        except GeneratorExit:
            self._robot.stopj(STOP_A)
            raise
        finally:
            self._machine.mover = None

    def _for(self, steps: int) -> Waiting:
        left = iter(range(steps - 1))
        return self._until(lambda: next(left, None) is None)

    def _sped(self, t: Any, a: Any, change: float) -> Waiting:
        """Wait for a time [s], without one until a change of speed is made."""
        return self._for(_steps(t) if number(t) > 0.0 else _steps(change / max(number(a), 1e-3)) + 1)

    def _joints(self, target: Any) -> Array:
        if not isinstance(target, Pose):
            return array(target)
        return self._solved(array(target), self._robot.target_q, self._robot.tcp_offset)

    def _pose(self, target: Any) -> Array:
        if isinstance(target, Pose):
            goal = array(target)
        else:
            goal = self._robot.forward_kin(array(target), self._robot.tcp_offset)
        self._waypoint = as_pose(goal)
        return goal

    def _solved(self, pose: Array, near: Array, tcp: Array) -> Array:
        q = self._robot.inverse_kin(pose, near, tcp)
        if q is None:
            raise ValueError(f"no inverse kinematics for {to_text(as_pose(pose))}")
        return q

    def movej(self, q: Any, a: Any = 1.4, v: Any = 1.05, t: Any = 0, r: Any = 0) -> Waiting:
        """Move in joint space."""
        self._machine.take_robot()
        goal = self._joints(q)
        self._waypoint = as_pose(self._robot.forward_kin(goal, self._robot.tcp_offset))
        self._robot.movej(goal, *map(number, (a, v, t, r)))
        yield from self._until()

    def movel(self, pose: Any, a: Any = 1.2, v: Any = 0.25, t: Any = 0, r: Any = 0) -> Waiting:
        """Move in a line."""
        self._machine.take_robot()
        self._robot.movel(self._pose(pose), *map(number, (a, v, t, r)))
        yield from self._until()

    def movep(self, pose: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0) -> Waiting:
        """Move in a line as ``movel``."""
        yield from self.movel(pose, a, v, 0, r)

    def movec(
        self, pose_via: Any, pose_to: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0, mode: Any = 0
    ) -> Waiting:
        """Move on a circle."""
        self._machine.take_robot()
        via = self._pose(pose_via)
        self._robot.movec(via, self._pose(pose_to), number(a), number(v), number(r), int(mode))
        yield from self._until()

    def optimovej(self, q: Any, a: Any = 0.3, v: Any = 0.3, r: Any = 0) -> Waiting:
        """``movej`` at shares of the largest speed and acceleration."""
        yield from self.movej(q, OPTIMAL_A * number(a), OPTIMAL_V * number(v), 0, r)

    def optimovel(self, pose: Any, a: Any = 0.3, v: Any = 0.3, r: Any = 0) -> Waiting:
        """``movel`` at shares of the largest speed and acceleration."""
        yield from self.movel(pose, OPTIMAL_A_M * number(a), OPTIMAL_V_M * number(v), 0, r)

    def servoj(
        self, q: Any, a: Any = 0, v: Any = 0, t: Any = 0.002, lookahead_time: Any = 0.1, gain: Any = 300
    ) -> Waiting:
        """Track joint angles for ``t``; ``a`` and ``v`` have no effect, as on a robot."""
        self._machine.take_robot()
        self._robot.servoj(self._joints(q), *map(number, (t, lookahead_time, gain)))
        yield from self._for(max(_steps(t), 1))

    def servoc(self, pose: Any, a: Any = 1.2, v: Any = 0.25, r: Any = 0) -> Waiting:
        """Move to a pose in a line as ``movel``."""
        yield from self.movel(pose, a, v, 0, r)

    def speedj(self, qd: Any, a: Any = 1.4, t: Any = 0) -> Waiting:
        """Go to joint speeds; returns after ``t``, without it when the speed is reached."""
        self._machine.take_robot()
        goal = array(qd)
        change = float(np.abs(goal - self._robot.target_qd).max())
        self._robot.speedj(goal, number(a))
        yield from self._sped(t, a, change)

    def speedl(self, xd: Any, a: Any = 1.2, t: Any = 0, aRot: Any = None) -> Waiting:
        """Go to a TCP twist; returns after ``t``, without it when the speed is reached."""
        self._machine.take_robot()
        goal = array(xd)
        change = float(np.linalg.norm((goal - self._robot.target_tcp_speed)[:3]))
        self._robot.speedl(goal, number(a), None if aRot is None else number(aRot))
        yield from self._sped(t, a, change)

    def stopj(self, a: Any = 2.0) -> Waiting:
        """Stop the joints."""
        self._machine.take_robot()
        self._robot.stopj(number(a))
        yield from self._until()

    def stopl(self, a: Any = 1.2, aRot: Any = None) -> Waiting:
        """Stop on the line."""
        self._machine.take_robot()
        self._robot.stopl(number(a), None if aRot is None else number(aRot))
        yield from self._until()

    def direct_torque(
        self, tau: Any, friction_comp: Any = True, viscous_scale: Any = None, coulomb_scale: Any = None
    ) -> Waiting:
        """Joint torques for one step."""
        self._machine.take_robot()
        scales = (None if scale is None else array(scale) for scale in (viscous_scale, coulomb_scale))
        self._robot.direct_torque(array(tau), bool(friction_comp), *scales)
        yield from self._for(1)

    # Force.

    def force_mode(self, task_frame: Any, selection_vector: Any, wrench: Any, type: Any, limits: Any) -> None:
        """Comply along chosen axes."""
        lists = array(task_frame), array(selection_vector), array(wrench)
        self._robot.force_mode(*lists, int(type), array(limits))

    def force_mode_set_damping(self, damping: Any) -> None:
        """Damping 0 to 1."""
        self._robot.force_mode_set_damping(number(damping))

    def force_mode_set_gain_scaling(self, scaling: Any) -> None:
        """Gain 0 to 2."""
        self._robot.force_mode_set_gain_scaling(number(scaling))

    def end_force_mode(self) -> None:
        """Leave force mode."""
        self._robot.end_force_mode()

    def freedrive_mode(self, freeAxes: Any = None, feature: Any = None) -> None:
        """Let the arm be led by hand."""
        axes = np.ones(6) if freeAxes is None else array(freeAxes)
        self._robot.freedrive(axes, np.zeros(6) if feature is None else array(feature))

    def teach_mode(self) -> None:
        """``freedrive_mode`` with all axes."""
        self.freedrive_mode()

    end_freedrive_mode = end_teach_mode = end_force_mode

    def get_freedrive_status(self) -> int:
        """Nearness of a singularity, 0 to 2."""
        return self._robot.freedrive_status()

    def zero_ftsensor(self) -> None:
        """Make the present wrench the zero."""
        self._robot.zero_ftsensor()

    def ft_rtde_input_enable(
        self, enable: Any, sensor_mass: Any = 0, sensor_measuring_offset: Any = None, sensor_cog: Any = None
    ) -> None:
        """Take the wrench from RTDE."""
        places = (np.zeros(3) if at is None else array(at, 3) for at in (sensor_measuring_offset, sensor_cog))
        self._robot.ft_input(bool(enable), number(sensor_mass), *places)

    enable_external_ft_sensor = ft_rtde_input_enable

    def force(self) -> float:
        """Size of the force [N]."""
        return float(np.linalg.norm(self._robot.tcp_force[:3]))

    def tool_contact(self, direction: Any = None) -> int:
        """Steps since a contact began, from any direction where none is given; 0 without one."""
        return int(self._robot.tool_contact(np.zeros(3) if direction is None else array(direction)))

    # Tool and safety.

    def set_tcp(self, pose: Any, tcp_name: Any = "") -> None:
        """Set the TCP."""
        self._robot.set_tcp(array(pose))

    def set_payload(self, m: Any, cog: Any = None) -> None:
        """Set the payload."""
        self._robot.set_payload(number(m), None if cog is None else array(cog, 3), None, 0.0)

    def set_target_payload(self, m: Any, cog: Any, inertia: Any = None, transition_time: Any = 0) -> None:
        """Set the payload with its inertia."""
        moments = None if inertia is None else array(inertia)
        self._robot.set_payload(number(m), array(cog, 3), moments, number(transition_time))

    def set_gravity(self, d: Any) -> None:
        """Set gravity [m/s^2]."""
        self._robot.set_gravity(array(d, 3))

    def protective_stop(self) -> None:
        """Stop as a safety function would."""
        self._robot.protective_stop()

    def powerdown(self) -> None:
        """Switch off."""
        self._robot.power_down()

    def is_steady(self) -> bool:
        """Whether the arm stands."""
        return self._robot.steady()

    def is_within_safety_limits(self, pose: Any) -> bool:
        """Whether a pose or joint angles can be reached."""
        return self._robot.within_safety_limits(array(pose), isinstance(pose, Pose))

    # State.

    def get_actual_joint_positions_history(self, steps: Any = 0) -> List:
        """Some steps ago [rad]."""
        return as_list(self._robot.q_history(int(steps)))

    def get_target_waypoint(self) -> Pose:
        """Target of the present move."""
        return self._waypoint

    def get_actual_tool_flange_pose(self) -> Pose:
        """Pose of the flange."""
        return as_pose(self._robot.forward_kin(self._robot.actual_q, np.zeros(6)))

    def get_target_payload(self) -> float:
        """[kg]."""
        return float(self._robot.payload_mass)

    # Kinematics and dynamics.

    def _tcp(self, tcp: Any) -> Array:
        return self._robot.tcp_offset if tcp is None or tcp == "active_tcp" else array(tcp)

    def _at(self, q: Any) -> Array:
        return self._robot.actual_q if q is None else array(q)

    def get_forward_kin(self, q: Any = None, tcp: Any = None) -> Pose:
        """Pose of the TCP."""
        return as_pose(self._robot.forward_kin(self._at(q), self._tcp(tcp)))

    def get_inverse_kin(
        self,
        x: Any,
        qnear: Any = None,
        maxPositionError: Any = 1e-10,
        maxOrientationError: Any = 1e-10,
        tcp: Any = None,
    ) -> List:
        """Joint angles nearest to ``qnear``; the solution is exact, whatever the errors allowed."""
        return as_list(self._solved(array(x), self._at(qnear), self._tcp(tcp)))

    def get_inverse_kin_has_solution(
        self,
        pose: Any,
        qnear: Any = None,
        maxPositionError: Any = 1e-10,
        maxOrientationError: Any = 1e-10,
        tcp: Any = None,
    ) -> bool:
        """Whether there are joint angles for a pose."""
        return self._robot.inverse_kin(array(pose), self._at(qnear), self._tcp(tcp)) is not None

    def get_jacobian(self, pos: Any = None, tcp: Any = None) -> List:
        """6 x 6, linear rows first."""
        return as_list(self._robot.jacobian(self._at(pos), self._tcp(tcp)))

    def get_jacobian_time_derivative(self, pos: Any = None, vel: Any = None, tcp: Any = None) -> List:
        """6 x 6 [1/s]."""
        speeds = self._robot.actual_qd if vel is None else array(vel)
        return as_list(self._robot.jacobian_dot(self._at(pos), speeds, self._tcp(tcp)))

    def get_mass_matrix(self, pos: Any = None, include_rotors_inertia: Any = False) -> List:
        """6 x 6 [kg m^2]."""
        return as_list(self._robot.mass_matrix(self._at(pos), bool(include_rotors_inertia)))

    def get_coriolis_and_centrifugal_torques(self, pos: Any = None, vel: Any = None) -> List:
        """[N m]."""
        speeds = self._robot.actual_qd if vel is None else array(vel)
        return as_list(self._robot.coriolis(self._at(pos), speeds))


def _of_number(of: Callable[[float], float]) -> Callable[[Any], float]:
    return lambda f: of(number(f))


def _steps(t: Any) -> int:
    """Steps in a time [s]."""
    return min(max(math.ceil(number(t) / STEP_S - 1e-6), 0), MOST_STEPS)
