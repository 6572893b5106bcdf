"""One stroke, from free space to free space: its stages, what is to be done, what is remembered."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.control.signals import Target
from polish_sim.kernel_cache import njit
from polish_sim.motion.timed_path import Pace, TimedPath, sample_motion, sample_rate
from polish_sim.motion.trajectory import PathTable, sample_path, sample_share
from polish_sim.spatial import rotation_from_quaternion

Array = NDArray[np.float64]

TARE, TRAVEL, APPROACH, SEEK, TOUCH_DOWN, PROCESS, RETRACT, DONE = 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0

TARE_START = 0.15  # the robot stands still this long before the sensor is zeroed [s]
TARE_TIME = 0.25  # readings averaged for zeroing [s]
TOUCH_DOWN_TIME = 0.35  # from measured contact to the start of the feed [s]
RETRACT_SPEED = 0.02  # [m/s]


class Job(NamedTuple):
    """One stroke, from free space to free space; tables in the base frame."""

    travel: TimedPath
    """From where the last stroke ended to where this one starts, in free space."""
    lead_in: PathTable
    """From the start down to the first process point on the unpressed surface."""
    process: PathTable
    """The process path, pressed in by D = F/k; its shares say how force and feed change along it."""
    motion: TimedPath
    """How it is followed: the target's motion; its places are those of ``process``."""
    depth: float
    """D at the first process point [m]."""
    force: float
    """[N]"""
    contact: float
    """1 if there is a part to press on, 0 for motion in free space."""
    approach_speed: float
    """[m/s]"""
    feed: float
    """[m/s]"""
    threshold: float
    """Measured force that counts as contact [N]."""
    search_depth: float
    """How far past the nominal surface contact is sought [m]."""
    hold: float
    """Time at the end of the path before the retract [s]."""
    feed_time: float
    """The feed stops after this long [s]; infinite for the whole path."""
    lift: float
    """Height of the retract [m]; 0 ends the run without one."""
    start_s: float
    """Arc length of the plan at the first process point [m]."""
    retare: float = 0.0
    """1 if the sensor is zeroed again before this stroke."""


class SequenceState(NamedTuple):
    """Memory of the sequence."""

    stage: Array
    """Stage and time in it [s], shape (2,)."""
    path: Array
    """Place on the active table [m], its speed [m/s], depth of the target below the surface [m], shape (3,)."""
    clock: Array
    """Time of the active motion [s], the rate at which it passes [-], its change [1/s], shape (3,)."""
    quaternion: Array
    """Work array, shape (4,)."""
    tangent: Array
    """Work array, shape (3,)."""
    turning: Array
    """Work array, shape (3,)."""
    place: Array
    """Work array, shape (2,)."""
    row: NDArray[np.int64]
    """Row of the process table, shape (1,)."""
    floor: Array
    """Five standard deviations of the measured force in free space: less is no contact [N], shape (1,)."""


def build_sequence_state() -> SequenceState:
    """Fresh memory, at the start of the tare."""
    return SequenceState(
        np.zeros(2), np.zeros(3), np.array([0.0, 1.0, 0.0]), np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3),
        np.zeros(2), np.zeros(1, np.int64), np.zeros(1),
    )  # fmt: skip


def begin_next_stroke(state: SequenceState) -> None:
    """Go on with the next stroke's travel; its job must be the one given to ``advance_sequence`` from now on."""
    state.stage[:] = TRAVEL, 0.0
    state.path[:] = 0.0
    state.clock[:] = 0.0, 1.0, 0.0


def expected_duration(job: Job) -> float:
    """How long the job takes if contact is where it is expected [s]."""
    approach = job.travel.duration + (job.lead_in.length / job.approach_speed if job.contact else 0.0)
    feed = min(max(job.motion.playing_time, job.hold), job.feed_time)
    return TARE_START + TARE_TIME + approach + TOUCH_DOWN_TIME * job.contact + feed + job.lift / RETRACT_SPEED


# How the target gains and loses speed along a path: from rest to the feed, and as the controller grants.

FEED_ACCELERATION = 0.05  # of the target along the path, at least [m/s^2]
LONGEST_RAMP = 0.5  # from rest to full speed along the path [s]
BUILD_UP = 0.04  # in which the acceleration along the path is built up [s]
FALL = 4.0  # times as fast as it rises the rate of the motion may fall
TRAVEL_SPEED = 0.05  # between two strokes, in free space [m/s]

