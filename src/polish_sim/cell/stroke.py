"""One stroke, from free space to free space: its stages, the target in each, and the state of a run."""

from __future__ import annotations

import math
from collections import abc

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Array, chord_lengths, running_sums
from polish_sim.control.signals import Measurement, Target
from polish_sim.kernels import Bundle, Record, Vector2, Vector3, Vector4, dot, kernel, matvec, minus
from polish_sim.motion.trajectory import (
    Pace,
    PathTable,
    TimedPath,
    sample_column,
    sample_motion,
    sample_path,
    sample_rate,
)
from polish_sim.spatial import rotation_from_quaternion, tilt_frame

TARE, TRAVEL, APPROACH, SEEK, TOUCH_DOWN, FEEDING, RETRACT, DONE = range(8)
TARE_START = 0.15  # the robot stands still this long before the sensor is zeroed [s]
TARE_TIME = 0.25  # readings averaged for zeroing [s]
TOUCH_DOWN_TIME = 0.42  # from measured contact to the start of the feed, at least [s]
LONGEST_TOUCH_DOWN = 1.5  # and at most: the feed waits for the force [s]
LANDED_SHARE = 0.9  # of the set force, which the feed waits for
RETRACT_SPEED = 0.02  # [m/s]
LIFT_ACCELERATION = 0.4  # at both ends of the retract [m/s^2]


class Stroke(Bundle):
    """One stroke, from free space to free space; tables in the base frame."""

    travel: TimedPath  #: From where the last stroke ended to where this one starts, in free space
    lead_in: PathTable  #: From the start down to the first process point on the unpressed surface
    process: PathTable  #: The process path, pressed in by D = F/k
    motion: TimedPath  #: How it is followed: the target's motion; its places are those of ``process``
    force: Array  #: To press with at the rows of ``process`` [N], shape (n,)
    approach_speed: float  #: [m/s]
    feed: float  #: [m/s]
    hold: float  #: Time at the end of the path before the retract [s]
    feed_time: float  #: The feed stops after this long [s]; infinite for the whole path
    contact: bool = False  #: Whether there is a part to press on; else motion in free space
    depth: float = 0.0  #: D at the first process point [m]
    threshold: float = math.inf  #: Measured force that counts as contact [N]
    search_depth: float = 0.0  #: How far past the nominal surface contact is sought [m]
    lift: float = 0.0  #: Height of the retract [m]; 0 ends the run without one
    early: float = 0.0  #: How far above the surface the rim of a leaning pad touches it [m]
    start_s: float = 0.0  #: Arc length of the plan at the first process point [m]
    retare: bool = False  #: Whether the sensor is zeroed again before this stroke

    @property
    def way_up(self) -> tuple[float, float]:
        """Height [m] and time [s] of the retract."""
        if self.lift == 0.0:
            return 0.0, 0.0
        height = self.lift + self.depth
        return height, height / RETRACT_SPEED + RETRACT_SPEED / LIFT_ACCELERATION


class Sequence(Record):
    """Where the run is in its strokes."""

    stage: int
    time: float  #: In this stage [s]
    s: float  #: Place on the active table [m]
    speed: float  #: Of that place [m/s]
    depth: float  #: Of the target below the surface [m], in the retract above its place on the path
    tilt_x: float  #: In the retract: of the target from its planned frame, about its x [rad]
    tilt_y: float
    clock: float  #: Time of the active motion [s]
    rate: float  #: At which that time passes [-]
    rate_change: float  #: [1/s]
    row: int  #: Of the process table
    pressed: float  #: Time for which the reading has counted as contact [s]
    air: float  #: Mean of the measured force in the air lately [N]
    swing: float  #: How far it lately swung below that [N]
    floor: float  #: Five standard deviations of the measured force in free space: less is no contact [N]
    quaternion: Vector4  #: Work array, as the three that follow
    tangent: Vector3
    turning: Vector3
    place: Vector2


def build_sequence() -> Sequence:
    """At the start of the tare."""
    return Sequence(stage=TARE, rate=1.0, quaternion=(1.0, 0.0, 0.0, 0.0))


def begin_next_stroke(sequence: Sequence) -> None:
    """Begin the next stroke's travel; its stroke must be the one given to ``advance_sequence`` from now
    on."""
    sequence.stage = TRAVEL
    sequence.time = 0.0
    sequence.s = sequence.speed = sequence.depth = 0.0
    sequence.clock, sequence.rate, sequence.rate_change = 0.0, 1.0, 0.0


