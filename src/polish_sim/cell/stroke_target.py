"""Where the target is in each stage of a stroke, and how fast it moves (layer 8a)."""

from __future__ import annotations

from numba import njit

from polish_sim.cell.feed_pace import change_rate, feed_acceleration, stopping_time
from polish_sim.cell.stroke import (
    APPROACH,
    PROCESS,
    RETRACT,
    RETRACT_SPEED,
    SEEK,
    TOUCH_DOWN,
    TOUCH_DOWN_TIME,
    TRAVEL,
    Job,
    SequenceState,
)
from polish_sim.control.signals import Target
from polish_sim.motion.timed_path import TimedPath, sample_motion, sample_rate
from polish_sim.motion.trajectory import PathTable, sample_path, sample_share
from polish_sim.spatial.rotations import rotation_from_quaternion


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
