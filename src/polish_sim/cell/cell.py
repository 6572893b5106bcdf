"""The cell: one robot, head, sensor, part and controller, assembled from a scenario and run."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.carrier import FIRST_CONTROL, FIRST_JOINT, FOLLOWER, MasterRows, build_carrier, no_carrier
from polish_sim.cell.contact import RealPart, build_pad, build_spindle
from polish_sim.cell.faults import FaultClock, SafetyRecord, check_events, parse_events, record_safety
from polish_sim.cell.guards import CONTROLLER_ERROR, REASONS, build_guards, crash_points
from polish_sim.cell.host_arm import HostArm, no_host_arm
from polish_sim.cell.kernel import ARRIVED, CLOCK, ENDED, STATUS_SIZE, STOP, CellKernel, engine_views, register_engine
from polish_sim.cell.limits import check_rates, check_step_limits
from polish_sim.cell.loop import advance
from polish_sim.cell.observer import Observer, PythonLaw, Silent, interrupts_noted
from polish_sim.cell.protective_stop import brakes_of, build_stop_motion
from polish_sim.cell.real_part import build_part_motion
from polish_sim.cell.recorder import MASTER_Q, build_recorder, trace_from
from polish_sim.cell.speedl import build_speedl, build_speedl_state
from polish_sim.cell.stroke import Job, begin_next_stroke, build_sequence_state, expected_duration
from polish_sim.cell.wrist_sensor import SensorModel, SensorState, build_sensor, carried_payload
from polish_sim.config import Scenario
from polish_sim.control.signals import MEASUREMENT_SIZE, TARGET_SIZE, WHOLE_FEED, CompiledController, Controller, Course
from polish_sim.control.user_controller import file_of, tell_error
from polish_sim.errors import InputError, ReachError
from polish_sim.log import RunLog, Trace, from_rows, with_column

Array = NDArray[np.float64]

DRAWS = 12  # standard normal numbers a step takes: noise and drift of six axes


class CellRun(NamedTuple):
    """What a run of the cell leaves behind."""

    log: RunLog
    trace: Trace
    stop_reason: str | None
    """Why the robot stopped itself, or None."""
    interrupted: bool
    steps: int
    wall_s: float
    """Time spent stepping [s]."""
    safety: SafetyRecord
    """What came of faults and guards."""


class PayloadErrors(NamedTuple):
    """What the host believes to carry against the tool as it is."""

    payload_mass_error_kg: float
    """Believed minus true mass, ``sensor.payload_mass_error`` included."""
    payload_center_error_m: float
    """Distance of the believed from the true centre of mass."""


class Cell:
    """A scenario's cell, ready to run.

    Args:
        scenario: Everything but the geometry.
        model: The compiled scene.
        part: What the pad touches; an empty one for motion in free space.
        strokes: What is to be done, one job after the other.
        q_start: Joint positions at the start [rad], shape (6,).
        controller: The control law.
        rng: Draws the sensor's bias, drift and noise.
        course: What lies ahead on the path, for controllers that prepare for it.
        master: What a second robot does that carries the part; the robot with the tool is then the follower.
        host_arm: The robot with the tool as the host computes it; None: as it is.

    The host compensates the tool as it is until ``compensate`` tells it otherwise.
    """

    def __init__(
        self,
        scenario: Scenario,
        model: mujoco.MjModel,
        part: RealPart,
        strokes: Sequence[Job],
        q_start: Array,
        controller: Controller,
        rng: np.random.Generator,
        course: Course | None = None,
        master: MasterRows | None = None,
        host_arm: HostArm | None = None,
    ) -> None:
        register_engine()
        self.scenario, self.model, self.rng, self.course = scenario, model, rng, course
        self.arm = FOLLOWER if master is not None else ""
        self.data = mujoco.MjData(model)
        self.data.qpos[:6] = q_start
        self.data.ctrl[0:12:2] = q_start
        if master is not None:
            self.data.qpos[FIRST_JOINT:] = self.data.ctrl[FIRST_CONTROL::2] = master.q[0]
        mujoco.mj_forward(model, self.data)
        if self.data.ncon:
            raise ReachError(
                f"the robot cannot start here: {self._touching()} touch. Move the part with --part-pose X,Y,Z,RX,RY,RZ."
            )
        check_step_limits(scenario, self._tangential_mass(), part.field.band)
        check_rates(scenario)
        self.carried = carried_payload(model, self.data, self.arm)
        events = parse_events(scenario.faults.events)
        check_events(events, on_part=any(job.contact > 0.0 for job in strokes), two_robots=master is not None)
        self.faults = FaultClock(events)
        self._touched: str | None = None
        self.strokes = tuple(strokes)
        self.kernel = self._build_kernel(part, self.strokes[0], q_start, master, host_arm)
        self.compensate(self.carried.mass, self.carried.center)
        self.use_controller(controller)
        rate = scenario.simulation.log_rate_hz
        self._every = max(1, round(1.0 / (rate * scenario.simulation.timestep_s))) if rate else 1

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
            raise InputError(f"the controller's {doing} failed: {tell_error(error, file_of(controller))}.") from error
        self.law = self._attach(controller)

    @property
    def sensor(self) -> SensorModel:
        """The wrist sensor, with the bias this run drew."""
        return self.kernel.sensor

    @property
    def tare(self) -> Array:
        """What the host has tared: compensated wrench at the tool point when it was zeroed [N, N m], shape (6,)."""
        return self.kernel.sensor_state.tare.copy()

    def compensate(self, mass: float, center: Array) -> None:
        """Let the host believe in a tool and subtract its weight from every reading.

        Args:
            mass: [kg]; the scenario's ``sensor.payload_mass_error`` comes on top.
            center: Its centre of mass in the sensor frame [m], shape (3,).
        """
        believed = mass * (1.0 + self.scenario.sensor.payload_mass_error)
        payload = self.kernel.payload._replace(mass=believed, center=np.array(center, dtype=np.float64))
        self.kernel = self.kernel._replace(payload=payload)

    @property
    def payload_errors(self) -> PayloadErrors:
        """How far what the host believes to carry is from the tool as it is."""
        believed, carried = self.kernel.payload, self.carried
        return PayloadErrors(
            float(believed.mass - carried.mass), float(np.linalg.norm(believed.center - carried.center))
        )

    def idle_sensor(self) -> SensorState:
        """Fresh memory for this run's sensor, to read it apart from the run."""
        return SensorState(*(np.zeros_like(array) for array in self.kernel.sensor_state))

    def run(self, observer: Observer | None = None) -> CellRun:
        """Run the job to its end, to a protective stop, or to an interrupt; what was recorded is returned in any case.

        Args:
            observer: Told of the progress.

        Returns:
            The log, the trace and how it ended.
        """
        watcher = observer or Silent()
        status, dt = self.kernel.status, self.kernel.engine.dt
        chunk = max(1, round(watcher.frame_every_s / dt))
        chunk += -chunk % self._every
        recorder = build_recorder(chunk, self._every)
        rows: list[Array] = []
        traces: list[Array] = []
        total = sum(expected_duration(job) for job in self.strokes)
        started = time.perf_counter()
        draws = np.empty((0, DRAWS))
        with interrupts_noted() as interrupt:
            for stroke in self.strokes:
                if status[ARRIVED]:
                    status[ARRIVED] = 0.0
                    begin_next_stroke(self.kernel.sequence)
                while status[ENDED] == 0.0 and status[ARRIVED] == 0.0 and not interrupt.seen:
                    self.kernel = self.faults.inject_due(self.kernel._replace(job=stroke))
                    steps = self.faults.steps_to_next(self.kernel, chunk)
                    # What a stroke left over goes on to the next: the noise must not depend on the chunks.
                    draws = np.concatenate([draws, self.rng.standard_normal((chunk - len(draws), DRAWS))])
                    advance(self.kernel, recorder, self.law, draws, steps)
                    draws = draws[recorder.filled[1] :]
                    # Returns at the stop, before the retract: what touches then is what stopped it.
                    if status[STOP] and self._touched is None:
                        self._touched = self._touching()
                    rows.append(recorder.rows[: recorder.filled[0]].copy())
                    traces.append(recorder.trace[: recorder.filled[1]].copy())
                    watcher.progress(min(status[CLOCK] * dt, total), total)
                    watcher.frame(self.model, self.data)
                if interrupt.seen or status[ENDED]:
                    break
        if not rows:
            raise KeyboardInterrupt
        wall = time.perf_counter() - started
        return CellRun(
            self._log(np.concatenate(rows)),
            trace_from(np.concatenate(traces)),
            self._stop_reason(),
            interrupt.seen or self._was_interrupted(),
            sum(len(t) for t in traces),
            wall,
            record_safety(self.kernel, self.faults),
        )

    def _log(self, rows: Array) -> RunLog:
        log = from_rows(rows)
        return with_column(log, "master_q_rad", rows[:, MASTER_Q:]) if self.arm else log

    def _attach(self, controller: Controller) -> object:
        """The controller's law for the compiled loop: its own, or a callback into Python."""
        if isinstance(controller, CompiledController):
            self.kernel = self.kernel._replace(context=controller.context)
            return controller.compiled_law()
        k = self.kernel
        return PythonLaw(controller, k.measurement, k.target, k.twist, k.status)

    def _was_interrupted(self) -> bool:
        return isinstance(self.law, PythonLaw) and isinstance(self.law.error, KeyboardInterrupt)

    def _stop_reason(self) -> str | None:
        """Why the robot stopped; an interrupt within a controller is no stop."""
        code = float(self.kernel.status[STOP])
        if code == 0.0 or self._was_interrupted():
            return None
        if code == CONTROLLER_ERROR and isinstance(self.law, PythonLaw):
            return f"{REASONS[code]}: {self.law.told}"
        return f"{REASONS[code]} ({self._touched} touch)" if self._touched else REASONS[code]

    def _touching(self) -> str:
        """The first two bodies the engine sees in contact, by their geoms' names; empty if there are none."""
        if not self.data.ncon:
            return ""
        return " and ".join(self.model.geom(int(g)).name for g in self.data.contact[0].geom)

    def _tangential_mass(self) -> float:
        """Least inertia the tool point shows against a push across the tool axis [kg]."""
        inertia = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, inertia)
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self.data, jacobian, None, self.model.site(f"{self.arm}pad").id)
        across = self.data.site(f"{self.arm}tool").xmat.reshape(3, 3)[:, :2].T @ jacobian
        mobility = across @ np.linalg.solve(inertia, across.T)
        return float(1.0 / np.linalg.eigvalsh(mobility)[-1])

    def _build_kernel(
        self, part: RealPart, job: Job, q_start: Array, master: MasterRows | None, host_arm: HostArm | None
    ) -> CellKernel:
        scenario = self.scenario
        sensor, sensor_state = build_sensor(scenario.sensor, self.rng)
        speedl = build_speedl(scenario)
        return CellKernel(
            engine_views(self.model, self.data, self.arm),
            build_pad(scenario.pad, scenario.head.spring_scale),
            # It may move; the caller's part must not.
            part._replace(position=part.position.copy(), rotation=part.rotation.copy()),
            build_part_motion(scenario.part, part),
            no_carrier() if master is None else build_carrier(self.model, self.data, master, part, brakes_of(scenario)),
            no_host_arm() if host_arm is None else host_arm,
            build_spindle(scenario.spindle),
            sensor,
            sensor_state,
            self.carried,
            speedl,
            build_speedl_state(speedl, q_start),
            job,
            build_sequence_state(),
            build_guards(scenario, *crash_points(self.model, self.arm)),
            build_stop_motion(scenario, scenario.plan.clearance_m if job.contact else 0.0),
            np.zeros(MEASUREMENT_SIZE),
            np.zeros(TARGET_SIZE),
            WHOLE_FEED.copy(),
            np.zeros(1),
            scenario.simulation.control_every,
            np.zeros(6),
            np.zeros((5, 3)),
            np.zeros((6, 6)),
            np.zeros(STATUS_SIZE),
        )
