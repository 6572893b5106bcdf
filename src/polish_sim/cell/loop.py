"""The control loop, written once: contact, sense, target, control, command, step, record.

The order decides stability: contact and sensor use positions and velocities of the same instant (after
``mj_step1``); from poses of the previous instant the contact would feed energy in.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell.carrier import add_carried_speed, carry_part, carry_target, drive_carrier, see_tool
from polish_sim.cell.contact import SPIN, press_pad, pull_of_imbalance, turn_spindle
from polish_sim.cell.guards import CONTROLLER_ERROR, CONTROLLER_NAN, ENGINE_CONTACT, JOINT_LIMIT, MISSING, UNSTABLE
from polish_sim.cell.host_arm import HostArm, read_encoders
from polish_sim.cell.kernel import (
    ARRIVED,
    BLOCKED,
    CLOCK,
    CONTACT_TIME,
    ENDED,
    MUTE,
    PAUSE,
    POISON,
    PYTHON_ERROR,
    REQUESTS,
    SPREAD,
    STOP,
    STOP_TIME,
    TARES,
    TOUCHED,
    CellKernel,
    EngineViews,
    mj_step1,
    mj_step2,
)
from polish_sim.cell.protective_stop import SENT, STAGE, STANDING, steer_stop
from polish_sim.cell.real_part import move_part
from polish_sim.cell.recorder import Recorder, record_reading, record_state
from polish_sim.cell.speedl import SpeedlState, limit_acceleration, pass_request, resolve_joints
from polish_sim.cell.stroke import (
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
from polish_sim.cell.watch import check_guards, check_reading
from polish_sim.cell.wrist_sensor import sample_sensor, tool_wrench
from polish_sim.control.signals import Measurement, Target, measurement_of, target_of
from polish_sim.kernel_cache import njit

# The inertia the wrist sensor feels is that of the motion that really happens.
#
# The engine's sensors are computed from its explicit acceleration; its implicit integrator then moves the robot by
# another, smaller one, because the servos damp strongly. From the first the tool would feel 1.4 times as heavy as it
# is.

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def keep_speeds(e: EngineViews) -> None:
    """Remember the joint speeds before the engine moves on."""
    for j in range(e.speeds_before.shape[0]):
        e.speeds_before[j] = e.qvel[j]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def correct_reading(e: EngineViews) -> None:
    """Add m (a - a_engine) of what the sensor carries to its exact reading, right after the engine's step.

    Spatial vectors are (angular; linear) about the tree's centre of mass, as the engine keeps them.
    """
    wx = wy = wz = vx = vy = vz = 0.0
    fx = fy = fz = tx = ty = tz = 0.0
    last = e.speeds_before.shape[0] - 1
    for j in range(last + 1):
        surplus = (e.qvel[j] - e.speeds_before[j]) / e.dt - e.qacc[j]
        d = e.cdof[j]
        wx, wy, wz = wx + surplus * d[0], wy + surplus * d[1], wz + surplus * d[2]
        vx, vy, vz = vx + surplus * d[3], vy + surplus * d[4], vz + surplus * d[5]
        if j < last - 1:
            continue
        # The last joint is the head's slide, the one before carries the housing.
        c = e.cinert[e.mount_body if j == last - 1 else e.head_body]
        tx += c[0] * wx + c[3] * wy + c[4] * wz + c[7] * vz - c[8] * vy
        ty += c[3] * wx + c[1] * wy + c[5] * wz + c[8] * vx - c[6] * vz
        tz += c[4] * wx + c[5] * wy + c[2] * wz + c[6] * vy - c[7] * vx
        fx += c[8] * wy - c[7] * wz + c[9] * vx
        fy += c[6] * wz - c[8] * wx + c[9] * vy
        fz += c[7] * wx - c[6] * wy + c[9] * vz
    R, p, com = e.site_xmat[e.sensor_site], e.site_xpos[e.sensor_site], e.subtree_com[e.root_body]
    rx, ry, rz = com[0] - p[0], com[1] - p[1], com[2] - p[2]
    tx, ty, tz = tx + ry * fz - rz * fy, ty + rz * fx - rx * fz, tz + rx * fy - ry * fx
    for i in range(3):
        e.sensordata[i] += R[i] * fx + R[3 + i] * fy + R[6 + i] * fz
        e.sensordata[3 + i] += R[i] * tx + R[3 + i] * ty + R[6 + i] * tz


# The part where it is at this instant, and the pad's contact with it on every body it acts on.


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def place_part(cell: CellKernel, t: float) -> None:
    """Place the part for this instant: where the flange of a robot that carries it is, and by its own motion."""
    e, flange = cell.engine, cell.carrier.flange_body
    if cell.carrier.present > 0.0:
        carry_part(
            cell.carrier, e.xmat[flange].reshape((3, 3)), e.xpos[flange], e.xanchor, e.xaxis, e.qpos, e.qvel,
            cell.part, cell.motion, e.dt,
        )  # fmt: skip
    move_part(cell.motion, t, e.dt, cell.part.position)
    if cell.carrier.present > 0.0:
        add_carried_speed(cell.carrier, e.xpos[flange], cell.part.position, cell.motion.velocity)
        slip = cell.scratch[0]
        for i in range(3):
            slip[i] = cell.part.position[i] - cell.motion.place[i]
        see_tool(cell.carrier, e.xmat[flange].reshape((3, 3)), e.xpos[flange], e.site_xpos[e.tool_site], slip)


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def press_on_part(cell: CellKernel) -> None:
    """Contact of the pad and pull of the imbalance at this instant, applied to the head; the exact contact wrench."""
    e, scratch, wrench, moving = cell.engine, cell.scratch, cell.wrench, cell.motion.velocity
    center, tool, head = e.site_xpos[e.pad_site], e.site_xpos[e.tool_site], e.head_body
    R_base_pad = e.site_xmat[e.pad_site].reshape((3, 3))
    velocity, force, torque, moment, turning_on = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    turning, com = e.cvel[head, 0:3], e.subtree_com[e.root_body]
    rx, ry, rz = center[0] - com[0], center[1] - com[1], center[2] - com[2]
    velocity[0] = e.cvel[head, 3] + turning[1] * rz - turning[2] * ry - moving[0]
    velocity[1] = e.cvel[head, 4] + turning[2] * rx - turning[0] * rz - moving[1]
    velocity[2] = e.cvel[head, 5] + turning[0] * ry - turning[1] * rx - moving[2]
    # Of the pad against the part, which may turn as well.
    spin, origin = cell.motion.turning, cell.part.position
    rx, ry, rz = center[0] - origin[0], center[1] - origin[1], center[2] - origin[2]
    velocity[0] -= spin[1] * rz - spin[2] * ry
    velocity[1] -= spin[2] * rx - spin[0] * rz
    velocity[2] -= spin[0] * ry - spin[1] * rx
    for i in range(3):
        turning_on[i] = turning[i] - spin[i]
    press_pad(cell.pad, cell.part, cell.spindle.state[SPIN], R_base_pad, center, velocity, turning_on, force, torque)
    _moment_at(force, torque, center, e.xipos[head], moment)
    for i in range(3):
        e.xfrc_applied[head, i] = force[i]
        e.xfrc_applied[head, 3 + i] = moment[i]
    if cell.carrier.present > 0.0:
        held = cell.carrier.part_body
        _moment_at(force, torque, center, e.xipos[held], moment)
        for i in range(3):
            e.xfrc_applied[held, i] = -force[i]
            e.xfrc_applied[held, 3 + i] = -moment[i]
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


LOOK_EVERY = 4  # steps between looks at the engine's own contacts
FIRST_CONTACT_N = 0.5  # exact force at which the log's touch-down begins


# Without reference counts: nothing is allocated in the loop, and counting the tuples' hundred arrays cost half of it.
@njit(cache=True, error_model="numpy", _nrt=False)
def advance(cell: CellKernel, recorder: Recorder, law, draws: Array, steps: int) -> None:  # type: ignore[no-untyped-def]
    """Run the cell for at most ``steps`` physics steps; or to where the caller has a look: the job is done, a guard
    spoke, the robot stands after a stop, first contact if it is waited for.

    Args:
        cell: The cell.
        recorder: Buffers, at least ``steps`` long.
        law: Compiled control law (pointers to context, measurement, target, twist).
        draws: Standard normal numbers, shape (steps, 12).
        steps: Number of steps.
    """
    engine, status = cell.engine, cell.status
    m, target = measurement_of(cell.measurement), target_of(cell.target)
    jacobian = cell.jacobian
    recorder.filled[:] = 0
    for k in range(steps):
        count = int(status[CLOCK])
        t = count * engine.dt
        mj_step1(engine.model, engine.data)
        if cell.job.contact > 0.0 or cell.carrier.present > 0.0:
            place_part(cell, t)
        if cell.job.contact > 0.0:
            turn_spindle(cell.spindle, engine.dt)
            press_on_part(cell)
        _see(engine, cell.host_arm, m, jacobian)
        sample_sensor(cell.sensor, cell.sensor_state, t, engine.sensordata, draws[k])
        tool_wrench(cell.payload, cell.sensor_state, m.rotation, m.wrench)
        if status[STOP] == 0.0:
            _stop(status, check_reading(cell, t), t)
        if status[STOP] == 0.0 and count % cell.control_every == 0:
            if not _look_ahead(cell, m, target, t):
                _stop(status, MISSING, t)
            if cell.carrier.present > 0.0:
                carry_target(cell.carrier, target)
            law(cell.context.ctypes, cell.measurement.ctypes, cell.target.ctypes, cell.twist.ctypes)
            _take_answer(cell, t)
        _command(cell, m, jacobian, t)
        _note_contact(cell, t)
        phase = 3.0 if status[STOP] != 0.0 else _phase(cell.sequence.stage[0], status[TOUCHED])
        turn = cell.job.process.pass_index[cell.sequence.row[0]]
        record_state(
            recorder, count, t, phase, engine.qpos, engine.qvel, m, target, cell.wrench, cell.speedl_state.twist,
            engine.qpos[6], turn, cell.motion.rest, cell.part.position, cell.spindle.state[SPIN],
            cell.carrier.tool_on_part, engine.site_xpos[engine.tool_site],
            engine.site_xmat[engine.tool_site].reshape((3, 3)),
        )  # fmt: skip
        keep_speeds(engine)
        mj_step2(engine.model, engine.data)
        correct_reading(engine)
        record_reading(recorder, count, engine.sensordata, engine.qfrc_actuator)
        status[CLOCK] += 1.0
        if _is_over(cell, m, target, count, t):
            return


@njit(cache=True, error_model="numpy", forceinline=True)
def _stop(status: Array, code: float, t: float) -> None:
    """Latch a protective stop, if there is a reason for one: the first stays."""
    if code != 0.0 and status[STOP] == 0.0:
        status[STOP], status[STOP_TIME] = code, t


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _look_ahead(cell: CellKernel, m: Measurement, target: Target, t: float) -> bool:
    """The host's cycle up to its law: zero the sensor while it is time, move the target on; False without contact."""
    dt, stage, status = cell.engine.dt * cell.control_every, cell.sequence.stage, cell.status
    m.clock[0], m.clock[1] = t, dt
    if stage[0] == TARE:
        if stage[1] >= TARE_START:
            _tare(cell, m.wrench)
        else:
            status[TARES] = status[SPREAD] = 0.0
    return bool(advance_sequence(cell.job, cell.sequence, m.wrench[2], cell.twist[6], dt, target))


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _take_answer(cell: CellKernel, t: float) -> None:
    """Send what the law answered, unless it is no number or the host has fallen silent."""
    if cell.status[POISON] != 0.0:
        cell.twist[2] = math.nan
    for i in range(7):
        if not math.isfinite(cell.twist[i]):
            _stop(cell.status, CONTROLLER_NAN, t)
    if cell.status[PYTHON_ERROR] != 0.0:
        _stop(cell.status, CONTROLLER_ERROR, t)
    if cell.status[STOP] == 0.0 and cell.status[MUTE] == 0.0:
        cell.status[REQUESTS] += 1.0


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _command(cell: CellKernel, m: Measurement, jacobian: Array, t: float) -> None:
    """The robot's part: the request that arrives now, or the protective stop; down to the joint servos."""
    status, robot, dt, firmness = cell.status, cell.speedl_state, cell.engine.dt, 1.0
    if status[STOP] == 0.0 or cell.stop.state[STAGE] == SENT:
        pass_request(cell.speedl, robot, cell.twist, status[REQUESTS], dt)
    if status[STOP] != 0.0:
        firmness = steer_stop(cell.stop, robot, m, status[BLOCKED] == 0.0, t - status[STOP_TIME], t, dt)
    limit_acceleration(cell.speedl, robot, dt, firmness)
    status[BLOCKED] = 0.0 if resolve_joints(cell.speedl, robot, jacobian, dt) else 1.0
    if status[BLOCKED] != 0.0:
        _stop(status, JOINT_LIMIT, t)
    _drive(robot, cell.engine.ctrl)
    if cell.carrier.present > 0.0:
        # The stop reaches both robots at once, by its own line.
        stopping = status[STOP] != 0.0 and cell.stop.state[STAGE] != SENT
        drive_carrier(cell.carrier, cell.sequence.stage[0] == PROCESS, stopping, dt, cell.engine.ctrl)


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _note_contact(cell: CellKernel, t: float) -> None:
    """Note the exact first contact of the stroke, and of the run."""
    if cell.sequence.stage[0] == TRAVEL:
        cell.status[TOUCHED] = 0.0
    elif cell.wrench[2] > FIRST_CONTACT_N:
        cell.status[TOUCHED] = 1.0
        if cell.status[CONTACT_TIME] == 0.0:
            cell.status[CONTACT_TIME] = t


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _is_over(cell: CellKernel, m: Measurement, target: Target, count: int, t: float) -> bool:
    """Ask the guards; whether the run or the stroke ends with this step."""
    status, e = cell.status, cell.engine
    if not math.isfinite(e.qvel[0] + e.qvel[6]):
        status[STOP], status[STOP_TIME], status[ENDED] = UNSTABLE, t, 1.0
    elif status[STOP] == 0.0 and count % LOOK_EVERY == 0 and _links_touch(e, cell.carrier.part_body):
        _stop(status, ENGINE_CONTACT, t)
    elif status[STOP] == 0.0:
        _stop(status, check_guards(cell, m, target, count), t)
    if status[STOP] != 0.0:
        status[ENDED] = max(status[ENDED], 1.0 if cell.stop.state[STAGE] == STANDING else 0.0)
    elif cell.sequence.stage[0] == DONE:
        status[ARRIVED] = 1.0
    just_touched = status[PAUSE] != 0.0 and status[CONTACT_TIME] == t
    just_stopped = status[STOP] != 0.0 and status[STOP_TIME] == t
    return status[ENDED] != 0.0 or status[ARRIVED] != 0.0 or just_touched or just_stopped


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _see(e: EngineViews, arm: HostArm, m: Measurement, jacobian: Array) -> None:
    """Tool pose and twist from the encoders, and the Jacobian at the tool point, as the host computes them."""
    if arm.present > 0.0:
        read_encoders(arm, e.qpos, 0)
        _move_tool(arm.place, arm.turn, arm.anchors, arm.axes, e.qvel, m, jacobian)
    else:
        _move_tool(e.site_xpos[e.tool_site], e.site_xmat[e.tool_site], e.xanchor, e.xaxis, e.qvel, m, jacobian)


