"""A second robot that carries the part: the master of two (layer 8a).

Its joint servos play rows of joint angles. The part goes where its flange really is; the host works out where the
part should be from the master's encoders and from what calibration made it believe, and moves its target along.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.contact import RealPart
from polish_sim.cell.feed_pace import BUILD_UP, LONGEST_RAMP
from polish_sim.cell.host_arm import HostArm, build_host_arm, no_host_arm, read_encoders
from polish_sim.motion.arm_table import NOMINAL
from polish_sim.spatial import inverse, transform

Array = NDArray[np.float64]

MASTER, FOLLOWER = "master_", "follower_"
"""What the names of the two robots in a scene begin with."""
FIRST_JOINT, FIRST_CONTROL = 7, 12
"""Where the master's joints and controls begin: the follower, with its head, comes first."""
RAMP_S = LONGEST_RAMP + BUILD_UP  # in which the master comes to its speed and back to rest, as a feed does
RAMP_PEAK = 1.0 / LONGEST_RAMP  # steepest rise of the rate at which its time passes [1/s]
SPAN_S = 0.01  # over which the host takes the master's accelerations, at least from one reading to the next [s]

CLOCK, RAMP, RATE, PACE, WANTED_PACE = 0, 1, 2, 3, 4  # of ``Carrier.clock``
HALTED, UNHEARD, SILENCE, STEPS = 5, 6, 7, 8


class MasterTime(NamedTuple):
    """Time of the master's rows at n moments, see ``carrying.drive_carrier``."""

    clock: Array
    """What has passed of it [s], shape (n,)."""
    rate: Array
    """At which it passes [-], shape (n,)."""


def time_let_go(since: Array) -> MasterTime:
    """How the time of the master's rows passes after it was let go from rest, (n,) [s]."""
    ramp = np.clip(since, 0.0, RAMP_S)
    return MasterTime(np.maximum(since - RAMP_S, 0.0) + _ramped(ramp), _rate(ramp))


def time_held(let_go: float, since: Array) -> MasterTime:
    """How it passes after the master is held again, (n,) [s], having been let go for a time [s]."""
    before = np.array([min(let_go, RAMP_S)])
    ramp = np.clip(before - since, 0.0, RAMP_S)
    return MasterTime(_ramped(before) - _ramped(ramp), _rate(ramp))


def _rate(ramp: Array) -> Array:
    return np.array([ramp_rate(float(t)) for t in ramp])


def _ramped(ramp: Array) -> Array:
    return np.array([ramp_time(float(t)) for t in ramp])


@njit(cache=True, error_model="numpy", forceinline=True)
def ramp_rate(t: float) -> float:
    """Rate [-] after so much of the ramp [s]: its rise is built up and taken back within ``BUILD_UP``."""
    early, late = max(t - BUILD_UP, 0.0), max(t - LONGEST_RAMP, 0.0)
    return (t * t - early * early - late * late) / (2.0 * BUILD_UP * LONGEST_RAMP)


@njit(cache=True, error_model="numpy", forceinline=True)
def ramp_time(t: float) -> float:
    """Integral of ``ramp_rate``: what has passed of the master's time by then [s]."""
    early, late = max(t - BUILD_UP, 0.0), max(t - LONGEST_RAMP, 0.0)
    return (t**3 - early**3 - late**3) / (6.0 * BUILD_UP * LONGEST_RAMP)


class MasterRows(NamedTuple):
    """What the master's servos play, and what the host makes of it."""

    spacing: float
    """Time between rows [s]."""
    q: Array
    """Joint positions [rad], shape (n, 6)."""
    qd: Array
    """Joint speeds [rad/s], shape (n, 6)."""
    T_base_work: Array
    """The work frame at the first row as it really is, nominal part, base of the follower, shape (4, 4)."""
    T_believed_true: Array
    """Where the host believes the master's things to be: true poses in the follower's base, moved by this (4, 4)."""
    table: Array = NOMINAL
    """The table the host computes the master with, shape (4, 6)."""
    delay: float = 0.0
    """How late its joints reach the host [s]."""
    period: float = 0.0
    """Between two readings of them, held in between [s]; 0: at every step."""
    lead: float = 0.0
    """From the host's request to the follower's motion, as far as the host knows [s]."""


