"""The control loop, written once: contact, sense, target, control, command, step, record (layer 8a).

The order decides stability: contact and sensor use positions and velocities of the same instant (after
``mj_step1``); from poses of the previous instant the contact would feed energy in.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.contact import Pad, RealPart, press_pad
from polish_sim.cell.engine import mj_step1, mj_step2
from polish_sim.cell.guards import CONTROLLER_NAN, JOINT_LIMIT, MISSING, UNSTABLE, Guards, check_guards
from polish_sim.cell.recorder import Recorder, record_reading, record_state
from polish_sim.cell.sequence import (
    APPROACH,
    DONE,
    PROCESS,
    RETRACT,
    SEEK,
    TARE,
    TARE_START,
    TOUCH_DOWN,
    Job,
    SequenceState,
    advance_sequence,
)
from polish_sim.cell.speedl import SpeedlModel, SpeedlState, limit_acceleration, pass_request, resolve_joints
from polish_sim.cell.wrist_sensor import Payload, SensorModel, SensorState, sample_sensor, tool_wrench
from polish_sim.control.signals import Measurement, Target, measurement_of, target_of

Array = NDArray[np.float64]

FIRST_CONTACT_N = 0.5  # exact force at which the log's touch-down begins

CLOCK, REQUESTS, STOP, TOUCHED, TARES, ARRIVED = 0, 1, 2, 3, 4, 5
STATUS_SIZE = 8


class EngineViews(NamedTuple):
    """Addresses and live views of the engine's model and data, taken once."""

    model: int
    data: int
    dt: float
    """Physics step [s]."""
    qpos: Array
    qvel: Array
    ctrl: Array
    xanchor: Array
    xaxis: Array
    xpos: Array
    xmat: Array
    xipos: Array
    cvel: Array
    subtree_com: Array
    site_xpos: Array
    site_xmat: Array
    xfrc_applied: Array
    qfrc_actuator: Array
    sensordata: Array
    tool_site: int
    pad_site: int
    head_body: int
    root_body: int


class CellKernel(NamedTuple):
    """Everything the compiled loop works on."""

    engine: EngineViews
    pad: Pad
    part: RealPart
    spin: float
    """Spindle speed [rad/s]."""
    sensor: SensorModel
    sensor_state: SensorState
    payload: Payload
    speedl: SpeedlModel
    speedl_state: SpeedlState
    job: Job
    sequence: SequenceState
    guards: Guards
    measurement: Array
    target: Array
    twist: Array
    """Twist the controller asked for last, shape (6,)."""
    context: Array
    """Gains and memory of a compiled law."""
    control_every: int
    wrench: Array
    """Exact wrench of the tool on the part, tool axes, tool point, shape (6,)."""
    scratch: Array
    """Work array, shape (5, 3)."""
    status: Array
    """Step count, requests sent, stop code, first contact seen, tare samples, done; shape (8,)."""


@njit(cache=True, error_model="numpy")
def advance(cell: CellKernel, recorder: Recorder, law, draws: Array, steps: int) -> None:  # type: ignore[no-untyped-def]
    """Run the cell for at most ``steps`` physics steps; ends early when the job is done or a guard stops it.

    Args:
        cell: The cell.
        recorder: Buffers, at least ``steps`` long.
        law: Compiled control law (pointers to context, measurement, target, twist).
        draws: Standard normal numbers, shape (steps, 12).
        steps: Number of steps.
    """
    engine, status = cell.engine, cell.status
    m, target = measurement_of(cell.measurement), target_of(cell.target)
    jacobian = np.empty((6, 6))
    recorder.filled[:] = 0
    for k in range(steps):
        count = int(status[CLOCK])
        t = count * engine.dt
        mj_step1(engine.model, engine.data)
        _press(cell)
        _sense(cell, m, jacobian, t, draws[k])
        if count % cell.control_every == 0:
            dt = engine.dt * cell.control_every
            m.clock[0], m.clock[1] = t, dt
            _tare(cell, m)
            found = advance_sequence(cell.job, cell.sequence, m.wrench[2], dt, target)
            law(cell.context.ctypes, cell.measurement.ctypes, cell.target.ctypes, cell.twist.ctypes)
            status[REQUESTS] += 1.0
            if not found:
                status[STOP] = MISSING
            for i in range(6):
                if not math.isfinite(cell.twist[i]):
                    status[STOP] = CONTROLLER_NAN
        if status[STOP] == 0.0 and not _drive(cell, jacobian):
            status[STOP] = JOINT_LIMIT
        _record(cell, recorder, m, target, count, t)
        mj_step2(engine.model, engine.data)
        record_reading(recorder, count, engine.sensordata, engine.qfrc_actuator)
        status[CLOCK] += 1.0
        if not math.isfinite(engine.qvel[0] + engine.qvel[6]):
            status[STOP] = UNSTABLE
        elif status[STOP] == 0.0:
            status[STOP] = check_guards(
                cell.guards, m, target, cell.sensor_state, cell.speedl_state.clock[2], cell.part.field,
                cell.part.rotation, cell.part.position, engine.xpos, engine.xmat, t, count, engine.dt,
            )  # fmt: skip
        if cell.sequence.stage[0] == DONE:
            status[ARRIVED] = 1.0
        if status[STOP] != 0.0 or status[ARRIVED] != 0.0:
            return


