"""The cell: one robot, head, sensor, part and controller, assembled from a scenario and run."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.contact import RealPart, build_flange, build_pad, build_spindle
from polish_sim.cell.engine import engine_views, register_engine
from polish_sim.cell.faults import (
    FAULTS,
    Fault,
    FaultClock,
    FaultEvent,
    SafetyRecord,
    parse_events,
    record_safety,
)
from polish_sim.cell.gears import HostArm, RealArm
from polish_sim.cell.guards import CONTROLLER_ERROR, NO_STOP, REASONS, build_guards, crash_points
from polish_sim.cell.kernel import (
    SET_POINTS,
    CellKernel,
    CellState,
    LawMemory,
    Lesson,
    SetPoints,
)
from polish_sim.cell.limits import (
    check_contact_settings,
    check_friction,
    with_implicit_friction,
)
from polish_sim.cell.loop import advance
from polish_sim.cell.observer import SILENT, Observer, PythonLaw, interrupts_noted
from polish_sim.cell.real_arm import build_real_arm, joint_inertia
from polish_sim.cell.real_part import build_part_motion, no_part
from polish_sim.cell.recorder import Recorder, build_recorder, trace_from
from polish_sim.cell.robot import build_request_line, build_speedl, build_stop_motion
from polish_sim.cell.scene import touching
from polish_sim.cell.stroke import Stroke, begin_next_stroke, build_sequence, cycle_time
from polish_sim.cell.wrist_sensor import (
    DRAWS,
    Payload,
    SensorErrors,
    build_sample_line,
    build_sensor,
    carried_payload,
)
from polish_sim.config import PadConfig, Scenario
from polish_sim.control.laws import file_of, tell_error
from polish_sim.control.signals import Answer, CompiledController, Controller, Course
from polish_sim.errors import InputError, ReachError
from polish_sim.kernels import memory_of
from polish_sim.log import LOG_ROW, RunLog, Trace, from_rows


class CellRun(NamedTuple):
    """Result of a run of the cell."""

    log: RunLog
    trace: Trace
    stop_reason: str | None  #: Why the robot stopped itself, or None
    interrupted: bool
    steps: int
    dt: float  #: Simulated time of a step [s]
    wall_s: float  #: Time spent stepping [s]
    safety: SafetyRecord  #: Faults and guards
    payload: PayloadErrors
    files: Mapping[str, str]  #: That say what its host knew of the arm, by name
    stroke: str = ""  #: Which of how many was under way at the end; empty where there is no part


class Played(NamedTuple):
    """What was recorded of a piece of a run."""

    rows: NDArray[np.void]  #: Of the log
    trace: NDArray[np.void]  #: ``TraceStep`` of every step


NO_LESSON = Lesson(np.zeros(0), 1.0, 0.0, 0)


class BelievedArm(NamedTuple):
    """What the host knows of how its arm is built."""

    host: HostArm | None  #: That computes with it; None: by the nominal table
    files: Mapping[str, str]  #: That say it, by name


MAKERS_ARM = BelievedArm(None, {})


class PayloadErrors(NamedTuple):
    """Payload the host believes in against the tool as it is."""

    payload_mass_error_kg: float  #: Believed minus true mass, ``sensor.payload_mass_error`` included
    payload_center_error_m: float  #: Distance of the believed from the true centre of mass


class _Start(NamedTuple):
    """A cell before its run."""

    q: Array  #: Joints as the encoders read them [rad], shape (6,)
    force: float  #: The largest it is to hold [N]
    mass: float  #: See ``Cell._tangential_mass`` [kg]
    qpos: Array  #: Of the engine
    arm: RealArm
    damping: Array  #: Of the engine's joints


class Cell:
    """A scenario's cell, ready to run: ``strokes`` in order on ``part`` (`no_part` for motion in free space).

    The joints start at ``q_start`` [rad], shape (6,); ``rng`` draws the sensor's bias, drift and noise;
    ``course`` is for controllers that prepare for what lies ahead; what holds the part is its ``fixture``;
    ``known`` is what the host knows of how its arm is built.
    The host compensates the tool as it is until ``compensate``
    says otherwise.
    """

    arm = ""  #: Prefix of the names of the robot with the tool
    fault_table: Mapping[str, Fault] = FAULTS  #: What can go wrong in it
    reasons: Mapping[int, str] = REASONS  #: What each code of a protective stop means
    row: Any = LOG_ROW  #: What is recorded of it

    def __init__(
        self,
        scenario: Scenario,
        model: mujoco.MjModel,
        part: RealPart,
        strokes: Sequence[Stroke],
        q_start: Array,
        controller: Controller,
        rng: np.random.Generator,
        course: Course | None = None,
        fixture: RealPart | None = None,
        lesson: Lesson = NO_LESSON,
        known: BelievedArm = MAKERS_ARM,
    ) -> None:
        register_engine()
        self.scenario, self.part, self.rng = scenario, part, rng
        self.model, self.course = model, course
        self.lesson, self._known = lesson, known
        self.data = mujoco.MjData(model)
        self._set_joints(q_start)
        self.real_arm = self._build_real_arm(q_start) if scenario.robot.elastic else RealArm()
        self.real_arm.waited = scenario.simulation.control_every - 1
        mujoco.mj_forward(model, self.data)
        if pair := touching(model, self.data):
            raise ReachError(
                f"the robot cannot start here: {pair} touch. Move the part with --part-pose X,Y,Z,RX,RY,RZ."
            )
        forces = [float(stroke.force.max()) for stroke in strokes if stroke.contact]
        self.carried: Payload = carried_payload(model, self.data, self.arm)
        self.strokes = tuple(strokes)
        self._fixture = fixture or no_part()
        self._crash_points = crash_points(model, self.arm)
        self._start = _Start(
            q_start, max(forces, default=scenario.process.contact_force_n), self._tangential_mass(),
            self.data.qpos.copy(), copy(self.real_arm), model.dof_damping.copy(),
        )  # fmt: skip
        self._every = scenario.simulation.log_every
        self._prepare()
        self.compensate(self.carried.mass, self.carried.center)
        self.use_controller(controller)

    def begin_again(self, scenario: Scenario, part: RealPart, rng: np.random.Generator) -> None:
        """Go back to the start, for a run of another ``scenario``, part and sensor.

        The scenario may differ in what neither scene, arm, strokes nor controller depend on. The host keeps
        believing the payload it believes.
        """
        start = self._start
        self.scenario, self.part, self.rng = scenario, part, rng
        mujoco.mj_resetData(self.model, self.data)
        self._set_joints(start.q)
        self.data.qpos[:], self.model.dof_damping[:] = start.qpos, start.damping
        memory_of(self.real_arm)[:] = memory_of(start.arm)
        mujoco.mj_forward(self.model, self.data)
        self._prepare()
        self.compensate(*self._believed)
        self.use_controller(self.controller)

    def _prepare(self) -> None:
        """Check its scenario, of which `check_rates` holds, against the cell, and build what changes in a
        run."""
        scenario, force, mass = self.scenario, self._start.force, self._start.mass
        pad, dt = scenario.pad, scenario.simulation.timestep_s
        if self.real_arm.elastic:
            pad = with_implicit_friction(pad, force, mass, dt)
        check_contact_settings(scenario, force)
        check_friction(pad, force, mass, dt)
        self.on_part = any(stroke.contact for stroke in self.strokes)
        self.set_points = SetPoints(scenario.process)
        self.touched: str | None = None  #: The links in contact at a protective stop
        self.stroke_number = 0
        self.draws = np.empty((0, DRAWS))
        faults = parse_events(scenario.faults.events, self.fault_table)
        self.faults = FaultClock(faults + parse_events(scenario.process.changes, SET_POINTS))
        self.asked: list[FaultEvent] = []  #: What somebody let happen while it ran
        self.kernel = self._build_kernel(pad)
        self.recorder = build_recorder(0, self._every, self.row)

    def use_controller(self, controller: Controller) -> None:
        """Reset a controller and let it drive the cell from now on."""
        self.controller = controller
        prepare = getattr(controller, "prepare", None)
        doing = "prepare()"
        try:
            if self.course is not None and callable(prepare):
                prepare(self.course)
            doing = "reset()"
            controller.reset(self.kernel.engine.dt * self.kernel.control_every)
        except Exception as error:
            raise InputError(
                f"the controller's {doing} failed: {tell_error(error, file_of(controller))}."
            ) from error
        law: dict[str, Any] = {"call": PythonLaw(controller, self.state)}
        if isinstance(controller, CompiledController):
            law = {"call": controller.law, "context": memory_of(controller.context)}
            law["course"] = controller.course.view(np.uint8)
        self.kernel = self.kernel._replace(law=self.kernel.law._replace(**law))

    @property
    def state(self) -> CellState:
        """Everything that changes during the run."""
        return self.kernel.state

    @property
    def sensor(self) -> SensorErrors:
        """Errors of the wrist sensor, with the bias this run drew."""
        return self.state.sensor.errors

    def compensate(self, mass: float, center: Array) -> None:
        """Let the host subtract the weight of a tool, its ``center`` of mass in the sensor frame [m], shape
        (3,).

        The scenario's ``sensor.payload_mass_error`` comes on top of ``mass`` [kg].
        """
        payload = self.state.payload
        self._believed = (mass, center)
        payload.mass = mass * (1.0 + self.scenario.sensor.payload_mass_error)
        payload.center = center

    @property
    def payload_errors(self) -> PayloadErrors:
        """How far the payload the host believes in is from the tool as it is."""
        believed, carried = self.state.payload, self.carried
        return PayloadErrors(
            float(believed.mass - carried.mass), float(np.linalg.norm(believed.center - carried.center))
        )

    def let_happen(self, what: str) -> None:
        """Let a fault, or a change of a set point as ``NAME=VALUE`` [SI], happen before the next step.

        Raises:
            PolishSimError: There is no such thing.
        """
        entry = f"{what}@{self.state.status.steps * self.kernel.engine.dt:.12g}"
        (event,) = parse_events(entry, SET_POINTS if "=" in what else self.fault_table)
        self.faults.waiting.append(event)
        self.asked.append(event)

    def run(self, observer: Observer = SILENT) -> CellRun:
        """Run the strokes to their end, to a protective stop, or to an interrupt; what was recorded is
        returned."""
        status, dt = self.state.status, self.kernel.engine.dt
        chunk = max(1, round(observer.frame_every_s / dt))
        chunk += -chunk % self._every
        played: list[Played] = []
        total = cycle_time(self.strokes)
        started = time.perf_counter()
        observer.start(self)
        with interrupts_noted(observer) as interrupt:
            while not (self.done or interrupt.seen):
                played.append(self.play(chunk))
                observer.progress(min(status.steps * dt, total), total)
                observer.frame(self.model, self.data)
        if not played:
            raise KeyboardInterrupt
        return self.result(played, interrupt.seen, time.perf_counter() - started)

    @property
    def done(self) -> bool:
        """Whether the last stroke is done, or a stop is over."""
        status = self.state.status
        return bool(status.ended or (status.arrived and self.stroke_number == len(self.strokes) - 1))

    def play(self, steps: int) -> Played:
        """Run on for at most ``steps``: to the stroke's end, to a stop, or to where a fault or a change is
        due.

        Call it until `done`: where a stroke has ended the next one is begun, after a stop the robot brakes
        and retracts. The bytes do not depend on how a run is cut.
        """
        status = self.state.status
        if status.arrived:
            status.arrived = False
            begin_next_stroke(self.state.sequence)
            self.begin_stroke(self.stroke_number + 1)
        elif status.steps == 0:
            self.begin_stroke(0)
        self.faults.inject_due(self)
        if len(self.recorder.trace) < steps:
            longer = build_recorder(steps, self._every, self.row)
            self.recorder = longer._replace(filled=self.recorder.filled)
        # What is left over is used in the next call: the noise must not depend on how a run is cut.
        if len(self.draws) < steps:
            self.draws = np.concatenate(
                [self.draws, self.rng.standard_normal((steps - len(self.draws), DRAWS))]
            )
        self._advance(self.recorder, self.draws, self.faults.steps_to_next(self.kernel, steps))
        filled = self.recorder.filled
        self.draws = self.draws[filled.steps :]
        # Returns at the stop, before the retract: the contact that caused it is still there.
        if status.stop != NO_STOP and self.touched is None:
            self.touched = touching(self.model, self.data)
        return Played(self.recorder.rows[: filled.rows].copy(), self.recorder.trace[: filled.steps].copy())

    def result(self, played: Sequence[Played], interrupted: bool = False, wall_s: float = 0.0) -> CellRun:
        """The run that its pieces make, from the first step on."""
        trace = np.concatenate([piece.trace for piece in played])
        return CellRun(
            self._log(np.concatenate([piece.rows for piece in played])),
            trace_from(trace),
            self._stop_reason(),
            interrupted or self._was_interrupted(),
            len(trace),
            self.kernel.engine.dt,
            wall_s,
            record_safety(self.kernel, self.faults),
            self.payload_errors,
            self._known.files,
            f"{self.stroke_number + 1} of {len(self.strokes)}" if self.on_part else "",
        )

    def begin_stroke(self, number: int) -> None:
        """Let the loop work on a stroke; where it is in it stays as it is."""
        self.stroke_number = number
        self.kernel = self.kernel._replace(stroke=self.set_points.begin(self.strokes[number]))

    def memory(self) -> list[NDArray[Any]]:
        """What its compiled loop remembers outside the engine's state and the law's memory."""
        k = self.kernel
        return [
            *map(memory_of, (k.state, k.pad.material, self.recorder.filled, self.real_arm)), k.samples,
            k.requests.twists, k.requests.numbers, k.part.position, k.part.rotation,
            k.engine.speeds_before, k.engine.sensordata, k.engine.dof_damping,
        ]  # fmt: skip

    def _set_joints(self, q_start: Array) -> None:
        """Positions and controls at the start."""
        self.data.qpos[:6] = q_start
        self.data.ctrl[0:12:2] = q_start

    def _build_real_arm(self, q_start: Array) -> RealArm:
        real, seed = self.scenario.robot.real, self.scenario.seed
        return build_real_arm(real, seed, self.model, self.data, q_start, self._known.host)

    def _advance(self, recorder: Recorder, draws: Array, steps: int) -> None:
        advance(self.kernel, self.real_arm, recorder, draws, steps)

    def _log(self, rows: NDArray[np.void]) -> RunLog:
        return from_rows(rows)

    def _was_interrupted(self) -> bool:
        return isinstance(getattr(self.kernel.law.call, "error", None), KeyboardInterrupt)

    def _stop_reason(self) -> str | None:
        """Why the robot stopped; an interrupt within a controller is no stop."""
        code = int(self.state.status.stop)
        if code == NO_STOP or self._was_interrupted():
            return None
        if code == CONTROLLER_ERROR:
            return f"{self.reasons[code]}: {self.kernel.law.call.message}"
        return f"{self.reasons[code]} ({self.touched} touch)" if self.touched else self.reasons[code]

    def _tangential_mass(self) -> float:
        """Least inertia the tool point shows against a push across the tool axis [kg]."""
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, jacobian, None, self.model.site(f"{self.arm}pad").id)
        across = self.data.site(f"{self.arm}tool").xmat.reshape(3, 3)[:, :2].T @ jacobian
        mobility = across @ np.linalg.solve(joint_inertia(self.model, self.data), across.T)
        return float(1.0 / np.linalg.eigvalsh(mobility)[-1])

    def _build_kernel(self, pad: PadConfig) -> CellKernel:
        scenario, part = self.scenario, self.part
        stroke = self.strokes[0]
        nothing = np.zeros(8, np.uint8)
        dt, robot, safety = scenario.simulation.timestep_s, scenario.robot, scenario.safety
        state = CellState(
            motion=build_part_motion(scenario.part, part),
            spindle=build_spindle(scenario.spindle),
            flange=build_flange(scenario.head, dt),
            sensor=build_sensor(scenario.sensor, self.rng),
            payload=self.carried,
            speedl=build_speedl(robot, safety, dt, self._start.q),
            sequence=build_sequence(),
            guards=build_guards(safety, scenario.sensor, scenario.controller.adaptive.arm_mode_hz, dt),
            stop=build_stop_motion(robot, safety, scenario.plan.clearance_m if stroke.contact else 0.0),
            answer=Answer(feed=1.0),
        )
        return CellKernel(
            engine_views(self.model, self.data, self.arm),
            build_pad(pad, scenario.head.spring_scale),
            # It may move; the caller's part must not.
            part._replace(position=part.position.copy(), rotation=part.rotation.copy()),
            self._fixture,
            stroke,
            self._crash_points,
            build_sample_line(state.sensor),
            build_request_line(state.speedl),
            LawMemory(0, nothing, nothing, *map(memory_of, (state.measurement, state.target, state.answer))),
            self.lesson,
            scenario.simulation.control_every,
            state,
        )
