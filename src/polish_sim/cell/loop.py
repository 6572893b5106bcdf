"""The control loop of one robot, and its steps: contact, sense, target, control, command, step, record.

The order decides stability: contact and sensor use positions and velocities of the same instant (after
``mj_step1``); from poses of the previous instant the contact would feed energy in.
"""

from __future__ import annotations

import math

from polish_sim.arrays import Array
from polish_sim.cell import guards
from polish_sim.cell.contact import hold_force, press_pad, pull_of_imbalance, turn_spindle
from polish_sim.cell.engine import (
    EngineViews,
    correct_reading,
    keep_speeds,
    links_touch,
    mj_step1,
    mj_step2,
)
from polish_sim.cell.gears import (
    RealArm,
    compensate,
    drive_joints,
    follow_rotors,
    hear_joints,
    host_hears,
    read_encoders,
)
from polish_sim.cell.kernel import CellKernel, CellState, Lesson, Status
from polish_sim.cell.real_part import move_part
from polish_sim.cell.recorder import Recorder, record_reading, record_state
from polish_sim.cell.robot import (
    SENT,
    STANDING,
    limit_acceleration,
    pass_request,
    resolve_joints,
    steer_stop,
)
from polish_sim.cell.stroke import (
    APPROACH,
    DONE,
    FEEDING,
    RETRACT,
    SEEK,
    TARE,
    TARE_START,
    TOUCH_DOWN,
    TRAVEL,
    advance_sequence,
)
from polish_sim.cell.wrist_sensor import sample_sensor, tool_wrench
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Vector, cross, dot, kernel, matvec, minus, plus_cross, scaled, set_to
from polish_sim.log import APPROACH_PHASE, PROCESS_PHASE, RETRACT_PHASE, TOUCH_PHASE

LOOK_EVERY = 4  # steps between looks at the engine's own contacts
FIRST_CONTACT_N = 0.5  # exact force at which the log's touch-down begins


# Without reference counts: nothing is allocated in the loop, and counting the tuples' arrays cost half of it.
@njit(nogil=True, _nrt=False)
def advance(cell: CellKernel, arm: RealArm, recorder: Recorder, draws: Array, steps: int) -> None:
    """Run the cell for at most ``steps`` physics steps, or until the caller is needed.

    That is when the stroke is done, a guard has tripped, the robot stands after a stop, at first contact if
    it is waited for, or, between measurement and law, from ``status.wait_from`` steps on. ``arm``: its
    joints. The recorder holds at least ``steps`` steps; ``draws`` are standard normal numbers, shape
    (steps, 12).
    """
    e, state = cell.engine, cell.state
    status = state.status
    recorder.filled.rows = recorder.filled.steps = 0
    for k in range(steps):
        t = status.steps * e.dt
        due = status.waiting
        if not status.waiting:
            mj_step1(e.model, e.data)
            if cell.stroke.contact:
                move_part(state.motion, t, e.dt, cell.part.position)
                press_on_part(cell)
                if state.flange.share > 0.0:
                    hold_force(state.flange, e, state.target.force)
            see_as_host(arm, state, e)
            read_sensor(cell, t, draws[k])
            due, waited = host_is_due(arm, status, cell.control_every)
            if due:
                move_target(cell, waited, t)
                status.waiting = 0 < status.wait_from <= status.steps
                if status.waiting:
                    return
        status.waiting = False
        if due:
            ask_law(cell, t)
            feed_learned(state, cell.lesson)
        command(cell, t)
        finish_step(cell, arm, None, recorder, t)
        if is_over(cell, 0, t):
            return


# The steps of the loop; a loop of two robots has them as well.


@kernel
def press_on_part(cell: CellKernel) -> None:
    """Contact of the pad and pull of the imbalance at this instant, applied to the head; the exact contact
    wrench.

    Force and torque of the part on the pad about the pad's centre, base frame, are left in ``scratch[1:3]``.
    """
    e, state, part = cell.engine, cell.state, cell.part
    scratch = state.scratch
    wrench = state.wrench
    moving = state.motion.velocity
    head = e.head_body
    center, tool = e.site_xpos[e.pad_site], e.site_xpos[e.tool_site]
    turn_spindle(state.spindle, e.dt)
    R_base_pad = e.site_xmat[e.pad_site]
    velocity, force, torque, moment, turning_on = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    turning, com = e.cvel[head, 0:3], e.subtree_com[e.root_body]
    gliding = minus(plus_cross(e.cvel[head, 3:6], turning, minus(center, com)), moving)
    # Of the pad against the part, which may turn as well.
    spin = state.motion.turning
    set_to(velocity, minus(gliding, cross(spin, minus(center, part.position))))
    set_to(turning_on, minus(turning, spin))
    state.guards.pressed = press_pad(
        cell.pad, part, state.spindle.speed, R_base_pad, center, velocity, turning_on, force, torque
    )
    applied = e.xfrc_applied[head]
    set_to(applied, force)
    moment_at(force, torque, center, e.xipos[head], applied[3:6])
    moment_at(force, torque, center, tool, moment)
    R_tool_base = e.site_xmat[e.tool_site].T
    set_to(wrench[0:3], scaled(-1.0, matvec(R_tool_base, force)))
    set_to(wrench[3:6], scaled(-1.0, matvec(R_tool_base, moment)))
    pull_of_imbalance(state.spindle, e.xmat[head], applied)


