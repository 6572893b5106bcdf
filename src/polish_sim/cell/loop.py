"""The control loop, written once: contact, sense, target, control, command, step, record (layer 8a).

The order decides stability: contact and sensor use positions and velocities of the same instant (after
``mj_step1``); from poses of the previous instant the contact would feed energy in.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.contact import press_pad
from polish_sim.cell.engine import mj_step1, mj_step2
from polish_sim.cell.guards import CONTROLLER_NAN, ENGINE_CONTACT, JOINT_LIMIT, MISSING, UNSTABLE, check_guards
from polish_sim.cell.kernel import ARRIVED, CLOCK, REQUESTS, STOP, TARES, TOUCHED, CellKernel, EngineViews
from polish_sim.cell.part_motion import move_part
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
    TRAVEL,
    advance_sequence,
)
from polish_sim.cell.speedl import SpeedlState, limit_acceleration, pass_request, resolve_joints
from polish_sim.cell.spindle import pull_of_imbalance, turn_spindle
from polish_sim.cell.wrist_sensor import SensorState, sample_sensor, tool_wrench
from polish_sim.control.signals import Measurement, measurement_of, target_of

Array = NDArray[np.float64]

LOOK_EVERY = 4  # steps between looks at the engine's own contacts
FIRST_CONTACT_N = 0.5  # exact force at which the log's touch-down begins


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
        if cell.job.contact > 0.0:
            move_part(cell.motion, t, engine.dt, cell.part.position)
            turn_spindle(cell.spindle, engine.dt)
            _press(cell)
        _see(engine, m, jacobian)
        sample_sensor(cell.sensor, cell.sensor_state, t, engine.sensordata, draws[k])
        tool_wrench(cell.payload, cell.sensor_state, m.rotation, m.wrench)
        if count % cell.control_every == 0:
            dt = engine.dt * cell.control_every
            m.clock[0], m.clock[1] = t, dt
            if cell.sequence.stage[0] == TARE and cell.sequence.stage[1] >= TARE_START:
                status[TARES] += 1.0
                _tare(cell.sensor_state, m.wrench, status[TARES])
            found = advance_sequence(cell.job, cell.sequence, m.wrench[2], cell.twist[6], dt, target)
            law(cell.context.ctypes, cell.measurement.ctypes, cell.target.ctypes, cell.twist.ctypes)
            status[REQUESTS] += 1.0
            if not found:
                status[STOP] = MISSING
            for i in range(7):
                if not math.isfinite(cell.twist[i]):
                    status[STOP] = CONTROLLER_NAN
        if status[STOP] == 0.0:
            pass_request(cell.speedl, cell.speedl_state, cell.twist, status[REQUESTS], engine.dt)
            limit_acceleration(cell.speedl, cell.speedl_state, engine.dt)
            if not resolve_joints(cell.speedl, cell.speedl_state, jacobian, engine.dt):
                status[STOP] = JOINT_LIMIT
            _drive(cell.speedl_state, engine.ctrl)
        if cell.sequence.stage[0] == TRAVEL:
            status[TOUCHED] = 0.0
        elif cell.wrench[2] > FIRST_CONTACT_N:
            status[TOUCHED] = 1.0
        phase = _phase(cell.sequence.stage[0], status[TOUCHED])
        turn = cell.job.process.pass_index[cell.sequence.row[0]]
        record_state(
            recorder, count, t, phase, engine.qpos, engine.qvel, m, target, cell.wrench, cell.speedl_state.twist,
            engine.qpos[6], turn, cell.motion.rest, cell.part.position, cell.spindle.state[1],
        )  # fmt: skip
        mj_step2(engine.model, engine.data)
        record_reading(recorder, count, engine.sensordata, engine.qfrc_actuator)
        status[CLOCK] += 1.0
        if not math.isfinite(engine.qvel[0] + engine.qvel[6]):
            status[STOP] = UNSTABLE
        elif status[STOP] == 0.0 and count % LOOK_EVERY == 0 and _links_touch(engine):
            status[STOP] = ENGINE_CONTACT
        elif status[STOP] == 0.0:
            status[STOP] = check_guards(
                cell.guards, m, target, cell.sensor_state, cell.speedl_state.clock[2], cell.part.coarse,
                cell.part.rotation, cell.part.position, engine.xpos, engine.xmat, t, count, engine.dt,
            )  # fmt: skip
        if cell.sequence.stage[0] == DONE:
            status[ARRIVED] = 1.0
        if status[STOP] != 0.0 or status[ARRIVED] != 0.0:
            return


@njit(cache=True, error_model="numpy", forceinline=True)
def _press(cell: CellKernel) -> None:
    """Contact of the pad and pull of the imbalance at this instant, applied to the head; the exact contact wrench."""
    e, scratch, wrench, moving = cell.engine, cell.scratch, cell.wrench, cell.motion.velocity
    center, tool, head = e.site_xpos[e.pad_site], e.site_xpos[e.tool_site], e.head_body
    R_base_pad = e.site_xmat[e.pad_site].reshape((3, 3))
    velocity, force, torque, moment = scratch[0], scratch[1], scratch[2], scratch[3]
    turning, com = e.cvel[head, 0:3], e.subtree_com[e.root_body]
    rx, ry, rz = center[0] - com[0], center[1] - com[1], center[2] - com[2]
    velocity[0] = e.cvel[head, 3] + turning[1] * rz - turning[2] * ry - moving[0]
    velocity[1] = e.cvel[head, 4] + turning[2] * rx - turning[0] * rz - moving[1]
    velocity[2] = e.cvel[head, 5] + turning[0] * ry - turning[1] * rx - moving[2]
    press_pad(cell.pad, cell.part, cell.spindle.state[1], R_base_pad, center, velocity, turning, force, torque)
    _moment_at(force, torque, center, e.xipos[head], moment)
    for i in range(3):
        e.xfrc_applied[head, i] = force[i]
        e.xfrc_applied[head, 3 + i] = moment[i]
    _moment_at(force, torque, center, tool, moment)
    R = e.site_xmat[e.tool_site]
    for i in range(3):
        wrench[i] = -(R[i] * force[0] + R[3 + i] * force[1] + R[6 + i] * force[2])
        wrench[3 + i] = -(R[i] * moment[0] + R[3 + i] * moment[1] + R[6 + i] * moment[2])
    pull_of_imbalance(cell.spindle, e.xmat[head], e.xfrc_applied[head])


@njit(cache=True, error_model="numpy", forceinline=True)
def _moment_at(force: Array, torque: Array, old_point: Array, new_point: Array, out: Array) -> None:
    """Move a torque from one reference point to another."""
    rx, ry, rz = old_point[0] - new_point[0], old_point[1] - new_point[1], old_point[2] - new_point[2]
    out[0] = torque[0] + ry * force[2] - rz * force[1]
    out[1] = torque[1] + rz * force[0] - rx * force[2]
    out[2] = torque[2] + rx * force[1] - ry * force[0]


@njit(cache=True, error_model="numpy", forceinline=True)
def _see(e: EngineViews, m: Measurement, jacobian: Array) -> None:
    """Tool pose and twist from the encoders, and the Jacobian at the tool point."""
    tool, R = e.site_xpos[e.tool_site], e.site_xmat[e.tool_site]
    for i in range(3):
        m.position[i] = tool[i]
        for j in range(3):
            m.rotation[i, j] = R[3 * i + j]
    for i in range(6):
        m.twist[i] = 0.0
    for j in range(6):
        ax, ay, az = e.xaxis[j, 0], e.xaxis[j, 1], e.xaxis[j, 2]
        rx, ry, rz = tool[0] - e.xanchor[j, 0], tool[1] - e.xanchor[j, 1], tool[2] - e.xanchor[j, 2]
        jacobian[0, j], jacobian[1, j], jacobian[2, j] = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = ax, ay, az
        for i in range(6):
            m.twist[i] += jacobian[i, j] * e.qvel[j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _tare(sensor: SensorState, wrench: Array, n: float) -> None:
    """Zero the sensor: running mean of the compensated wrench while the robot stands still."""
    for i in range(6):
        sensor.tare[i] += wrench[i] / n


@njit(cache=True, error_model="numpy", forceinline=True)
def _drive(state: SpeedlState, ctrl: Array) -> None:
    """Position and speed to the joint servos."""
    for j in range(6):
        ctrl[2 * j] = state.joints[j]
        ctrl[2 * j + 1] = state.speeds[j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _links_touch(e: EngineViews) -> bool:
    """Whether the engine pushes on any body: on the head only our own contact does."""
    for body in range(1, e.cfrc_ext.shape[0]):
        f = e.cfrc_ext[body]
        if body != e.head_body and (f[3] != 0.0 or f[4] != 0.0 or f[5] != 0.0):
            return True
    return False


@njit(cache=True, error_model="numpy", forceinline=True)
def _phase(stage: float, touched: float) -> float:
    """The log's phase: touch-down begins with the exact first contact, everything else with the host's stage."""
    if stage == PROCESS:
        return 2.0
    if stage in (RETRACT, DONE):
        return 3.0
    return 1.0 if touched > 0.0 and stage in (APPROACH, SEEK, TOUCH_DOWN) else 0.0
