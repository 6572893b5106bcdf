"""A second robot that carries the part: the master of two.

Its joint servos play rows of joint angles. The part goes where its flange really is; the host works out where
the part should be from the master's encoders and from what calibration made it believe, and moves its target
along.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import mujoco
import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell.contact import RealPart
from polish_sim.cell.engine import EngineViews
from polish_sim.cell.gears import HostArm, build_host_arm, read_encoders
from polish_sim.cell.real_arm import ArmPlace
from polish_sim.cell.real_part import PartMotion
from polish_sim.cell.robot import brakes_of
from polish_sim.cell.stroke import BUILD_UP, LONGEST_RAMP
from polish_sim.config import RobotConfig, SafetyConfig
from polish_sim.control.signals import Target
from polish_sim.kernels import (
    Bundle,
    Matrix3,
    Record,
    Vector2,
    Vector3,
    Vector6,
    add_to,
    cross,
    dot,
    kernel,
    matvec,
    minus,
    plus,
    plus_cross,
    plus_matvec,
    scaled,
    set_to,
)
from polish_sim.motion.kinematics import NOMINAL
from polish_sim.motion.trajectory import blend_cubic
from polish_sim.spatial import inverse, transform

MASTER, FOLLOWER = "master_", "follower_"  #: What the names of the two robots in a scene begin with
#: Of the master's joints and controls: the follower, with its head, comes first
FIRST_JOINT, FIRST_CONTROL = 7, 12
MASTER_ARM, FOLLOWER_ARM = ArmPlace(FIRST_JOINT, FIRST_CONTROL, 1), ArmPlace()
RAMP_S = LONGEST_RAMP + BUILD_UP  # in which the master comes to its speed and back to rest, as a feed does
RAMP_PEAK = 1.0 / LONGEST_RAMP  # steepest rise of the rate at which its time passes [1/s]
# over which the host takes the master's accelerations, at least from one reading to the next [s]
SPAN_S = 0.01


def time_let_go(since: Array) -> tuple[Array, Array]:
    """What has passed of the time of the master's rows [s] after it was released from rest, (n,) [s], and the
    rate at which it passes [-]; see `drive_master`."""
    ramp = np.clip(since, 0.0, RAMP_S)
    return np.maximum(since - RAMP_S, 0.0) + _times(ramp), _rates(ramp)


def time_held(let_go: float, since: Array) -> tuple[Array, Array]:
    """How it passes after the master is held again, (n,) [s], having been released for a time [s]."""
    before = np.array([min(let_go, RAMP_S)])
    ramp = np.clip(before - since, 0.0, RAMP_S)
    return _times(before) - _times(ramp), _rates(ramp)


@kernel
def ramp_rate(t: float) -> float:
    """Rate [-] after a time in the ramp [s]: its rise is built up and taken back within ``BUILD_UP``."""
    early, late = max(t - BUILD_UP, 0.0), max(t - LONGEST_RAMP, 0.0)
    return (t * t - early * early - late * late) / (2.0 * BUILD_UP * LONGEST_RAMP)


@kernel
def ramp_time(t: float) -> float:
    """Integral of ``ramp_rate``: what has passed of the master's time by then [s]."""
    early, late = max(t - BUILD_UP, 0.0), max(t - LONGEST_RAMP, 0.0)
    return (t**3 - early**3 - late**3) / (6.0 * BUILD_UP * LONGEST_RAMP)


_rates, _times = (np.vectorize(compiled.py_func, otypes=[float]) for compiled in (ramp_rate, ramp_time))


class MasterRows(NamedTuple):
    """What the master's servos play, and what the host makes of it."""

    spacing: float  #: Time between rows [s]
    q: Array  #: Joint positions [rad], shape (n, 6)
    qd: Array  #: Joint speeds [rad/s], shape (n, 6)
    #: The work frame at the first row as it really is, nominal part, follower's base, (4, 4)
    T_base_work: Array
    #: True poses in the follower's base, moved by this, are what the host believes (4, 4)
    T_believed_true: Array
    table: Array = NOMINAL  #: The table the host computes the master with, shape (4, 6)
    gears: Array | float = 0.0  #: and its gears, see `build_host_arm`
    delay: float = 0.0  #: How late its joints reach the host [s]
    period: float = 0.0  #: Between two readings of them, held in between [s]; 0: at every step
    lead: float = 0.0  #: From the host's request to the follower's motion, as far as the host knows [s]

    @property
    def times(self) -> Array:
        """Of the rows [s], shape (n,)."""
        return self.spacing * np.arange(len(self.q), dtype=np.float64)


