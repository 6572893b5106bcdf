"""The arm in torque mode with a hand on its tool: sense, control, watch, pull, step, record."""

from __future__ import annotations

import copy
import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.cell.engine import (
    EngineViews,
    correct_reading,
    engine_views,
    keep_speeds,
    links_touch,
    mj_step1,
    mj_step2,
    register_engine,
)
from polish_sim.cell.gears import RealArm, follow_rotors, hear_joints, turn_rotors
from polish_sim.cell.observer import SILENT, Observer, interrupts_noted
from polish_sim.cell.real_arm import build_real_arm
from polish_sim.cell.scene import touching
from polish_sim.config import RealArmConfig
from polish_sim.errors import ReachError
from polish_sim.hand_guiding.law import (
    GUARDS,
    JOINT_END,
    TOUCH,
    UNSTABLE,
    Belief,
    GuidingGains,
    GuidingLimits,
    GuidingMemory,
    build_memory,
    fade_out,
    guide_by_hand,
    quantize_encoders,
    watch_guiding,
)
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    Matrix3,
    Record,
    Vector3,
    Vector6,
    cross,
    dot,
    kernel,
    minus,
    plus,
    plus_cross,
    scaled,
    set_to,
)

# The simulated hand: a spring and a damper between where it wants the tool and where the tool is.


class Hand(NamedTuple):
    """How firmly a hand holds the tool, in the base frame."""

    stiffness: float  #: [N/m]
    damping: float  #: [N s/m]
    turn_stiffness: float  #: [N m/rad]; 0: the tool may turn in it
    turn_damping: float  #: [N m s/rad]


class HandMotion(NamedTuple):
    """Where a hand wants the tool, one row a step."""

    positions: Array  #: Tool point, base frame [m], shape (n, 3)
    velocities: Array  #: [m/s], shape (n, 3)
    rotations: Array  #: Tool frame in the base frame, shape (n, 3, 3)
    grip: Array  #: 1 while it holds the tool, 0 while its hands are off, shape (n,)


@kernel
def tool_velocity(e: EngineViews, out: Array) -> None:
    """Velocity of the tool point, which moves with the housing, base frame [m/s], shape (3,)."""
    w = e.cvel[e.mount_body]
    arm = minus(e.site_xpos[e.tool_site], e.subtree_com[e.root_body])
    set_to(out, plus_cross(w[3:6], w, arm))


@kernel
def pull_by_hand(
    hand: Hand, motion: HandMotion, row: int, e: EngineViews, velocity: Array, force: Array
) -> None:
    """Apply the hand's pull to the housing, between tool and wrist sensor.

    ``row``: this step; ``velocity``: of the tool point [m/s]; ``force``, written: the hand's on the tool,
    base frame [N].
    """
    grip = motion.grip[row]
    tool = e.site_xpos[e.tool_site]
    applied = e.xfrc_applied[e.mount_body]
    lag = scaled(hand.stiffness, minus(motion.positions[row], tool))
    slow = scaled(hand.damping, minus(motion.velocities[row], velocity))
    set_to(force, scaled(grip, plus(lag, slow)))
    set_to(applied, force)
    turned = 0.0, 0.0, 0.0
    for axis in range(3):
        turned = plus(
            turned, scaled(0.5, cross(e.site_xmat[e.tool_site][:, axis], motion.rotations[row][:, axis]))
        )
    slow = scaled(hand.turn_damping, e.cvel[e.mount_body])
    turning = scaled(grip, minus(scaled(hand.turn_stiffness, turned), slow))
    set_to(applied[3:6], plus_cross(turning, minus(tool, e.xipos[e.mount_body]), force))


BRAKED_S = 0.5  #: After a protective stop the arm is braked and recorded for this long [s]
HOLD_RAD, HOLD_RAD_S, BRAKE_RAD_S = 0.04, 1.2, 1.0
"""Error and speed at which the holding servos, and speed at which the brakes, take all of a motor's
torque."""
TARE_HZ = 5.0
TARE_STEPS = 4.0  #: A tare smaller than the torque of this many encoder steps counts as zero