def expected_duration(stroke: Stroke) -> float:
    """How long the stroke takes if contact is where it is expected [s]."""
    approach = stroke.travel.duration
    if stroke.contact:
        speed = stroke.approach_speed
        approach += stroke.lead_in.length / speed + 0.5 * speed / feed_acceleration.py_func(speed)
    feed = min(max(stroke.motion.playing_time, stroke.hold), stroke.feed_time)
    return (
        TARE_START
        + TARE_TIME
        + approach
        + (TOUCH_DOWN_TIME if stroke.contact else 0.0)
        + feed
        + stroke.way_up[1]
    )


def cycle_time(strokes: abc.Sequence[Stroke]) -> float:
    """How long all strokes take, the sensor zeroed before the first and those that ask for it [s]."""
    kept = sum(TARE_START + TARE_TIME for stroke in strokes[1:] if not stroke.retare)
    return sum(expected_duration(stroke) for stroke in strokes) - kept


# How the target gains and loses speed along a path: from rest to the feed, and as the controller grants.

FEED_ACCELERATION = 0.05  # of the target along the path, at least [m/s^2]
LONGEST_RAMP = 0.5  # from rest to full speed along the path [s]
BUILD_UP = 0.04  # in which the acceleration along the path is built up [s]
FALL = 4.0  # times as fast as it rises the rate of the motion may fall
TRAVEL_SPEED = 0.05  # between two strokes, in free space [m/s]
TRAVEL_PACE = Pace(TRAVEL_SPEED, 0.5, 5.0)
# of the tool in free space: the wrists' gears then shake it by less than counts as contact [rad/s]
TURN_SPEED = 0.2


def air_length(positions: Array, rotations: Array, speed: float) -> Array:
    """Length of a way through the air to its points [m], shape (n,); at a ``speed`` [m/s] along it the tool
    turns no faster than ``TURN_SPEED``.

    The way's points are (n, 3) [m] and its tool frames (n, 3, 3).
    """
    turns = (Rotation.from_matrix(rotations[1:]) * Rotation.from_matrix(rotations[:-1]).inv()).magnitude()
    ways = chord_lengths(positions)
    return running_sums(np.maximum(ways, speed / TURN_SPEED * turns))


@kernel
def feed_acceleration(feed: float) -> float:
    """Acceleration of the target along the path [m/s^2] for a feed [m/s]."""
    return max(FEED_ACCELERATION, feed / LONGEST_RAMP)


def feed_pace(feed: float) -> Pace:
    """How a path is followed at a feed [m/s] where nothing else limits it: gently from rest to rest."""
    acceleration = feed_acceleration.py_func(feed)  # compiling it would take longer than the rest
    return Pace(feed, acceleration, acceleration / BUILD_UP)


@kernel
def change_rate(state: Sequence, wanted: float, feed: float, dt: float) -> None:
    """Lead the rate of a motion towards the ``wanted`` one; its first and second derivative stay limited."""
    rise = feed_acceleration(feed) / feed
    build_up = FALL * rise / BUILD_UP  # [1/s^2]
    short = wanted - state.rate
    step = build_up * dt
    # The change from which a constant deceleration ends at the wanted rate.
    change = min(math.sqrt(0.25 * step * step + 2.0 * build_up * abs(short)) - 0.5 * step, abs(short) / dt)
    change = min(change, rise) if short > 0.0 else -min(change, FALL * rise)
    state.rate_change += min(max(change - state.rate_change, -step), step)
    state.rate += state.rate_change * dt
    if state.rate <= 0.0 or state.rate >= 1.0:
        state.rate = min(max(state.rate, 0.0), 1.0)
        state.rate_change = 0.0


# Where the target is in each stage of a stroke, and how fast it moves.