@njit(cache=True, error_model="numpy", forceinline=True)
def _press(cell: CellKernel) -> None:
    """Contact of the pad at this instant, applied to the head; the exact wrench at the tool point."""
    if cell.job.contact == 0.0:
        return
    e = cell.engine
    center = e.site_xpos[e.pad_site]
    R_base_pad = e.site_xmat[e.pad_site].reshape((3, 3))
    tool = e.site_xpos[e.tool_site]
    R_base_tool = e.site_xmat[e.tool_site].reshape((3, 3))
    velocity, force, torque = cell.scratch[0], cell.scratch[1], cell.scratch[2]
    turning = e.cvel[e.head_body, 0:3]
    com = e.subtree_com[e.root_body]
    rx, ry, rz = center[0] - com[0], center[1] - com[1], center[2] - com[2]
    velocity[0] = e.cvel[e.head_body, 3] + turning[1] * rz - turning[2] * ry
    velocity[1] = e.cvel[e.head_body, 4] + turning[2] * rx - turning[0] * rz
    velocity[2] = e.cvel[e.head_body, 5] + turning[0] * ry - turning[1] * rx
    press_pad(cell.pad, cell.part, cell.spin, R_base_pad, center, velocity, turning, force, torque)
    applied = e.xfrc_applied[e.head_body]
    applied[0:3] = force
    _moment_at(force, torque, center, e.xipos[e.head_body], applied[3:6])
    moment = cell.scratch[3]
    _moment_at(force, torque, center, tool, moment)
    for i in range(3):
        cell.wrench[i] = -(R_base_tool[0, i] * force[0] + R_base_tool[1, i] * force[1] + R_base_tool[2, i] * force[2])
        cell.wrench[3 + i] = -(
            R_base_tool[0, i] * moment[0] + R_base_tool[1, i] * moment[1] + R_base_tool[2, i] * moment[2]
        )


@njit(cache=True, error_model="numpy")
def _moment_at(force: Array, torque: Array, old_point: Array, new_point: Array, out: Array) -> None:
    """Move a torque from one reference point to another."""
    rx, ry, rz = old_point[0] - new_point[0], old_point[1] - new_point[1], old_point[2] - new_point[2]
    out[0] = torque[0] + ry * force[2] - rz * force[1]
    out[1] = torque[1] + rz * force[0] - rx * force[2]
    out[2] = torque[2] + rx * force[1] - ry * force[0]


@njit(cache=True, error_model="numpy", forceinline=True)
def _sense(cell: CellKernel, m: Measurement, jacobian: Array, t: float, draws: Array) -> None:
    """Encoders and wrist sensor; the engine's reading belongs to the step before, one step of the latency."""
    e = cell.engine
    tool = e.site_xpos[e.tool_site]
    m.position[:] = tool
    m.rotation[:] = e.site_xmat[e.tool_site].reshape((3, 3))
    m.twist[:] = 0.0
    for j in range(6):
        axis, anchor = e.xaxis[j], e.xanchor[j]
        rx, ry, rz = tool[0] - anchor[0], tool[1] - anchor[1], tool[2] - anchor[2]
        jacobian[0, j] = axis[1] * rz - axis[2] * ry
        jacobian[1, j] = axis[2] * rx - axis[0] * rz
        jacobian[2, j] = axis[0] * ry - axis[1] * rx
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = axis[0], axis[1], axis[2]
        for i in range(6):
            m.twist[i] += jacobian[i, j] * e.qvel[j]
    sample_sensor(cell.sensor, cell.sensor_state, t, e.sensordata, draws)
    tool_wrench(cell.payload, cell.sensor_state, m.rotation, m.wrench)


@njit(cache=True, error_model="numpy", forceinline=True)
def _tare(cell: CellKernel, m: Measurement) -> None:
    """Zero the sensor: average the compensated wrench while the robot stands still, then subtract it."""
    stage = cell.sequence.stage
    if stage[0] != TARE or stage[1] < TARE_START:
        return
    cell.status[TARES] += 1.0
    n = cell.status[TARES]
    for i in range(6):
        uncorrected = m.wrench[i] + cell.sensor_state.tare[i]
        cell.sensor_state.tare[i] += (uncorrected - cell.sensor_state.tare[i]) / n


@njit(cache=True, error_model="numpy", forceinline=True)
def _drive(cell: CellKernel, jacobian: Array) -> bool:
    """The robot's side: latency, acceleration limits, joint speeds, servos."""
    e, state = cell.engine, cell.speedl_state
    pass_request(cell.speedl, state, cell.twist, cell.status[REQUESTS], e.dt)
    limit_acceleration(cell.speedl, state, e.dt)
    inside = resolve_joints(cell.speedl, state, jacobian, e.dt)
    for j in range(6):
        e.ctrl[2 * j] = state.joints[j]
        e.ctrl[2 * j + 1] = state.speeds[j]
    return inside


@njit(cache=True, error_model="numpy", forceinline=True)
def _record(cell: CellKernel, recorder: Recorder, m: Measurement, target: Target, count: int, t: float) -> None:
    e, status = cell.engine, cell.status
    stage = cell.sequence.stage[0]
    if cell.wrench[2] > FIRST_CONTACT_N:
        status[TOUCHED] = 1.0
    phase = 0.0
    if stage == PROCESS:
        phase = 2.0
    elif stage in (RETRACT, DONE):
        phase = 3.0
    elif status[TOUCHED] > 0.0 and stage in (APPROACH, SEEK, TOUCH_DOWN):
        phase = 1.0
    turn = cell.job.process.pass_index[cell.sequence.row[0]]
    record_state(
        recorder, count, t, phase, e.qpos, e.qvel, m, target, cell.wrench, cell.speedl_state.twist, e.qpos[6], turn
    )  # fmt: skip