class GuidingRow(Record):
    """What is recorded of a physics step."""

    time: float  #: [s]
    q: Vector6  #: [rad]
    qd: Vector6  #: [rad/s]
    read: Vector6  #: Joint angles by the encoders [rad]
    torque: Vector6  #: Of the motors [N m]
    tool: Vector3  #: Tool point, base frame [m]
    R_base_tool: Matrix3
    speed: float  #: Of the tool point [m/s]
    force: Vector3  #: The hand's on the tool, base frame [N]
    raw: Vector6  #: Reading of the wrist sensor [N, N m]
    lent: float  #: Energy the compensation has lent [J]


class _Status(Record):
    step: int  #: Steps taken
    stop: int  #: Code of the protective stop, 0 before
    stop_step: int


class GuidingRun(NamedTuple):
    """What happened, one row a physics step."""

    rows: NDArray[Any]  #: Records of `GuidingRow`, shape (n,)
    stop_reason: str | None
    stop_step: int
    interrupted: bool
    lent_j: float  #: Most energy the compensation had lent [J]


class _Kernel(NamedTuple):
    engine: EngineViews
    belief: Belief
    gains: GuidingGains
    memory: GuidingMemory
    limits: GuidingLimits
    hand: Hand
    motion: HandMotion
    servos: Array  #: 1 while the servos hold, 0 when they have released it, shape (n,)
    start: Array  #: Joint angles the servos hold [rad], shape (6,)
    ranges: Array  #: Joint ranges [rad], shape (6, 2)
    scratch: Array  #: Work array, shape (2, 3)
    status: _Status


class GuidedArm(NamedTuple):
    """An arm in torque mode and who is on it."""

    model: mujoco.MjModel
    belief: Belief
    gains: GuidingGains
    limits: GuidingLimits
    hand: Hand
    elastic: RealArmConfig | None = None  #: Its joints, if they are
    seed: int = 0  #: Of their random numbers


def run_guided(
    arm: GuidedArm, q_start: Array, motion: HandMotion, servos: Array, observer: Observer = SILENT
) -> GuidingRun:
    """Let a hand guide the arm, up to the end, a protective stop or an interrupt.

    ``servos``: share of the holding servos, one a step; while they hold, what the model lacks is tared.
    Raises ReachError if links touch at the start.
    """
    register_engine()
    if arm.elastic:
        arm = arm._replace(model=copy.copy(arm.model))  # links and damping of the model become this run's
    data = mujoco.MjData(arm.model)
    data.qpos[:6] = q_start
    joints = build_real_arm(arm.elastic, arm.seed, arm.model, data, q_start) if arm.elastic else RealArm()
    mujoco.mj_forward(arm.model, data)
    if data.ncon:
        raise ReachError("the arm cannot be guided from here: its links touch. Choose another start.")
    kernel = _Kernel(
        engine_views(arm.model, data), arm.belief, arm.gains, build_memory(6), arm.limits, arm.hand, motion,
        servos, np.array(q_start), np.array(arm.model.jnt_range[arm.model.actuator_trnid[:6, 0]]),
        np.zeros((2, 3)), _Status(),
    )  # fmt: skip
    steps = len(servos)
    rows = np.zeros(steps, GuidingRow.dtype)
    pair = ""
    chunk = max(1, round(observer.frame_every_s / kernel.engine.dt))
    with interrupts_noted(observer) as interrupt:
        while kernel.status.step < steps and not interrupt.seen:
            last = min(int(kernel.status.step) + chunk, steps)
            _advance(kernel, joints, rows, last)
            if kernel.status.stop == TOUCH and not pair:
                # Half a second later, braked, they may be apart again.
                pair = touching(arm.model, data)
            observer.progress(float(kernel.status.step), float(steps))
            observer.frame(arm.model, data)
            if (
                kernel.status.stop
                and (kernel.status.step - kernel.status.stop_step) * kernel.engine.dt >= BRAKED_S
            ):
                break
    done = int(kernel.status.step)
    code = int(kernel.status.stop)
    reason = GUARDS[code] + (f": {pair}" if pair else "") if code else None
    return GuidingRun(rows[:done], reason, int(kernel.status.stop_step), interrupt.seen, arm.limits.lent.most)