@njit(cache=True, error_model="numpy", forceinline=True)
def _move_tool(
    tool: Array, R: Array, anchors: Array, axes: Array, speeds: Array, m: Measurement, jacobian: Array
) -> None:
    """Write pose, Jacobian and twist of a tool (3,), (9,) moved by joints about these axes, (>= 6, 3)."""
    for i in range(3):
        m.position[i] = tool[i]
        for j in range(3):
            m.rotation[i, j] = R[3 * i + j]
    for i in range(6):
        m.twist[i] = 0.0
    for j in range(6):
        ax, ay, az = axes[j, 0], axes[j, 1], axes[j, 2]
        rx, ry, rz = tool[0] - anchors[j, 0], tool[1] - anchors[j, 1], tool[2] - anchors[j, 2]
        jacobian[0, j], jacobian[1, j], jacobian[2, j] = ay * rz - az * ry, az * rx - ax * rz, ax * ry - ay * rx
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = ax, ay, az
        for i in range(6):
            m.twist[i] += jacobian[i, j] * speeds[j]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _tare(cell: CellKernel, wrench: Array) -> None:
    """Zero the sensor: running mean of the compensated wrench while the robot stands still, and its noise."""
    status = cell.status
    status[TARES] += 1.0
    n = status[TARES]
    for i in range(6):
        cell.sensor_state.tare[i] += wrench[i] / n
    if n > 1.0:
        status[SPREAD] += wrench[2] ** 2 * (n - 1.0) / n
        cell.sequence.floor[0] = 5.0 * math.sqrt(status[SPREAD] / (n - 1.0))


@njit(cache=True, error_model="numpy", forceinline=True)
def _drive(state: SpeedlState, ctrl: Array) -> None:
    """Position and speed to the joint servos."""
    for j in range(6):
        ctrl[2 * j] = state.joints[j]
        ctrl[2 * j + 1] = state.speeds[j]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def _links_touch(e: EngineViews, part_body: int) -> bool:
    """Whether the engine pushes on any body: on the head, and on a part that is carried, only our own contact does."""
    for body in range(1, e.cfrc_ext.shape[0]):
        f = e.cfrc_ext[body]
        if body != e.head_body and body != part_body and (f[3] != 0.0 or f[4] != 0.0 or f[5] != 0.0):
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