@kernel
def place_target(stroke: Stroke, state: Sequence, granted: float, dt: float, target: Target) -> None:
    """Move the target on by one step of its stage; ``granted`` is the share of the planned feed that is
    granted [-]."""
    stage = state.stage
    target.contact = stroke.contact and stage in (TOUCH_DOWN, FEEDING)
    fed = state.s if stage >= FEEDING else 0.0
    target.force = sample_column(stroke.process, stroke.force, fed)
    target.moment = target.curvature = 0.0
    target.s = stroke.start_s
    if stage == TRAVEL:
        _play(stroke.travel, state, dt, target)
    elif stage <= APPROACH:
        if stage == APPROACH:
            # Up to speed, which is kept to the end: the robot's own limits do the stopping.
            length, speed = stroke.lead_in.length, stroke.approach_speed
            faster = min(speed, state.speed + feed_acceleration(speed) * dt)
            state.speed = faster if state.s < length else 0.0
            state.s = min(state.s + state.speed * dt, length)
            state.depth = state.s - stroke.lead_in.length
        _follow(stroke.lead_in, state, target)
    elif stage == SEEK:
        state.depth += stroke.approach_speed * dt
        _sink(stroke.lead_in, stroke.lead_in.length, state, state.depth, stroke.approach_speed, target)
    elif stage == TOUCH_DOWN:
        left = max(TOUCH_DOWN_TIME - state.time, dt)
        speed = (stroke.depth - state.depth) / left
        state.depth += speed * dt
        _sink(stroke.process, 0.0, state, state.depth - stroke.depth, speed, target)
    elif stage == FEEDING:
        most = sample_rate(stroke.motion, state.clock)
        stopping = state.rate * stroke.feed / (FALL * feed_acceleration(stroke.feed)) + BUILD_UP
        if state.time >= stroke.feed_time - stopping:
            most = 0.0
        change_rate(state, granted * most, stroke.feed, dt)
        _play(stroke.motion, state, dt, target)
        state.row = min(int(state.s / stroke.process.spacing), stroke.process.positions.shape[0] - 2)
        target.curvature = stroke.process.curvature[state.row]
        target.s = stroke.start_s + state.s
    else:
        # From rest to rest; as it rises, the tool turns back to how it is planned.
        step, left = 0.0, stroke.lift + stroke.depth - state.depth
        if stage == RETRACT and left > 0.0:
            speed = min(
                RETRACT_SPEED, LIFT_ACCELERATION * state.time, math.sqrt(2.0 * LIFT_ACCELERATION * left)
            )
            step = min(speed * dt, left)
            state.tilt_x *= 1.0 - step / left
            state.tilt_y *= 1.0 - step / left
        state.depth += step
        _sink(stroke.process, state.s, state, -state.depth, -step / dt, target)
        tilt_frame(target.rotation, state.tilt_x, state.tilt_y, target.rotation)
        target.s = stroke.start_s + state.s
    target.speed = state.speed


@kernel
def depth_below(target: Target, position: Array) -> float:
    """How far a point (3,) is below a target along its tool axis [m]."""
    return dot(target.rotation[:, 2], minus(position, target.position))


@kernel
def _play(motion: TimedPath, state: Sequence, dt: float, target: Target) -> None:
    """Let a motion pass at the clock's rate; its place and speed go to ``state``."""
    moving = state.clock < motion.duration
    rate = state.rate if moving else 0.0
    state.clock = min(state.clock + rate * dt, motion.duration)
    sample_motion(
        motion, state.clock, target.position, state.tangent, state.quaternion, state.turning, state.place
    )
    _turn_and_move(state, target, rate)
    state.s, state.speed = state.place[0], state.place[1] * rate


@kernel
def _turn_and_move(state: Sequence, target: Target, rate: float) -> None:
    """Frame and twist of the target from what was sampled, its motion at a rate."""
    rotation_from_quaternion(state.quaternion, target.rotation)
    for i in range(3):
        target.twist[i] = state.tangent[i] * rate
        target.twist[3 + i] = state.turning[i] * rate


@kernel
def _follow(table: PathTable, state: Sequence, target: Target) -> None:
    sample_path(table, state.s, target.position, state.tangent, state.quaternion, state.turning)
    _turn_and_move(state, target, state.speed)


@kernel
def _sink(table: PathTable, s: float, state: Sequence, depth: float, speed: float, target: Target) -> None:
    """Place the target ``depth`` [m] along tool z from a point of a table, moving along it at ``speed``
    [m/s]."""
    sample_path(table, s, target.position, state.tangent, state.quaternion, state.turning)
    rotation_from_quaternion(state.quaternion, target.rotation)
    for i in range(3):
        target.position[i] += depth * target.rotation[i, 2]
        target.twist[i] = speed * target.rotation[i, 2]
        target.twist[3 + i] = 0.0


# The stages in order: tare, travel, approach, touch-down, process, retract.
#
# Transitions use only what the host computer knows: the clock, the path and the *measured* force.