class Carrier(Record):
    """The master in the loop; base frame of the follower."""

    spacing: float  #: Time between rows [s]
    duration: float  #: Of all rows [s]
    clock: float  #: Time of the rows [s]
    ramp: float  #: How much of the ramp of its rate is done [s]
    rate: float  #: At which the time of the rows passes [-]
    pace: float  #: The rate the ramp ends at [-]
    silence: float  #: Time since the host last received the master's position [s]
    timeout: float  #: Longest silence before a protective stop [s]
    halted: bool  #: A fault: it has stopped itself
    unheard: bool  #: A fault: the host no longer receives its position
    slow: float  #: A fault: share of its speed it has lost [-]
    steps: int  #: Taken so far
    brakes: Vector2  #: Deceleration of a protective stop [m/s^2], [rad/s^2]
    flange_body: int
    part_body: int
    R_rest: Matrix3
    p_rest: Vector3  #: The flange at the first row, as the host computes it
    R_part: Matrix3
    p_part: Vector3  #: The real part on the flange
    R_work: Matrix3
    p_work: Vector3  #: The nominal work frame on the flange
    R_belief: Matrix3
    p_belief: Vector3  #: The host's belief: true poses, moved by this
    host_arm: HostArm  #: The master up to its flange as the host computes it
    velocity: Vector3  #: Of the flange now [m/s]
    turning: Vector3  #: Of the flange now [rad/s]
    delay: int  #: How late readings of the joints arrive, in steps
    hold: int  #: Steps from one reading to the next
    newest: int  #: Step of the newest reading that has come
    span: int  #: Steps over which the host takes accelerations
    lead: float  #: How far ahead the host predicts speeds [s]
    q: Vector6  #: Joint positions for now, as the host has them [rad]
    qd: Vector6  #: Joint speeds for when a request acts, as the host has them [rad/s]
    seen_velocity: Vector3  #: Of the flange as the host computes it from those [m/s]
    seen_turning: Vector3  #: Likewise [rad/s]
    R_moved: Matrix3
    p_moved: Vector3  #: How the part has moved since the first row, as the host believes
    #: The flange as the host believes, in rows: place [m], velocity [m/s], angular velocity [rad/s]
    believed: Matrix3
    work: Annotated[Array, (6, 3)]  #: Work array


class Master(Bundle):
    """The master in the loop, and its tables."""

    state: Carrier
    q: Array  #: Rows of joint positions [rad], shape (n, 6)
    qd: Array  #: Rows of joint speeds [rad/s], shape (n, 6)
    #: Joint positions [rad] and speeds [rad/s] on their way to the host, step by step, shape (k, 12)
    line: Array


def build_master(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    rows: MasterRows,
    part: RealPart,
    robot: RobotConfig,
    safety: SafetyConfig,
) -> Master:
    """The master at the first of its rows, holding the part as it lies at the start; ``data``: kinematics
    done."""
    flange = data.site(f"{MASTER}flange")
    T_flange_base = inverse(transform(flange.xmat.reshape(3, 3), flange.xpos))
    base = data.body(f"{MASTER}base")
    T_base = transform(base.xmat.reshape(3, 3), base.xpos)
    host_arm = build_host_arm(rows.table, T_base, np.eye(4), rows.gears)
    read_encoders.py_func(host_arm, rows.q[0])
    delay = round(rows.delay / model.opt.timestep)
    hold = max(round(rows.period / model.opt.timestep), 1)
    span = max(round(SPAN_S / (hold * model.opt.timestep)), 1) * hold
    poses = {
        "rest": transform(host_arm.turn, host_arm.place),
        "part": T_flange_base @ transform(part.rotation, part.position),
        "work": T_flange_base @ rows.T_base_work,
    }
    poses["belief"] = rows.T_believed_true
    poses["moved"] = np.eye(4)
    state = Carrier(
        **{f"R_{name}": T[:3, :3] for name, T in poses.items()},
        **{f"p_{name}": T[:3, 3] for name, T in poses.items()},
        spacing=rows.spacing,
        duration=rows.spacing * (len(rows.q) - 1),
        pace=1.0,
        brakes=brakes_of(robot, safety),
        timeout=safety.master_timeout_s,
        flange_body=model.body(f"{MASTER}link_6").id,
        part_body=model.body(f"{MASTER}part").id,
        host_arm=host_arm,
        delay=delay,
        hold=hold,
        span=span,
        lead=rows.lead,
    )
    gap = math.ceil(robot.real.missed_s / model.opt.timestep) if robot.elastic else 0
    line = np.zeros((delay + hold + span + gap + 1, 12))
    return Master(state, np.ascontiguousarray(rows.q), np.ascontiguousarray(rows.qd), line)