TRAVEL_PACE = Pace(TRAVEL_SPEED, 0.5, 5.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def feed_acceleration(feed: float) -> float:
    """Acceleration of the target along the path [m/s^2] for a feed [m/s]."""
    return max(FEED_ACCELERATION, feed / LONGEST_RAMP)


def feed_pace(feed: float) -> Pace:
    """How a path is followed at a feed [m/s] where nothing else limits it: gently from rest to rest."""
    acceleration = feed_acceleration(feed)
    return Pace(feed, acceleration, acceleration / BUILD_UP)


@njit(cache=True, error_model="numpy", forceinline=True)
def stopping_time(feed: float, rate: float) -> float:
    """How long it takes to bring a motion at a feed [m/s] from a rate [-] to rest [s]."""
    return rate * feed / (FALL * feed_acceleration(feed)) + BUILD_UP


@njit(cache=True, error_model="numpy", forceinline=True)
def change_rate(clock: Array, wanted: float, feed: float, dt: float) -> None:
    """Lead the rate of a motion towards the ``wanted`` one; its first and second derivative stay limited."""
    rise = feed_acceleration(feed) / feed
    build_up = FALL * rise / BUILD_UP  # [1/s^2]
    short = wanted - clock[1]
    step = build_up * dt
    # The change from which a constant deceleration ends at the wanted rate.
    change = min(math.sqrt(0.25 * step * step + 2.0 * build_up * abs(short)) - 0.5 * step, abs(short) / dt)
    change = min(change, rise) if short > 0.0 else -min(change, FALL * rise)
    clock[2] += min(max(change - clock[2], -step), step)
    clock[1] += clock[2] * dt
    if clock[1] <= 0.0 or clock[1] >= 1.0:
        clock[1], clock[2] = min(max(clock[1], 0.0), 1.0), 0.0


# Where the target is in each stage of a stroke, and how fast it moves.


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def place_target(job: Job, state: SequenceState, granted: float, dt: float, target: Target) -> None:
    """Move the target on by one step of its stage.

    Args:
        job: What is to be done.
        state: Memory.
        granted: Share of the planned feed that is granted [-].
        dt: Step [s].
        target: Written.
    """
    stage = state.stage[0]
    target.contact[0] = 1.0 if job.contact > 0.0 and stage in (TOUCH_DOWN, PROCESS) else 0.0
    target.force[0] = job.force * sample_share(job.process, job.process.force_share, _fed(state, stage))
    target.force[1] = 0.0
    target.path[1] = 0.0
    if stage == TRAVEL:
        _play(job.travel, state, dt, target)
        target.path[0] = job.start_s
    elif stage <= APPROACH:
        if stage == APPROACH:
            _move_on(state, job.lead_in.length, job.approach_speed, dt)
            state.path[2] = state.path[0] - job.lead_in.length
        _follow(job.lead_in, state, target)
        target.path[0] = job.start_s
    elif stage == SEEK:
        state.path[2] += job.approach_speed * dt
        _sink(job.lead_in, job.lead_in.length, state, state.path[2], job.approach_speed, target)
        target.path[0] = job.start_s
    elif stage == TOUCH_DOWN:
        left = max(TOUCH_DOWN_TIME - state.stage[1], dt)
        speed = (job.depth - state.path[2]) / left
        state.path[2] += speed * dt
        _sink(job.process, 0.0, state, state.path[2] - job.depth, speed, target)
        target.path[0] = job.start_s
    elif stage == PROCESS:
        most = sample_rate(job.motion, state.clock[0])
        if state.stage[1] >= job.feed_time - stopping_time(job.feed, state.clock[1]):
            most = 0.0
        change_rate(state.clock, granted * most, job.feed, dt)
        _play(job.motion, state, dt, target)
        state.row[0] = min(int(state.path[0] / job.process.spacing), job.process.positions.shape[0] - 2)
        target.path[1] = job.process.curvature[state.row[0]]
        target.path[0] = job.start_s + state.path[0]
    else:
        speed = RETRACT_SPEED if stage == RETRACT else 0.0
        state.path[2] += speed * dt
        _sink(job.process, state.path[0], state, -state.path[2], -speed, target)
        target.path[0] = job.start_s + state.path[0]
    target.path[2] = state.path[1]


@njit(cache=True, error_model="numpy", forceinline=True)
def _fed(state: SequenceState, stage: float) -> float:
    """Place on the process path [m]; its beginning before the feed."""
    return state.path[0] if stage >= PROCESS else 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _move_on(state: SequenceState, length: float, speed: float, dt: float) -> None:
    """Advance along a table: ramp up to ``speed`` and keep it to the end; the robot's own limits do the stopping."""
    gained = feed_acceleration(speed) * dt
    state.path[1] = min(speed, state.path[1] + gained) if state.path[0] < length else 0.0
    state.path[0] = min(state.path[0] + state.path[1] * dt, length)


@njit(cache=True, error_model="numpy", forceinline=True)
def _play(motion: TimedPath, state: SequenceState, dt: float, target: Target) -> None:
    """Let a motion pass at the clock's rate; its place and speed go to ``state.path``."""
    moving = state.clock[0] < motion.duration
    rate = state.clock[1] if moving else 0.0
    state.clock[0] = min(state.clock[0] + rate * dt, motion.duration)
    sample_motion(motion, state.clock[0], target.position, state.tangent, state.quaternion, state.turning, state.place)
    rotation_from_quaternion(state.quaternion, target.rotation)
    for i in range(3):
        target.twist[i] = state.tangent[i] * rate
        target.twist[3 + i] = state.turning[i] * rate
    state.path[0], state.path[1] = state.place[0], state.place[1] * rate


@njit(cache=True, error_model="numpy", forceinline=True)
def _follow(table: PathTable, state: SequenceState, target: Target) -> None:
    sample_path(table, state.path[0], target.position, state.tangent, state.quaternion, state.turning)
    rotation_from_quaternion(state.quaternion, target.rotation)
    for i in range(3):
        target.twist[i] = state.tangent[i] * state.path[1]
        target.twist[3 + i] = state.turning[i] * state.path[1]


@njit(cache=True, error_model="numpy", forceinline=True)
def _sink(table: PathTable, s: float, state: SequenceState, depth: float, speed: float, target: Target) -> None:
    """Place the target ``depth`` [m] along tool z from a point of a table, moving along it at ``speed`` [m/s]."""
    sample_path(table, s, target.position, state.tangent, state.quaternion, state.turning)
    rotation_from_quaternion(state.quaternion, target.rotation)
    for i in range(3):
        target.position[i] += depth * target.rotation[i, 2]
        target.twist[i] = speed * target.rotation[i, 2]
        target.twist[3 + i] = 0.0


# What is wanted when: tare, travel, approach, touch-down, process, retract, stage after stage.
#
# Transitions use only what the host computer knows: the clock, the path and the *measured* force.

LEAST_SHARE = 0.02  # of the planned feed a controller can slow it to: the run must end


@njit(cache=True, error_model="numpy", forceinline=True)
def advance_sequence(
    job: Job, state: SequenceState, measured_force: float, granted: float, dt: float, target: Target
) -> bool:
    """Move the target on by one step.

    Args:
        job: What is to be done.
        state: Memory.
        measured_force: Force the host believes it presses with [N].
        granted: Share of the planned feed the controller grants [-]; taken as ``LEAST_SHARE`` to 1.
        dt: Step [s].
        target: Written.

    Returns:
        False if contact was sought down to the search depth and not found.
    """
    state.stage[1] += dt
    stage = state.stage[0]
    touching = measured_force > max(job.threshold, state.floor[0])
    if stage == TARE and state.stage[1] >= TARE_START + TARE_TIME - 0.5 * dt:
        _enter(state, APPROACH if job.contact > 0.0 else PROCESS)
    elif stage == TRAVEL and state.clock[0] >= job.travel.duration:
        _enter(state, TARE if job.retare > 0.0 else APPROACH if job.contact > 0.0 else PROCESS)
        state.path[0], state.path[1] = 0.0, 0.0
    elif stage in (APPROACH, SEEK):
        if touching:
            _enter(state, TOUCH_DOWN)
        elif stage == APPROACH and state.path[0] >= job.lead_in.length:
            state.path[2] = 0.0
            _enter(state, SEEK)
        elif state.path[2] >= job.search_depth:
            return False
    elif stage == TOUCH_DOWN and state.stage[1] >= TOUCH_DOWN_TIME:
        _enter(state, PROCESS)
        state.path[0], state.path[1] = 0.0, 0.0
    elif stage == PROCESS:
        arrived = state.clock[0] >= job.motion.duration and state.stage[1] >= job.hold
        if arrived or state.stage[1] >= job.feed_time:
            _enter(state, RETRACT if job.lift > 0.0 else DONE)
            state.path[2] = 0.0
    elif stage == RETRACT and state.path[2] >= job.lift + job.depth:
        _enter(state, DONE)
    place_target(job, state, min(max(granted, LEAST_SHARE), 1.0), dt, target)
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _enter(state: SequenceState, stage: float) -> None:
    """Begin a stage."""
    state.stage[0] = stage
    state.stage[1] = 0.0
    if stage == TOUCH_DOWN:
        # The depth at contact is kept; above the surface it is negative.
        state.path[1] = 0.0
    elif stage == PROCESS:
        state.clock[0], state.clock[1], state.clock[2] = 0.0, 1.0, 0.0
