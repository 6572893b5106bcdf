"""A motion over time as a dense table that compiled loops can sample at a clock of their own rate."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, midpoints
from polish_sim.kernel_cache import njit
from polish_sim.motion import trajectory
from polish_sim.motion.rules.chain import Chain, rows_among
from polish_sim.motion.rules.fir import stop_times
from polish_sim.motion.rules.schedule import SmoothMotion

ROW_S = 0.005  # between rows; short against a jerk-limited corner [s]
MOST_ROWS = 400_000  # longer motions get longer rows


class TimedPath(NamedTuple):
    """Poses and velocities at equal steps of a motion's own time, base frame.

    Who plays it may let that time pass at any ``rate`` from 0 to 1: velocities then shrink by the rate.
    """

    spacing: float  #: Time between rows [s]
    duration: float  #: [s]; 0 for a single pose
    positions: Array  #: Tool points [m], shape (n, 3)
    velocities: Array  #: [m/s], shape (n, 3)
    quaternions: Array  #: R_base_tool as wxyz, without sign jumps, shape (n, 4)
    spins: Array  #: Angular velocities [rad/s], base frame, shape (n, 3)
    places: Array  #: Arc length of the path the motion follows [m], never falling, shape (n,)
    speeds: Array  #: Its rate [m/s], shape (n,)
    rates: Array  #: Largest rate at which the motion may be played [-], in (0, 1], shape (n,)

    @property
    def playing_time(self) -> float:
        """How long it takes at the largest rates [s]."""
        slowness = 1.0 / self.rates
        return self.duration * float(np.mean(midpoints(slowness)))


class Pace(NamedTuple):
    """How fast a path is followed; all positive."""

    speed: float  #: [m/s]
    acceleration: float  #: [m/s^2]
    jerk: float  #: [m/s^3]


def time_path(table: trajectory.PathTable, pace: Pace) -> TimedPath:
    """Follow a path at constant speed, from rest to rest with limited jerk along it.

    The pace's speed is that at a feed share of 1; the path's bends are not slowed for. Where the feed share
    is below its greatest one, the motion's rates say so.
    """
    top = pace.speed * float(table.feed_share.max())
    if table.length > 0.0:
        boxes = stop_times(table.length, top, pace.acceleration, pace.jerk)
        clock = row_times(sum(boxes))
        places, speeds = _rest_to_rest(clock, table.length, boxes)
    else:
        boxes, clock, places, speeds = (0.0, 0.0, 0.0), row_times(0.0), np.zeros(2), np.zeros(2)
    n = len(clock)
    motion = TimedPath(
        float(clock[1] - clock[0]),
        sum(boxes),
        np.empty((n, 3)),
        np.empty((n, 3)),
        np.empty((n, 4)),
        np.empty((n, 3)),
        places,
        speeds,
        np.ones(n),
    )
    _fill(table, motion)
    feed = pace.speed * np.interp(places, np.arange(len(table.positions)) * table.spacing, table.feed_share)
    return with_feed(motion, feed, pace.acceleration / top)


def with_feed(motion: TimedPath, feed: Array, rate_change: float) -> TimedPath:
    """Play a motion no faster than a positive ``feed`` (n,) [m/s] along the path at its rows.

    The rate falls by ``rate_change`` [1/s] at most; before a slow place it falls early enough.
    """
    rates = np.minimum(1.0, feed / np.maximum(motion.speeds, 1e-12))
    return motion._replace(rates=trajectory.slowed_before(rates, 2.0 * rate_change * motion.spacing))


def row_times(duration: float) -> Array:
    """Times of the rows of a motion [s], shape (n,), n at least 2; a motion of no duration gets two equal
    ones."""
    rows = min(max(2, math.ceil(duration / ROW_S) + 1), MOST_ROWS)
    return np.linspace(0.0, duration if duration > 0.0 else ROW_S, rows)


def _rest_to_rest(t: Array, length: float, boxes: tuple[float, float, float]) -> tuple[Array, Array]:
    """Place [m] and speed [m/s] at times t (n,) of a motion that three filtered boxes a >= b + c [s] give."""
    a, b, c = boxes
    speed, end = length / a, a + b + c
    early = t < 0.5 * end
    near = np.where(early, t, end - t)
    ramp = np.minimum(near, b + c)
    cubes = ramp**3 - np.maximum(ramp - b, 0.0) ** 3 - np.maximum(ramp - c, 0.0) ** 3
    squares = ramp**2 - np.maximum(ramp - b, 0.0) ** 2 - np.maximum(ramp - c, 0.0) ** 2
    place = speed * (cubes / (6.0 * b * c) + np.maximum(near - (b + c), 0.0))
    rate = np.asarray(speed * squares / (2.0 * b * c))
    return np.asarray(np.where(early, place, length - place)), rate


@njit
def _fill(table: trajectory.PathTable, motion: TimedPath) -> None:
    for i in range(len(motion.places)):
        trajectory.sample_path(
            table,
            motion.places[i],
            motion.positions[i],
            motion.velocities[i],
            motion.quaternions[i],
            motion.spins[i],
        )
        for axis in range(3):
            motion.velocities[i, axis] *= motion.speeds[i]
            motion.spins[i, axis] *= motion.speeds[i]


@njit(forceinline=True)
def sample_motion(
    motion: TimedPath,
    clock: float,
    position: Array,
    velocity: Array,
    quaternion: Array,
    spin: Array,
    place: Array,
) -> None:
    """Evaluate a motion at its own time ``clock`` [s] (clamped to its ends).

    Written are the tool point [m] and its velocity [m/s], (3,) each, R_base_tool as unit quaternion wxyz
    (4,), angular velocity ``spin`` [rad/s], (3,), and arc length [m] and its rate [m/s], ``place`` (2,) or
    longer.
    """
    share = min(max(clock, 0.0), motion.duration) / motion.spacing
    row = min(int(share), motion.positions.shape[0] - 2)
    u = share - row
    trajectory.blend_cubic(motion.positions, motion.velocities, row, u, motion.spacing, position, velocity)
    trajectory.blend_linear(motion.spins, row, u, spin)
    trajectory.blend_linear(motion.quaternions, row, u, quaternion)
    trajectory.normalize(quaternion)
    place[0] = (1.0 - u) * motion.places[row] + u * motion.places[row + 1]
    place[1] = (1.0 - u) * motion.speeds[row] + u * motion.speeds[row + 1]


@njit(forceinline=True)
def sample_rate(motion: TimedPath, clock: float) -> float:
    """Largest rate at which a motion may be played at its own time ``clock`` [s]; exactly 1 between ones."""
    share = min(max(clock, 0.0), motion.duration) / motion.spacing
    row = min(int(share), motion.rates.shape[0] - 2)
    return float(motion.rates[row] + (share - row) * (motion.rates[row + 1] - motion.rates[row]))


# A smoothed chain as a motion (SmoothMotion -> TimedPath).


def time_schedule(motion: SmoothMotion, marks: Array) -> TimedPath:
    """Sample a motion along a chain in the base frame densely.

    ``marks`` (segments + 1,) [m], rising, are the arc lengths at the chain's way points: the motion's places
    go from mark to mark as its segments progress.
    """
    clock = row_times(motion.end)
    seen = motion.sample(clock)
    places, speeds = motion.places_at(marks, clock)
    return TimedPath(
        float(clock[1] - clock[0]),
        motion.end,
        np.ascontiguousarray(seen.tips[:, 0]),
        np.ascontiguousarray(seen.tips[:, 1]),
        trajectory.continuous_quaternions(seen.rotations),
        np.ascontiguousarray(seen.spins[:, 0]),
        places,
        speeds,
        np.ones(len(clock)),
    )


def marks_on(chain: Chain, tips: Array, rotations: Array, s: Array) -> Array:
    """Arc lengths of a chain's way points [m], shape (segments + 1,).

    Each is one of the points the chain was made of, in order: ``tips`` (m, 3) [m], ``rotations`` (m, 3, 3),
    at arc lengths ``s`` (m,) [m].
    """
    own, raw = (
        np.hstack([p, R.reshape(-1, 9)]) for p, R in ((chain.tips, chain.rotations), (tips, rotations))
    )
    return s[rows_among(own, raw)]