class Carrier(NamedTuple):
    """The master in the loop; base frame of the follower. Arrays are (3, 3) rotations and (3,) points or vectors."""

    present: float
    """1 if there is one."""
    spacing: float
    """Time between rows [s]."""
    duration: float
    """Of all rows [s]."""
    q: Array
    """Rows of joint positions [rad], shape (n, 6)."""
    qd: Array
    """Rows of joint speeds [rad/s], shape (n, 6)."""
    clock: Array
    """CLOCK time of the rows [s]; RAMP how much of the ramp of its rate is done [s], RATE that rate, PACE it
    comes to and WANTED_PACE that it should [-]; STEPS taken; shape (9,).

    Of faults: HALTED 1 when the master has stopped itself, UNHEARD 1 when the host no longer hears where it is, SILENCE
    for how long [s].
    """
    brakes: Array
    """Deceleration of a protective stop [m/s^2], [rad/s^2], shape (2,)."""
    flange_body: int
    part_body: int
    R_rest: Array
    p_rest: Array
    """The flange at the first row, as the host computes it."""
    R_part: Array
    p_part: Array
    """The real part on the flange."""
    R_work: Array
    p_work: Array
    """The nominal work frame on the flange."""
    R_belief: Array
    p_belief: Array
    """What the host believes: true poses, moved by this."""
    host_arm: HostArm
    """The master up to its flange as the host computes it."""
    velocity: Array
    """Of the flange now [m/s], shape (3,)."""
    turning: Array
    """Of the flange now [rad/s], shape (3,)."""
    line: Array
    """Joint positions [rad] and speeds [rad/s] on their way to the host, step by step, shape (k, 12)."""
    delay: int
    """How late they arrive, in steps."""
    hold: int
    """Steps from one reading to the next."""
    span: int
    """Steps over which the host takes accelerations."""
    lead: float
    """How far ahead the host foretells speeds [s]."""
    told: Array
    """Joint positions for now and speeds for when a request acts, as the host has them, shape (2, 6)."""
    seen: Array
    """Velocity and angular velocity of the flange as the host computes them from those, shape (2, 3)."""
    R_moved: Array
    p_moved: Array
    """How the part has moved since the first row, as the host believes."""
    tool_on_part: Array
    """The tool point in the nominal work frame as it is carried [m], exact, shape (3,)."""
    believed: Array
    """The flange as the host believes: its place [m], velocity [m/s] and angular velocity [rad/s], shape (3, 3)."""
    work: Array
    """Work array, shape (7, 3)."""


def no_carrier() -> Carrier:
    """No second robot: the part stays where it lies."""
    rows, point, turn = np.zeros((2, 6)), np.zeros(3), np.eye(3)
    return Carrier(
        0.0, 1.0, 0.0, rows, rows, np.zeros(9), np.zeros(2), 0, 0,
        turn, point, turn, point, turn, point, turn, point, no_host_arm(),
        np.zeros(3), np.zeros(3), np.zeros((1, 12)), 0, 1, 1, 0.0, np.zeros((2, 6)), np.zeros((2, 3)),
        np.eye(3), np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((7, 3)),
    )  # fmt: skip


def build_carrier(
    model: mujoco.MjModel, data: mujoco.MjData, rows: MasterRows, part: RealPart, brakes: Array
) -> Carrier:
    """The master at the first of its rows, holding the part.

    Args:
        model: The scene of both robots.
        data: Both robots at their start, kinematics done.
        rows: What the master does.
        part: The part as it really lies at the start.
        brakes: Deceleration of its protective stop [m/s^2], [rad/s^2], shape (2,).
    """
    flange = data.site(f"{MASTER}flange")
    T_flange_base = inverse(transform(flange.xmat.reshape(3, 3).copy(), flange.xpos.copy()))
    T_flange_part = T_flange_base @ transform(part.rotation, part.position)
    T_flange_work = T_flange_base @ rows.T_base_work
    host_arm, T_rest = _host_arm(data, rows)
    delay, hold = round(rows.delay / model.opt.timestep), max(round(rows.period / model.opt.timestep), 1)
    span = max(round(SPAN_S / (hold * model.opt.timestep)), 1) * hold
    return Carrier(
        1.0, rows.spacing, rows.spacing * (len(rows.q) - 1), np.ascontiguousarray(rows.q),
        np.ascontiguousarray(rows.qd), np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]), brakes,
        model.body(f"{MASTER}link_6").id, model.body(f"{MASTER}part").id,
        *_split(T_rest), *_split(T_flange_part), *_split(T_flange_work), *_split(rows.T_believed_true), host_arm,
        np.zeros(3), np.zeros(3), np.zeros((delay + hold + span + 1, 12)), delay, hold, span, rows.lead,
        np.zeros((2, 6)), np.zeros((2, 3)),
        np.eye(3), np.zeros(3), np.zeros(3), np.zeros((3, 3)), np.zeros((7, 3)),
    )  # fmt: skip


def _host_arm(data: mujoco.MjData, rows: MasterRows) -> tuple[HostArm, Array]:
    """The master as the host computes it, and its flange at the first row so, shape (4, 4)."""
    base = data.body(f"{MASTER}base")
    arm = build_host_arm(rows.table, transform(base.xmat.reshape(3, 3), base.xpos), np.eye(4))
    read_encoders(arm, np.ascontiguousarray(rows.q[0]), 0)
    return arm, transform(arm.turn.reshape(3, 3), arm.place)


def _split(T: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and origin (3,) of a pose."""
    return np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3])