LEAST_SHARE = 0.02  # of the planned feed a controller can slow it to: the run must end
LASTS = 0.02  # half a swing of the arm's slowest mode [s]
SWING_FADES = 0.3  # time in which the arm's swinging in the air is forgotten [s]
SWING_ROOM = 1.5  # times its swing below the mean a reading must rise above it to be contact
# after the approach starts an elastic arm swings: the sensor feels its tool, not a part [s]
SWINGS_FOR = 0.15


@kernel
def advance_sequence(
    stroke: Stroke,
    state: Sequence,
    m: Measurement,
    granted: float,
    target: Target,
    reach: float,
) -> bool:
    """Move the target on by one step; False if contact was sought down to the search depth and not found.

    ``granted`` [-] is the share of the planned feed the controller grants, limited to ``LEAST_SHARE`` to 1.
    Further than ``reach`` [m] above where the part should be, the reading of a shaken arm or of a noisy
    sensor must last to be contact. The tool is lifted from where it is: springs stiffer than planned hold it
    above its target, and by the moment of the pad it may lean; turned back at once, that shakes the arm.
    """
    measured_force, dt = m.wrench[2], m.cycle
    deeper = depth_below(target, m.position)
    state.time += dt
    stage = state.stage
    _watch_air(state, measured_force, dt)
    if stage == TARE and state.time >= TARE_START + TARE_TIME - 0.5 * dt:
        _enter(state, APPROACH if stroke.contact else FEEDING)
    elif stage == TRAVEL and state.clock >= stroke.travel.duration:
        _enter(state, TARE if stroke.retare else APPROACH if stroke.contact else FEEDING)
        state.s = state.speed = 0.0
    elif stage in (APPROACH, SEEK):
        least = max(stroke.threshold, state.floor, state.air + SWING_ROOM * state.swing)
        counts = measured_force > least and (stage == SEEK or state.time >= SWINGS_FOR)
        state.pressed = state.pressed + dt if counts else 0.0
        # Of a sensor whose noise alone comes near, the drift of its zero does the rest.
        doubted = state.swing > 0.5 * least or state.floor > stroke.threshold
        above = state.depth + deeper < -reach
        # A law that presses with less than counts holds the tool up on the part.
        held = deeper < -0.5 * stroke.search_depth and not above
        if held or state.pressed > (LASTS if doubted and above else 0.0):
            _enter(state, TOUCH_DOWN)
        elif stage == APPROACH and state.s >= stroke.lead_in.length:
            state.depth = 0.0
            _enter(state, SEEK)
        elif state.depth >= stroke.search_depth:
            return False
    elif stage == TOUCH_DOWN and state.time >= TOUCH_DOWN_TIME:
        if measured_force >= LANDED_SHARE * target.force or state.time >= LONGEST_TOUCH_DOWN:
            _enter(state, FEEDING)
            state.s = state.speed = 0.0
    elif stage == FEEDING:
        arrived = state.clock >= stroke.motion.duration and state.time >= stroke.hold
        if arrived or state.time >= stroke.feed_time:
            _enter(state, RETRACT if stroke.lift > 0.0 else DONE)
            state.depth = -deeper
            leaning = matvec(target.rotation.T, m.rotation[:, 2])
            state.tilt_x, state.tilt_y = -leaning[1], leaning[0]
    elif stage == RETRACT and state.depth >= stroke.lift + stroke.depth:
        _enter(state, DONE)
    place_target(stroke, state, min(max(granted, LEAST_SHARE), 1.0), dt, target)
    return True


@kernel
def _watch_air(state: Sequence, force: float, dt: float) -> None:
    """How the reading swings in the air: a shaken arm swings to both sides, contact only presses."""
    if state.stage not in (TRAVEL, APPROACH, SEEK):
        state.air = state.swing = 0.0
        return
    state.swing = max(state.air - force, state.swing * (1.0 - dt / SWING_FADES))
    state.air += dt / SWING_FADES * (force - state.air)


@kernel
def _enter(state: Sequence, stage: int) -> None:
    state.stage = stage
    state.time = 0.0
    if stage == TOUCH_DOWN:
        # The depth at contact is kept; above the surface it is negative.
        state.speed = 0.0
    elif stage == FEEDING:
        state.clock, state.rate, state.rate_change = 0.0, 1.0, 0.0