@kernel
def moment_at(force: Vector, torque: Vector, old_point: Array, new_point: Array, out: Array) -> None:
    """Move a torque from one reference point to another."""
    set_to(out, plus_cross(torque, minus(old_point, new_point), force))


@kernel
def see_tool(state: CellState, tool: Array, R: Array, anchors: Array, axes: Array, speeds: Array) -> None:
    """Write tool pose and twist as the host computes them from the encoders, and the Jacobian at the tool
    point.

    ``tool`` (3,) [m] is the tool point, ``R`` (3, 3) R_base_tool; ``anchors`` [m] and unit ``axes``
    (>= 6, 3) are those of the joints, ``speeds`` (>= 6,) theirs [rad/s].
    """
    m, jacobian = state.measurement, state.jacobian
    set_to(m.position, tool)
    for i in range(3):
        set_to(m.rotation[i], R[i])
    for i in range(6):
        m.twist[i] = 0.0
    for j in range(6):
        set_to(jacobian[:, j], cross(axes[j], minus(tool, anchors[j])))
        set_to(jacobian[3:, j], axes[j])
        for i in range(6):
            m.twist[i] += jacobian[i, j] * speeds[j]


@kernel
def see_as_host(arm: RealArm, state: CellState, e: EngineViews) -> None:
    """What the host sees of the tool: exactly where joints are rigid, else what it computes from the encoders
    and its own table."""
    see_tool(state, e.site_xpos[e.tool_site], e.site_xmat[e.tool_site], e.xanchor, e.xaxis, e.qvel)
    m = state.measurement
    arm.tool_speed = math.sqrt(dot(m.twist, m.twist))
    if not arm.elastic:
        return
    hear_joints(arm, e)
    compensate(arm, arm.host, e, m, 1.0)
    read_encoders(arm.host, arm.links)
    for j in range(6):
        for i in range(3):
            arm.host.axes[j, i] *= arm.slope[j]  # so that the Jacobian is that of the encoders
    see_tool(state, arm.host.place, arm.host.turn, arm.host.anchors, arm.host.axes, arm.read_speed)


@kernel
def read_sensor(cell: CellKernel, t: float, draws: Array) -> None:
    """The wrench as the host has it, and whether the reading can be trusted; arguments as of
    ``sample_sensor``."""
    state = cell.state
    sample_sensor(state.sensor, cell.samples, t, cell.engine.sensordata, draws)
    tool_wrench(state.payload, state.sensor, state.measurement.rotation, state.measurement.wrench)
    if state.status.stop == guards.NO_STOP:
        trip(state.status, guards.check_reading(state, cell.engine.dt, t), t)


@kernel
def host_is_due(arm: RealArm, status: Status, every: int) -> tuple[bool, int]:
    """Whether the host acts at this step, and the steps since it last did; its cycle is ``every`` steps."""
    due = status.stop == guards.NO_STOP and status.steps % every == 0
    if not arm.elastic:
        return due, every
    due = host_hears(arm, due, status.steps)
    return due, arm.waited


@kernel
def trip(status: Status, code: int, t: float) -> None:
    """Latch a protective stop, if there is a reason for one: the first stays."""
    if code != guards.NO_STOP and status.stop == guards.NO_STOP:
        status.stop, status.stop_time = code, t


@kernel
def move_target(cell: CellKernel, steps: int, t: float) -> None:
    """The host's cycle up to its law: zero the sensor while it is time, move the target on by a cycle, which
    takes ``steps``."""
    state = cell.state
    m, sequence = state.measurement, state.sequence
    m.time, m.cycle = t, cell.engine.dt * steps
    if sequence.stage == TARE:
        if sequence.time >= TARE_START:
            _tare(state, m.wrench)
        else:
            state.status.tares, state.status.spread = 0, 0.0
    if not advance_sequence(cell.stroke, sequence, m, state.answer.feed, state.target, state.guards.offset):
        trip(state.status, guards.MISSING, t)


@kernel
def _tare(state: CellState, wrench: Array) -> None:
    """Zero the sensor: running mean of the compensated wrench while the robot stands still, and its noise."""
    status = state.status
    status.tares += 1
    n = status.tares
    for i in range(6):
        state.sensor.tare[i] += wrench[i] / n
    if n > 1:
        status.spread += wrench[2] ** 2 * (n - 1.0) / n
        state.sequence.floor = 5.0 * math.sqrt(status.spread / (n - 1.0))