@njit(_nrt=False)
def _advance(k: _Kernel, arm: RealArm, rows: NDArray[Any], last: int) -> None:
    """Run up to step ``last``; returns earlier when the arm stands after a stop or the simulation broke."""
    e = k.engine
    memory = k.memory
    status = k.status
    velocity = k.scratch[0]
    force = k.scratch[1]
    for step in range(status.step, last):
        mj_step1(e.model, e.data)
        tool_velocity(e, velocity)
        speed = math.sqrt(dot(velocity, velocity))
        if arm.elastic:
            hear_joints(arm, e)
            quantize_encoders(k.gains, memory, arm.read, e.dt, step == 0)
        else:
            quantize_encoders(k.gains, memory, e.qpos, e.dt, step == 0)
        granted = (1.0 - k.servos[step]) * fade_out(k.limits, memory.qd, speed)
        guide_by_hand(k.belief, k.gains, memory, granted, e.dt)
        if status.stop == 0:
            code = watch_guiding(k.limits, k.belief, k.gains, memory, speed, e.dt)
            if code == 0 and not math.isfinite(np.sum(e.qvel[:6])):
                code = UNSTABLE
            if code:
                status.stop = code
                status.stop_step = step
        if status.stop == 0:
            _hold(k, k.servos[step])
        else:
            _brake(k)
            k.motion.grip[step] = 0.0
        pull_by_hand(k.hand, k.motion, step, e, velocity, force)
        for j in range(6):
            e.ctrl[j] = memory.torque[j]
            arm.push[j] = memory.torque[j]
            arm.stiffened[j] = 0.0
        _record(k, rows[step], step, speed)
        keep_speeds(e)
        if arm.elastic:
            turn_rotors(arm, e, step * e.dt)
        mj_step2(e.model, e.data)
        follow_rotors(arm, e)
        correct_reading(e)
        for i in range(6):
            rows[step].raw[i] = e.sensordata[i]
        status.step = step + 1
        if status.stop == 0:
            code = _touches(e, k.ranges)
            if code:
                status.stop = code
                status.stop_step = step + 1
                return
        if status.stop == UNSTABLE or (status.stop and (step - status.stop_step) * e.dt >= BRAKED_S):
            return


@kernel
def _hold(k: _Kernel, share: float) -> None:
    """Servos that hold the start, and the tare: what law and servos together give beyond the model's
    gravity."""
    memory = k.memory
    for j in range(6):
        if share > 0.0:
            limit = k.belief.torque_limit[j]
            pull = limit * ((k.start[j] - memory.q[j]) / HOLD_RAD - memory.qd[j] / HOLD_RAD_S)
            if share == 1.0:
                missing = memory.torque[j] + pull - memory.weight[j]
                memory.tare[j] += 2.0 * math.pi * TARE_HZ * k.engine.dt * (missing - memory.tare[j])
            elif abs(memory.tare[j]) < TARE_STEPS * k.gains.encoder * limit / HOLD_RAD:
                memory.tare[j] = 0.0
            memory.torque[j] = min(max(memory.torque[j] + share * pull, -limit), limit)


@kernel
def _brake(k: _Kernel) -> None:
    """Hold the weight and brake."""
    memory = k.memory
    for j in range(6):
        limit = k.belief.torque_limit[j]
        wanted = memory.weight[j] + k.gains.tare * memory.tare[j] - limit * memory.qd[j] / BRAKE_RAD_S
        memory.torque[j] = min(max(wanted, -limit), limit)


@kernel
def _record(k: _Kernel, row: Any, step: int, speed: float) -> None:
    e = k.engine
    memory = k.memory
    R = e.site_xmat[e.tool_site]
    row.time = step * e.dt
    row.speed = speed
    row.lent = k.limits.lent.now
    for j in range(6):
        row.q[j] = e.qpos[j]
        row.qd[j] = e.qvel[j]
        row.torque[j] = memory.torque[j]
        row.read[j] = memory.q[j]
    set_to(row.tool, e.site_xpos[e.tool_site])
    set_to(row.force, k.scratch[1])
    for i in range(3):
        set_to(row.R_base_tool[i], R[i])


@kernel
def _touches(e: EngineViews, ranges: Array) -> int:
    """Code of links in contact or a joint at its end."""
    for j in range(6):
        if e.qpos[j] < ranges[j, 0] or e.qpos[j] > ranges[j, 1]:
            return JOINT_END
    return TOUCH if links_touch(e, e.mount_body, 0) else 0