# The master at every step: its servos driven along their rows, the part carried, what the host makes of it.


@kernel
def drive_master(master: Master, going: bool, stopping: bool, dt: float, ctrl: Array) -> None:
    """Let the master's rows pass while it is ``going``, from rest and back to rest, and drive its joint
    servos.

    The rate at which their time passes rises and falls with limited jerk, as a feed does. When ``stopping``
    it falls as a protective stop brakes: the master keeps to its rows then as well.
    """
    state = master.state
    step = dt / RAMP_S
    state.pace += min(max(1.0 - state.slow - state.pace, -step), step)
    if stopping or state.halted:
        state.rate = max(state.rate - max(step, dt * state.rate * _firmness(state)), 0.0)
    else:
        left = state.duration - state.clock
        wanted = RAMP_S if going and left > state.pace * ramp_time(state.ramp) + dt else 0.0
        state.ramp += min(max(wanted - state.ramp, -dt), dt)
        state.rate = state.pace * ramp_rate(state.ramp)
    state.clock = min(state.clock + state.rate * dt, state.duration)
    h = state.spacing
    row = min(int(state.clock / h), master.q.shape[0] - 2)
    places, speeds = ctrl[FIRST_CONTROL::2], ctrl[FIRST_CONTROL + 1 :: 2]
    blend_cubic(master.q, master.qd, row, state.clock / h - row, h, places, speeds)
    for j in range(6):
        speeds[j] *= state.rate


@kernel
def _firmness(carrier: Carrier) -> float:
    """Share of the flange's motion that the brakes take in a second [1/s]."""
    v = carrier.velocity
    w = carrier.turning
    brakes = carrier.brakes
    moving = math.sqrt(dot(v, v)) / brakes[0]
    turning = math.sqrt(dot(w, w)) / brakes[1]
    return 1.0 / max(moving, turning, 1e-9)


@kernel
def carry_part(
    master: Master,
    e: EngineViews,
    part: RealPart,
    motion: PartMotion,
    angles: Array,
    speeds: Array,
    heard: bool,
) -> None:
    """Place the part by the flange that carries it, and work out what the host believes of it.

    ``angles`` [rad] and ``speeds`` [rad/s], (6,): by the master's encoders, ``heard`` unless the reading
    comes in a gap of the link. Written: what the master notes of this instant, the part's rotation, the
    motion's place and angular velocity.
    """
    carrier = master.state
    R_flange = e.xmat[carrier.flange_body]
    p_flange = e.xpos[carrier.flange_body]
    w = carrier.turning
    anchors, axes = e.xanchor[FIRST_JOINT:], e.xaxis[FIRST_JOINT:]
    _add_joints(p_flange, anchors, axes, e.qvel[FIRST_JOINT:], carrier.velocity, w)
    multiply(R_flange, carrier.R_part, part.rotation)
    set_to(motion.place, plus(p_flange, matvec(R_flange, carrier.p_part)))
    set_to(motion.turning, w)
    # A host that receives nothing continues with the last value.
    carrier.silence = carrier.silence + e.dt if carrier.unheard else 0.0
    if carrier.unheard:
        return
    arm = carrier.host_arm
    _hear(master, angles, speeds, heard, e.dt)
    read_encoders(arm, carrier.q)
    _add_joints(arm.place, arm.anchors, arm.axes, carrier.qd, carrier.seen_velocity, carrier.seen_turning)
    _believe(carrier, arm.turn, arm.place, carrier.seen_velocity, carrier.seen_turning)