@kernel
def ask_law(cell: CellKernel, t: float) -> None:
    """Call the control law, and send its answer unless it is not finite or the host has fallen silent."""
    state, memory = cell.state, cell.law
    status, answer = state.status, state.answer
    memory.call(
        memory.context.ctypes, memory.course.ctypes, memory.measurement.ctypes, memory.target.ctypes,
        memory.answer.ctypes,
    )  # fmt: skip
    if status.poisoned:
        answer.twist[2] = math.nan
    finite = math.isfinite(answer.feed)
    for i in range(6):
        finite = finite and math.isfinite(answer.twist[i])
    if not finite:
        trip(status, guards.CONTROLLER_NAN, t)
    if status.python_error:
        trip(status, guards.CONTROLLER_ERROR, t)
    if status.stop == guards.NO_STOP and not status.mute:
        status.requests += 1


@kernel
def feed_learned(state: CellState, lesson: Lesson) -> None:
    """Add to the law's answer the motion along the tool's axis that an earlier run found necessary here."""
    t, answer = state.target, state.answer
    row = int((t.s + t.speed * lesson.lead) / lesson.spacing + 0.5)
    if t.contact and t.speed > 0.0 and row < lesson.slope.shape[0]:
        for i in range(3):
            answer.twist[i] += lesson.slope[row] * t.speed * state.measurement.rotation[i, 2]


@kernel
def command(cell: CellKernel, t: float) -> None:
    """The robot's part: the request that arrives now, or the protective stop; down to the joint servos."""
    state, ctrl, dt = cell.state, cell.engine.ctrl, cell.engine.dt
    status = state.status
    robot = state.speedl
    stop = state.stop
    firmness = 1.0
    if status.stop == guards.NO_STOP or stop.stage == SENT:
        pass_request(robot, cell.requests, state.answer.twist, status.requests, dt)
    if status.stop != guards.NO_STOP:
        firmness = steer_stop(stop, robot, state.measurement, not status.blocked, t - status.stop_time, t, dt)
    limit_acceleration(robot, dt, firmness)
    status.blocked = not resolve_joints(robot, state.jacobian, dt)
    if status.blocked:
        trip(status, guards.JOINT_LIMIT, t)
    for j in range(6):
        ctrl[2 * j] = robot.joints[j]
        ctrl[2 * j + 1] = robot.speeds[j]


@kernel
def finish_step(cell: CellKernel, arm: RealArm, other: RealArm | None, recorder: Recorder, t: float) -> None:
    """Note contact, record this instant ``t`` [s] and let the engine move on.

    ``arm`` and ``other``: joints of one robot and of a second, if there is one; then the errors recorded are
    those the host sees.
    """
    e, state = cell.engine, cell.state
    status, stage = state.status, state.sequence.stage
    if stage == TRAVEL:
        status.touched = False
    elif state.wrench[2] > FIRST_CONTACT_N:
        status.touched = True
        if status.contact_time == 0.0:
            status.contact_time = t
    phase = RETRACT_PHASE if status.stop != guards.NO_STOP else _phase(stage, status.touched)
    m, tool = state.measurement, e.tool_site
    if other is None:
        record_state(recorder, cell, e.site_xpos[tool], e.site_xmat[tool], arm.tool_speed, t, phase)
    else:
        record_state(recorder, cell, m.position, m.rotation, math.sqrt(dot(m.twist, m.twist)), t, phase)
    keep_speeds(e)
    drive_joints(arm, e, t)
    if other is not None:
        drive_joints(other, e, t)
    mj_step2(e.model, e.data)
    correct_reading(e)
    follow_rotors(arm, e)
    if other is not None:
        follow_rotors(other, e)
    record_reading(recorder, status.steps, e.sensordata, e.qfrc_actuator)
    status.steps += 1


@kernel
def _phase(stage: int, touched: bool) -> int:
    """The log's phase: touch-down begins with the exact first contact, everything else with the host's
    stage."""
    if stage == FEEDING:
        return PROCESS_PHASE
    if stage in (RETRACT, DONE):
        return RETRACT_PHASE
    return TOUCH_PHASE if touched and stage in (APPROACH, SEEK, TOUCH_DOWN) else APPROACH_PHASE


@kernel
def is_over(cell: CellKernel, free_body: int, t: float) -> bool:
    """Ask the guards; whether the run or the stroke ends with the step just finished, at ``t`` [s].

    Besides the head our own contact acts on ``free_body``, 0 for none: the engine may push on it.
    """
    state, e = cell.state, cell.engine
    status, count = state.status, state.status.steps - 1
    if not math.isfinite(e.qvel[0] + e.qvel[6]):
        status.stop, status.stop_time, status.ended = guards.UNSTABLE, t, True
    elif status.stop == guards.NO_STOP and count % LOOK_EVERY == 0 and links_touch(e, e.head_body, free_body):
        trip(status, guards.ENGINE_CONTACT, t)
    elif status.stop == guards.NO_STOP:
        trip(status, guards.check_guards(cell, count), t)
    if status.stop != guards.NO_STOP:
        status.ended = status.ended or state.stop.stage == STANDING
    elif state.sequence.stage == DONE:
        status.arrived = True
    just_touched = status.pause_at_contact and status.contact_time == t
    just_stopped = status.stop != guards.NO_STOP and status.stop_time == t
    return status.ended or status.arrived or just_touched or just_stopped
