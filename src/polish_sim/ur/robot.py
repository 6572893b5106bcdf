"""The simulated controller's robot: modes, motions, force mode, safety, registers and payload on the cell's
physics."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain
from typing import Any

import mujoco
import numpy as np

from polish_sim.arrays import Array, crosses, norms, unit
from polish_sim.cell import Cell, tool_on_flange
from polish_sim.cell.real_arm import joint_inertia
from polish_sim.cell.scene import on_flange
from polish_sim.errors import ReachError
from polish_sim.motion import inverse_near, jacobian
from polish_sim.motion.kinematics import beyond_range
from polish_sim.spatial import GRAVITY, from_pose, inverse, place_of
from polish_sim.ur.kinematics import joint_speeds, pose_of, tool_at
from polish_sim.ur.motion import (
    FIXED,
    Compliance,
    Drive,
    JointSpeeds,
    JointWay,
    Moves,
    Servo,
    ToolSpeed,
    ToolWay,
    Way,
)
from polish_sim.ur.physics import TICK_S, Rig

CLOCK_S = 42.0  #: At the start; clients take less for a robot that boots
POWER_OFF, IDLE, RUNNING = 3, 5, 7  #: Robot modes
NORMAL, PROTECTIVE = 1, 3  #: Safety modes
STOPPED, PLAYING, PAUSED = 1, 2, 4  #: Runtime states
OPTIMAL_A, OPTIMAL_V = 5.0, 3.14  #: ``optimovej`` takes a share of these [rad/s^2, rad/s]
OPTIMAL_A_M, OPTIMAL_V_M = 2.5, 1.0  #: ``optimovel`` takes a share of these [m/s^2, m/s]
JOINT_SPEED = 1.05 * np.pi  #: Of a set-point, above which the arm stops itself [rad/s]
SETTLED = 0.01  #: Speed below which a joint counts as at rest [rad/s]
STOP_A = 20.0  #: Deceleration of the joints in a protective stop [rad/s^2]
HISTORY = 1000  #: Ticks of joint angles and forces that are kept
CLEAR = 10  #: Ticks in which all points of the links are looked at, and more
TARE = 100  #: Readings that make the sensor's zero
CONTACT_N = 8.0  #: Change of the force that counts as contact [N]
TOUCH_N = 2.0  #: Change with which it began [N]
FEED_HZ = 10.0  #: Least rate of the readings of a client's sensor
PINS = {"standard": 8, "configurable": 8, "tool": 2}
"""How many digital inputs and outputs there are."""


def bits_of(values: Sequence[bool]) -> int:
    """Truth values as the bits of a number, the first the lowest."""
    return sum(value << k for k, value in enumerate(values))


Array3 = Array  #: Of three numbers, where others are of six
Angles = Array  #: Of joints, which a programme may give as a pose
Joints = Array  #: The same of a way point
Place = Array  #: Its pose, which may be given as joints
ORIGIN, ALL_AXES = np.zeros(6), np.ones(6)


class SimulatedRobot:
    """An arm with its tool in a cell, as programmes and ports see it: what a programme asks of it has its
    parameters here by their names in URScript.

    Everything is SI, in the base frame: a pose is (x, y, z, rx, ry, rz), metres and rotation vector, of the
    TCP; ``tcp_force`` is the force on the tool [N] and the torque about the TCP [N m]. A motion only starts
    one; ``move_done`` says when the script continues. `Machine.tick` calls these once in 2 ms, before the
    physics of that step.
    """

    def __init__(self, cell: Cell) -> None:
        self.rig = Rig(cell)
        self.cell = cell
        baselines = cell.scenario.controller.baselines
        self.ticks = 0
        self.mode = RUNNING
        self.safety = NORMAL
        self.runtime = STOPPED
        self.speed_fraction = 1.0
        self.stop_reason = ""  #: Of the last protective stop
        q = np.array(cell._start.q)
        self.target_q = q.copy()
        self._reference = q.copy()
        self.target_qd = np.zeros(6)
        self.target_qdd = np.zeros(6)
        self._reference_qd = np.zeros(6)
        self.tcp_offset = pose_of(tool_on_flange())
        self._tcp = from_pose(self.tcp_offset)
        payload = cell.state.payload
        self._sensor_on_flange = on_flange(cell.data, "sensor")
        self.payload_mass = float(payload.mass)
        self.payload_cog = place_of(self._sensor_on_flange, payload.center)
        self._own_payload = self.payload_mass, self.payload_cog
        self.payload_inertia = np.zeros(6)
        self._drive: Drive | None = None
        self._delay = round(cell.scenario.robot.command_latency_s / TICK_S)
        self._coming: deque[tuple[int, Callable[[], None]]] = deque()  #: Streamed goals, and when they act
        self.compliance: Compliance | None = None
        self._mode_settings = Compliance(
            baselines.mode_mass_kg, baselines.mode_damping, baselines.mode_gain_scaling
        )
        #: Registers of RTDE, inputs and outputs, by their names in RTDE and URScript
        self.signals: dict[str, list[Any]] = {
            **{
                f"{side}put_{kind}_register": [none] * count
                for side in ("in", "out")
                for kind, none, count in (("int", 0, 48), ("double", 0.0, 48), ("bit", False, 128))
            },
            **{f"{group}_digital_{side}": [False] * PINS[group] for group in PINS for side in ("in", "out")},
            **{f"{group}_analog_in": [0.0, 0.0] for group in ("standard", "tool")},
            "standard_analog_out": [0.004, 0.004],
        }
        self.inputs_read: set[str] = set()  #: Names of registers a programme has read
        self.written = dict[str, int]()  #: Tick in which a client last wrote an input, by its name
        #: Input, ticks it may stay unwritten, and what then happens
        self.watchdog: tuple[str, int, str] | None = None
        self.analog_domain = [0, 0]
        self.external: Array = np.zeros(6)
        self._external_on = False
        self._torque_left = 0
        self._unlocked_at = -1
        self._data = mujoco.MjData(cell.model)
        # Views of what changes in every tick: to look up a record's field takes long.
        self._order = {
            name: getattr(self.rig.order, name)
            for name in ("begin", "end", "speed", "read", "read_speed", "felt")
        }
        state = cell.state
        self._seen = state.measurement.rotation, state.measurement.wrench, state.measurement.position
        self._asked = state.target.position, state.target.rotation, state.speedl.twist
        self._reading = state.sensor.reading
        self._past: deque[tuple[Array, Array]] = deque(maxlen=HISTORY)
        self._wrenches: deque[Array] = deque(maxlen=TARE)
        self._see()

    # The tick.

    def step(self) -> None:
        """Move the set-points on by a tick and run the physics of it."""
        before = self.target_q
        order = self._order
        try:
            self._move_on()
        except (ValueError, ReachError) as error:
            self.protective_stop(str(error))
        qd = (self.target_q - before) / TICK_S
        if np.abs(qd).max() > JOINT_SPEED and self.safety == NORMAL:
            # It is not followed: the arm brakes from the speed it had.
            qd = self.target_qd
            self.target_q = before + TICK_S * qd
            self.protective_stop("a joint's set-point is too fast: near a singularity, or a jump of servoj")
        self.target_qdd = (qd - self.target_qd) / TICK_S
        self.target_qd = qd
        by_torque = self._torque_left > 0
        self.rig.order.by_torque = by_torque
        if by_torque:
            self._torque_left -= 1
            self.target_q = self._reference = self.actual_q.copy()
        order["begin"][:] = before
        order["end"][:] = self.target_q
        order["speed"][:] = qd
        place, turn, twist = self._asked
        place[:] = self._target_T[:3, 3]
        turn[:] = self._target_T[:3, :3]
        twist[:] = self.target_tcp_speed
        reason = self.rig.run()
        self.ticks += 1
        self._see()
        backs_off = self._unlocked_at >= 0
        if reason and backs_off:
            self._unlocked_at = self.ticks
            self.rig.unlock()
        elif reason:
            self.protective_stop(reason)
        elif backs_off and self.ticks > self._unlocked_at + CLEAR and not self.rig.near_limit():
            self._unlocked_at = -1
            self.rig.watch(True)

    def _move_on(self) -> None:
        """The next set-points."""
        before = self._reference
        speeds = self._reference_qd
        while self._coming and self._coming[0][0] <= self.ticks:
            self._coming.popleft()[1]()
        drive = self._drive
        dt = TICK_S * self.speed_fraction if isinstance(drive, Moves) else TICK_S
        after = before if drive is None else drive.advance(before, speeds, dt)
        if beyond_range(after).any():
            raise ValueError("a joint's set-point is at the end of its range")
        self._reference = after
        self._reference_qd = (after - before) / TICK_S
        if self.compliance is None:
            self.target_q = after.copy()
            return
        moved = tool_at(before, self._tcp)[1] @ self._reference_qd
        pose = self._target_T
        J = self._target_J
        wanted = pose if drive is None else tool_at(after, self._tcp)[0]
        twist = self.compliance.twist(pose, moved, wanted, self.tcp_force, TICK_S)
        self.target_q = self.target_q + TICK_S * joint_speeds(J, twist)
        if drive is None:
            self._reference = self.target_q.copy()

    def _see(self) -> None:
        """Read joints and sensor, and what follows from them."""
        order = self._order
        if self.ticks == 0:
            order["read"][:] = self.target_q
            self.tcp_force = np.zeros(6)
        self.actual_q, self.actual_qd = order["read"].copy(), order["read_speed"].copy()
        self.joint_torques = order["felt"].copy()
        T, J = tool_at(self.actual_q, self._tcp)
        self._target_T, self._target_J = tool_at(self.target_q, self._tcp)
        self.actual_tcp_pose, self.target_tcp_pose = pose_of(T), pose_of(self._target_T)
        self.actual_tcp_speed, self.target_tcp_speed = J @ self.actual_qd, self._target_J @ self.target_qd
        self.time_s = CLOCK_S + self.ticks * TICK_S
        if self._external_on:
            self.tcp_force = self.external.copy()
        elif self.ticks:
            R, wrench, p = self._seen
            self.tcp_force = np.concatenate([-R @ wrench[:3], -R @ wrench[3:]])
            self._wrenches.append(wrench.copy())
            self.tcp_force[3:] += crosses(p - T[:3, 3], self.tcp_force[:3])
        self._past.append((self.actual_q, self.tcp_force))

    @property
    def raw_wrench(self) -> Array:
        """What the sensor reads, as a wrench on the tool: sensor axes, nothing taken off."""
        return -self._reading

    # Motions.

    def _begin(self, drive: Drive) -> None:
        self._drive = drive
        self._torque_left = 0
        self._reference = self.target_q.copy()
        self._reference_qd = self.target_qd.copy() if self.compliance is None else np.zeros(6)

    def _move(self, make: Callable[[Array], Way], a: float, v: float, t: float, r: float) -> None:
        drive = self._drive
        if not (isinstance(drive, Moves) and drive.under_way):
            drive = Moves()
            self._begin(drive)
            start = self._reference
        else:
            start = drive.end
        if min(a, v) <= 0.0 or not np.isfinite([a, v, t, r]).all():
            raise ValueError(f"acceleration {a:g} and speed {v:g} of a move must be above 0")
        try:
            drive.begin(make(start), a, v, t, r)
        except ReachError as error:
            self.protective_stop(str(error))

    def _pose_at(self, q: Array) -> Array:
        return tool_at(q, self._tcp)[0]

    def movej(self, q: Joints, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0) -> None:
        """Move in joint space. ``t`` > 0 replaces speed and acceleration; ``r``: blend radius [m]."""

        def way(start: Array) -> Way:
            apart = self._pose_at(q)[:3, 3] - self._pose_at(start)[:3, 3]
            return JointWay(start, q, float(np.linalg.norm(apart)))

        self._move(way, a, v, t, r)

    def movel(self, pose: Place, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0) -> None:
        """Move the TCP in a straight line."""
        self._move(lambda start: ToolWay(start, self._tcp, pose), a, v, t, r)

    def movep(self, pose: Place, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> None:
        """Move in a line as ``movel``."""
        self.movel(pose, a, v, 0.0, r)

    def movec(
        self, pose_via: Place, pose_to: Place, a: float = 1.2, v: float = 0.25, r: float = 0.0, mode: int = 0
    ) -> None:
        """Move the TCP on a circle. ``mode`` 0: orientation as given, 1: fixed to the arc."""
        self._move(lambda start: ToolWay(start, self._tcp, pose_to, pose_via, mode == 1), a, v, 0.0, r)

    def optimovej(self, q: Joints, a: float = 0.3, v: float = 0.3, r: float = 0.0) -> None:
        """``movej`` at shares of the largest speed and acceleration."""
        self.movej(q, OPTIMAL_A * a, OPTIMAL_V * v, 0.0, r)

    def optimovel(self, pose: Place, a: float = 0.3, v: float = 0.3, r: float = 0.0) -> None:
        """``movel`` at shares of the largest speed and acceleration."""
        self.movel(pose, OPTIMAL_A_M * a, OPTIMAL_V_M * v, 0.0, r)

    def move_done(self) -> bool:
        """Whether the programme continues: the move has ended, or the blend to the next may begin."""
        return self._drive is None or (self._drive.done() and not self._coming)

    def _stream(self, act: Callable[[], None]) -> None:
        """Let a streamed goal act after the arm's latency from command to motion."""
        self._coming.append((self.ticks + self._delay, act))

    def servoj(
        self,
        q: Angles,
        a: float = 0.0,
        v: float = 0.0,
        t: float = TICK_S,
        lookahead_time: float = 0.1,
        gain: float = 300.0,
    ) -> float:
        """Track joint angles for ``t``; ``a`` and ``v`` have no effect, as on a robot, nor here the gain."""
        if not isinstance(drive := self._drive, Servo):
            self._begin(drive := Servo(self.target_q))
        self._stream(partial(drive.aim, q, min(max(lookahead_time, 0.03), 0.2)))
        return t

    def speedj(self, qd: Array, a: float = 1.4, t: float = 0.0) -> float | None:
        """Accelerate to joint speeds and hold them for ``t`` [s]; at 0 until they are reached."""
        if not isinstance(drive := self._drive, JointSpeeds):
            self._begin(drive := JointSpeeds(self.target_qd, 1.0))
        self._stream(partial(drive.aim, qd, max(a, 1e-3)))
        return t if t > 0.0 else None

    def speedl(self, xd: Array, a: float = 1.2, t: float = 0.0, aRot: float | None = None) -> float | None:
        """Accelerate to a TCP twist and hold it as ``speedj``; linear [m/s], then angular [rad/s].

        Without ``aRot`` the rotation accelerates as ``a`` at 1 m.
        """
        if not isinstance(drive := self._drive, ToolSpeed):
            self._begin(drive := ToolSpeed(self._tcp, self.target_tcp_speed, 1.0, 1.0))
        self._stream(partial(drive.aim, xd, max(a, 1e-3), max(aRot or a, 1e-3)))
        return t if t > 0.0 else None

    def stopj(self, a: float = 2.0) -> None:
        """Decelerate the joints [rad/s^2]; ``move_done`` says when they stand."""
        self.speedj(np.zeros(6), abs(a))

    def stopl(self, a: float = 1.2, aRot: float | None = None) -> None:
        """Decelerate the TCP on its line [m/s^2]."""
        self.speedl(np.zeros(6), abs(a), 0.0, aRot)

    def steady(self) -> bool:
        """Whether the arm stands still; never in force mode, freedrive or by torque."""
        if self.compliance or self._torque_left:
            return False
        return bool(np.abs(self.target_qd).max() < 1e-6 and np.abs(self.actual_qd).max() < SETTLED)

    # Force.

    def force_mode(
        self, task_frame: Array, selection_vector: Array, wrench: Array, type: int, limits: Array
    ) -> None:
        """Comply along the selected axes of the task frame, type 1, 2 or 3."""
        if type not in (1, 2, 3):
            raise ValueError(f"force_mode: type {type}, there are 1, 2 and 3")
        if self.compliance is None:
            self._mode_settings.speed = np.zeros(6)
        self.compliance = self._mode_settings
        self.compliance.free = False
        self.compliance.set(task_frame, selection_vector, wrench, type, limits)

    def force_mode_set_damping(self, damping: float) -> None:
        """Damping 0 to 1 of force mode."""
        self._mode_settings.damping = min(max(damping, 0.0), 1.0)

    def force_mode_set_gain_scaling(self, scaling: float) -> None:
        """Gain 0 to 2 of force mode."""
        self._mode_settings.scaling = min(max(scaling, 0.0), 2.0)

    def end_force_mode(self) -> None:
        """Leave force mode, freedrive or teach mode."""
        if self.compliance is not None:
            self._coast(STOP_A)

    def _coast(self, a: float) -> None:
        """Leave force mode and torques, and stop the joints from the speeds they are commanded now."""
        self._coming.clear()
        self.compliance = None
        self._begin(JointSpeeds(np.zeros(6), a))

    def freedrive(self, freeAxes: Array = ALL_AXES, feature: Array = ORIGIN) -> None:
        """Let the arm be led along the free axes (1) of a frame; all of the base's if nothing is said.

        It is force mode with no force, so that the arm goes where something pushes it.
        """
        limits = np.array([0.25, 0.25, 0.25, 1.0, 1.0, 1.0])
        self.force_mode(feature, freeAxes, np.zeros(6), FIXED, limits)
        self._mode_settings.free = True

    def freedrive_status(self) -> int:
        """0: normal, 1: near a singularity, 2: too near."""
        least = float(np.linalg.svd(jacobian(self.actual_q, self.tcp_offset[:3]), compute_uv=False)[-1])
        return 2 if least < 0.02 else 1 if least < 0.06 else 0

    def direct_torque(
        self,
        tau: Array,
        friction_comp: bool = True,
        viscous_scale: Array | None = None,
        coulomb_scale: Array | None = None,
    ) -> None:
        """Joint torques without gravity for one step [N m]; friction scales, where given, replace the
        switch.

        Without elastic joints there is no friction to compensate.
        The arm carries itself and the tool it has; what is added is the weight of another payload than that.
        """
        torque = tau.copy()
        on = float(friction_comp)
        for mass, cog, sign in ((self.payload_mass, self.payload_cog, 1.0), (*self._own_payload, -1.0)):
            torque += sign * jacobian(self.actual_q, cog)[:3].T @ np.array([0.0, 0.0, GRAVITY * mass])
        torque += self._friction(
            *(on if scale is None else scale for scale in (viscous_scale, coulomb_scale))
        )
        if not np.isfinite(torque).all():
            raise ValueError("direct_torque: a torque is not a number")
        self._drive = None
        self.rig.order.torque = torque
        self._torque_left = 2

    def _friction(self, viscous: Array | float, coulomb: Array | float) -> Array:
        """What the joints rub at shares of the two kinds [N m]."""
        arm = self.cell.real_arm
        slides = np.clip(self.actual_qd / SETTLED, -1.0, 1.0)
        return viscous * arm.viscous * self.actual_qd + coulomb * arm.coulomb * slides

    def zero_ftsensor(self) -> None:
        """Make the mean wrench of the last `TARE` ticks the zero: one reading is off by its noise."""
        if self._wrenches:
            self.cell.state.sensor.tare += np.mean(self._wrenches, axis=0)
            self._wrenches.clear()

    def ft_input(
        self,
        enable: bool,
        sensor_mass: float = 0.0,
        sensor_measuring_offset: Array3 = ORIGIN,
        sensor_cog: Array3 = ORIGIN,
    ) -> None:
        """Take the wrench from RTDE's ``external_force_torque`` as it comes; what is said of the sensor has
        no effect.

        Its client must feed it at `FEED_HZ` or the programme pauses, unless it set a watchdog of its own.
        """
        self._external_on = enable
        name = "external_force_torque"
        if self.watchdog is None or self.watchdog[0] == name:
            self.set_watchdog(name, FEED_HZ if enable else 0.0, "pause")

    def tool_contact(self, direction: Array = ORIGIN) -> int:
        """Steps since the contact against a direction, of zeros from any, began; 0 without one.

        A contact is a force, less its median of the last second, that came to `CONTACT_N`; it began where it
        last rose above `TOUCH_N`.
        """
        forces = np.array([force[:3] for _, force in list(self._past)[-500:]])
        change = forces - np.median(forces, axis=0)
        way = direction[:3]
        pressed = -change @ unit(way) if way.any() else norms(change)
        free = np.flatnonzero(pressed < TOUCH_N)
        since = pressed[free[-1] + 1 :] if len(free) else pressed
        return len(since) if np.any(since > CONTACT_N) else 0

    # Tool and payload.

    def set_tcp(self, pose: Array, tcp_name: str = "") -> None:
        """Set the TCP, in the flange's frame; its name is the pendant's."""
        self.tcp_offset = pose
        self._tcp = from_pose(self.tcp_offset)
        self._see()

    def set_payload(
        self, m: float, cog: Array3 | None = None, inertia: Array | None = None, transition_time: float = 0.0
    ) -> None:
        """Set the payload, at once; None leaves a value as it is."""
        if not 0.0 <= m <= 100.0:
            raise ValueError(f"set_payload: a mass of {m:g} kg")
        self.payload_mass = m
        if cog is not None:
            self.payload_cog = cog
        if inertia is not None:
            self.payload_inertia = inertia
        T = self._sensor_on_flange
        self.cell.compensate(self.payload_mass, T[:3, :3].T @ (self.payload_cog - T[:3, 3]))

    def set_gravity(self, d: Array3) -> None:
        """Set gravity [m/s^2], base axes: only the one the cell has.

        Raises:
            ValueError: It is another.
        """
        if abs(abs(d[2]) - GRAVITY) > 0.05 or np.abs(d[:2]).max() > 0.05:
            raise ValueError(
                f"set_gravity: the cell's robot stands upright, gravity is {GRAVITY} m/s^2 along its z axis"
            )

    # Safety.

    def protective_stop(self, reason: str = "asked for by the programme") -> None:
        """Stop the arm as a safety function would; the programme pauses."""
        if self.safety == PROTECTIVE:
            return
        self.safety = PROTECTIVE
        self.stop_reason = reason
        self._coast(STOP_A)

    def unlock(self) -> None:
        """Leave a protective stop; the arm may back off from what stopped it, and is watched once nothing
        does."""
        self.safety, self._unlocked_at, self._drive = NORMAL, self.ticks, None
        self.rig.unlock()

    def let_go(self) -> None:
        """A programme has ended: leave force mode and stop."""
        self._coast(4.0)

    def power_down(self) -> None:
        """Switch the controller off."""
        self.let_go()
        self.mode = POWER_OFF

    def set_speed_fraction(self, fraction: float) -> None:
        """Move the speed slider."""
        if np.isfinite(fraction):
            self.speed_fraction = min(max(fraction, 0.0), 1.0)

    def set_watchdog(self, variable_name: str, min_frequency: float, action: str = "pause") -> None:
        """Watch how often an RTDE input is written; ``action``: "ignore", "pause" or "stop".

        Raises:
            ValueError: There is no such action.
        """
        if action not in ("ignore", "pause", "stop"):
            raise ValueError(f'rtde_set_watchdog: action "{action}", there are "ignore", "pause" and "stop"')
        self.watchdog, self.written[variable_name] = None, self.ticks
        if min_frequency > 0.0 and action != "ignore":
            self.watchdog = variable_name, math.ceil(1.0 / (min_frequency * TICK_S)), action

    # Registers and IO.

    def read(self, name: str, index: int) -> Any:
        """One of the `signals`."""
        if name.startswith("input"):
            self.inputs_read.add(f"{name}_{index}")
        return self.signals[name][index]

    def write(self, name: str, index: int, value: float) -> None:
        """Set one of the `signals`; analog ones are shares, integers have 32 bits."""
        if "int" in name and abs(value) >= 2**31:
            raise ValueError(f"{name}: {value:g} is no 32-bit integer")
        values = self.signals[name]
        values[index] = type(values[index])(min(max(value, 0.0), 1.0) if "analog" in name else value)

    @property
    def digital_out(self) -> int:
        """The digital outputs as bits."""
        return bits_of(list(chain(*(self.signals[f"{group}_digital_out"] for group in PINS))))

    # Kinematics and dynamics.

    def forward_kin(self, q: Array, tcp: Array) -> Array:
        """Pose of the TCP at joint angles."""
        return pose_of(tool_at(q, from_pose(tcp))[0])

    def inverse_kin(
        self,
        x: Array,
        qnear: Array,
        maxPositionError: float = 0.0,
        maxOrientationError: float = 0.0,
        tcp: Array = ORIGIN,
    ) -> Array | None:
        """Joint angles nearest to others, exact whatever the errors allowed; None where there is no
        solution."""
        try:
            return inverse_near(from_pose(x) @ inverse(from_pose(tcp)), qnear)
        except ReachError:
            return None

    def jacobian(self, pos: Array, tcp: Array) -> Array:
        """Jacobian of the TCP, shape (6, 6), linear rows first."""
        return jacobian(pos, tcp[:3])

    def jacobian_dot(self, pos: Array, vel: Array, tcp: Array) -> Array:
        """Time derivative of the Jacobian, shape (6, 6); by central differences."""
        ahead, behind = (self.jacobian(pos + h * vel, tcp) for h in (1e-5, -1e-5))
        return (ahead - behind) / 2e-5

    def mass_matrix(self, pos: Array, include_rotors_inertia: bool = False) -> Array:
        """Joint-space inertia [kg m^2], shape (6, 6); with the tool."""
        self._bias(pos, np.zeros(6))
        own = include_rotors_inertia * self.cell.real_arm.inertia
        return joint_inertia(self.cell.model, self._data)[:6, :6] + np.diag(own)

    def coriolis(self, pos: Array, vel: Array) -> Array:
        """Coriolis and centrifugal torques [N m]: what the speeds add to the forces at rest."""
        return self._bias(pos, vel) - self._bias(pos, np.zeros(6))

    def _bias(self, q: Array, qd: Array) -> Array:
        """Torques of weight and speeds at a state (6,) [N m], which ``_data`` then has."""
        data = self._data
        data.qpos[:6], data.qvel[:6] = q, qd
        mujoco.mj_forward(self.cell.model, data)
        return data.qfrc_bias[:6].copy()

    @property
    def free_torques(self) -> Array:
        """Torques of the joints beyond what carries and moves the arm [N m].

        Friction at rest is not known and stays in it.
        """
        own = self.mass_matrix(self.actual_q, True) @ self.target_qdd + self._friction(1.0, 1.0)
        own += self._bias(self.actual_q, self.actual_qd)
        if not self.cell.real_arm.elastic:
            own -= self._data.qfrc_gravcomp[:6]  # carried without motors
        return self.joint_torques - own

    def within_safety_limits(self, target: Array, is_pose: bool) -> bool:
        """Whether a pose, or joint angles, are within reach and joint ranges."""
        q = self.inverse_kin(target, self.actual_q, tcp=self.tcp_offset) if is_pose else target
        return q is not None and not beyond_range(q).any()

    def q_history(self, steps: int = 0) -> Array:
        """Joint angles some steps ago; 2 s are kept."""
        return self._past[max(len(self._past) - 1 - max(steps, 0), 0)][0]