@kernel
def _hear(master: Master, angles: Array, speeds: Array, heard: bool, dt: float) -> None:
    """The newest reading that has come: the master's positions carried on to now, its speeds to when a
    request acts.

    The host knows how late a reading is: it writes down when it was taken. Accelerations are the change of
    the speeds read lately, not the plan's: a master that slows down or halts by itself does not keep to its
    plan.
    """
    carrier = master.state
    line = master.line
    step = carrier.steps
    carrier.steps += 1
    if heard:
        carrier.newest = max((step - carrier.delay) // carrier.hold * carrier.hold, 0)
    newest = carrier.newest
    before = max(newest - carrier.span, 0)
    age = (step - newest) * dt
    between = max(newest - before, 1) * dt
    sent = step % line.shape[0]
    come = newest % line.shape[0]
    last = before % line.shape[0]
    for j in range(6):
        line[sent, j] = angles[j]
        line[sent, 6 + j] = speeds[j]
    for j in range(6):
        speed = line[come, 6 + j]
        acceleration = (speed - line[last, 6 + j]) / between
        carrier.q[j] = line[come, j] + age * (speed + 0.5 * age * acceleration)
        carrier.qd[j] = speed + (age + carrier.lead) * acceleration


@kernel
def _add_joints(point: Array, anchors: Array, axes: Array, speeds: Array, v: Array, w: Array) -> None:
    """Write velocity and angular velocity (3,) of a point (3,) [m] that moves with the flange of an arm, by
    its joints' anchors, axes and speeds [rad/s], to ``v`` and ``w``."""
    for i in range(3):
        v[i] = w[i] = 0.0
    for j in range(6):
        add_to(v, scaled(speeds[j], cross(axes[j], minus(point, anchors[j]))))
        add_to(w, scaled(speeds[j], axes[j]))


@kernel
def carry_target(carrier: Carrier, target: Target) -> None:
    """Close the chain: move a target given for the part at the first row to where the host believes it is
    now."""
    R, flange, place, twist, frame = (
        carrier.R_moved, carrier.believed, target.position, target.twist, target.rotation,
    )  # fmt: skip
    set_to(place, plus_matvec(carrier.p_moved, R, place))
    set_to(twist, matvec(R, twist))
    set_to(twist[3:6], plus_matvec(flange[2], R, twist[3:6]))
    add_to(twist, plus_cross(flange[1], flange[2], minus(place, flange[0])))
    for j in range(3):
        set_to(frame[:, j], matvec(R, frame[:, j]))


@kernel
def see_tool_on_part(
    carrier: Carrier, e: EngineViews, part: RealPart, motion: PartMotion, out: Array
) -> None:
    """Write the tool point [m] in the nominal work frame as carried, and as far as the part has slipped with
    it."""
    R_flange = e.xmat[carrier.flange_body]
    p_flange = e.xpos[carrier.flange_body]
    slip = minus(part.position, motion.place)
    tool = minus(minus(e.site_xpos[e.tool_site], p_flange), slip)
    on_flange = plus_matvec(scaled(-1.0, carrier.p_work), R_flange.T, tool)
    set_to(out, matvec(carrier.R_work.T, on_flange))


@kernel
def _believe(carrier: Carrier, R_flange: Array, p_flange: Array, v: Array, w: Array) -> None:
    """The part's displacement since the first row D = F F0^-1, and the flange's motion, as the host believes
    them.

    What it believes is moved by B from what is true, so that it takes the displacement for B D B^-1.
    """
    B = carrier.R_belief
    b = carrier.p_belief
    R = carrier.R_moved
    turn = carrier.work[0:3]
    R_B = carrier.work[3:6]
    multiply(R_flange, carrier.R_rest.T, turn)
    shift = minus(p_flange, matvec(turn, carrier.p_rest))
    multiply(B, turn, R_B)
    multiply(R_B, B.T, R)
    set_to(carrier.p_moved, plus(minus(b, matvec(R, b)), matvec(B, shift)))
    set_to(carrier.believed[0], plus_matvec(b, B, p_flange))
    set_to(carrier.believed[1], matvec(B, v))
    set_to(carrier.believed[2], matvec(B, w))


@kernel
def multiply(A: Array, B: Array, out: Array) -> None:
    """``A @ B`` of two (3, 3) into a third."""
    for j in range(3):
        set_to(out[:, j], matvec(A, B[:, j]))
