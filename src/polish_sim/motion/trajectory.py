"""A tool path over its arc length, and a motion over its own time: dense tables that compiled loops can
sample."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PPoly
from scipy.spatial.transform import Rotation

from polish_sim.arrays import (
    Array,
    Indices,
    Ints,
    dots,
    evenly_to,
    midpoints,
    unit,
)
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Bundle, kernel
from polish_sim.motion.rules.fir import rest_to_rest, stop_times
from polish_sim.motion.rules.schedule import SmoothMotion
from polish_sim.planning.toolpath import arc_length, interpolate
from polish_sim.spatial import wxyz


class PathTable(Bundle):
    """Poses along a path at equal steps of arc length, base frame."""

    spacing: float  #: Arc length between rows [m]
    length: float  #: Arc length of the whole path [m]; 0 for a single pose
    positions: Array  #: Tool points [m], shape (n, 3)
    tangents: Array  #: Derivative of position by arc length [-], shape (n, 3)
    quaternions: Array  #: R_base_tool as wxyz, without sign jumps, shape (n, 4)
    turning: Array  #: Rotation per arc length [rad/m], base frame, shape (n, 3)
    curvature: Array  #: Normal curvature along the path [1/m], shape (n,)
    pass_index: Ints  #: Turn of the path, shape (n,)
    feed_share: Array  #: Feed as a share of the stroke's [-], shape (n,); ones unless the path says otherwise


def build_path_table(
    positions: Array,
    rotations: Array,
    s: Array | None = None,
    curvature: Array | None = None,
    pass_index: Indices | None = None,
    spacing: float = 0.0005,
) -> PathTable:
    """Resample poses to equal steps of arc length; cubic in position, shortest turn in orientation.

    ``positions`` are (n, 3) [m], repeated points are dropped; ``rotations`` R_base_tool (n, 3, 3). ``s`` (n,)
    [m], strictly increasing, is the arc length to go by: a pressed path keeps that of the surface; the
    points' own if not given. ``curvature`` (n,) [1/m] is the normal curvature along the path, ``pass_index``
    (n,) the turn of each point; zero if not given. Rows are about ``spacing`` [m] apart.
    """
    own = arc_length(positions)
    place = own if s is None else s - s[0]
    kept = np.concatenate([[True], np.diff(place) > 1e-9])
    place, points, frames = place[kept], positions[kept], rotations[kept]
    bend = np.zeros(len(points)) if curvature is None else curvature[kept]
    turns = np.zeros(len(points), np.int32) if pass_index is None else pass_index[kept].astype(np.int32)
    length = place[-1]
    if len(points) == 1:
        place, points = np.array([0.0, spacing]), np.repeat(points, 2, axis=0)
        frames, bend, turns = np.repeat(frames, 2, axis=0), np.repeat(bend, 2), np.repeat(turns, 2)
    nodes = evenly_to(place[-1], spacing)
    curve = CubicSpline(place, points, axis=0, bc_type="natural")
    step = nodes[1] - nodes[0]
    quaternions = np.ascontiguousarray(unit(interpolate(nodes, place, continuous_quaternions(frames))))
    return PathTable(
        step,
        length,
        np.ascontiguousarray(curve(nodes)),
        np.ascontiguousarray(curve(nodes, 1)),
        quaternions,
        _turning(quaternions, step),
        np.interp(nodes, place, bend),
        turns[np.clip(np.searchsorted(place, nodes, side="right") - 1, 0, len(place) - 1)],
        np.ones(len(nodes)),
    )


def at_rows(table: PathTable, s: Array, values: Array) -> Array:
    """Values (n,) given at arc lengths ``s`` (n,) [m] of a table's points, interpolated linearly at its
    rows."""
    return np.interp(np.arange(len(table.positions)) * table.spacing, s - s[0], values)


def with_feed_share(table: PathTable, s: Array, feed_share: Array) -> PathTable:
    """Give a table a feed that changes along the path, linear between the points it was made of, at ``s``
    (n,) [m]; ``feed_share`` (n,) is positive, a share of the stroke's feed."""
    return table._replace(feed_share=at_rows(table, s, feed_share))


@njit
def slowed_before(speeds: Array, gain: Array) -> Array:
    """Lower speeds (n,) before slow places so that their square falls by no more than ``gain`` (n,) from row
    to row."""
    out = speeds.copy()
    for row in range(len(out) - 2, -1, -1):
        out[row] = min(out[row], math.sqrt(out[row + 1] ** 2 + gain[row]))
    return out


def continuous_quaternions(rotations: Array) -> Array:
    """Rotations (n, 3, 3) as quaternions wxyz whose signs do not jump, shape (n, 4)."""
    quaternions = wxyz(rotations)
    turned = dots(quaternions[1:], quaternions[:-1]) < 0.0
    quaternions[1:] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
    return np.ascontiguousarray(quaternions)


def _turning(quaternions: Array, step: float) -> Array:
    frames = Rotation.from_quat(quaternions, scalar_first=True)
    between = (frames[1:] * frames[:-1].inv()).as_rotvec() / step
    at_nodes = np.empty((len(quaternions), 3))
    at_nodes[0], at_nodes[-1] = between[0], between[-1]
    at_nodes[1:-1] = midpoints(between)
    return at_nodes


@kernel
def blend_cubic(
    points: Array, slopes: Array, row: int, u: float, h: float, point: Array, slope: Array
) -> None:
    """Cubic Hermite interpolation a share ``u`` of the way from a row to the next, ``h`` apart, with its
    derivative.

    ``points`` and their derivatives ``slopes`` are (n, d), ``point`` and ``slope`` (d,) are written.
    """
    h00, h10 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * (1.0 - u) ** 2
    h01, h11 = u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    d00, d10, d11 = 6.0 * u * (u - 1.0), (1.0 - u) * (1.0 - 3.0 * u), u * (3.0 * u - 2.0)
    for i in range(points.shape[1]):
        p0, p1, t0, t1 = points[row, i], points[row + 1, i], slopes[row, i], slopes[row + 1, i]
        point[i] = h00 * p0 + h01 * p1 + h * (h10 * t0 + h11 * t1)
        slope[i] = d00 * (p0 - p1) / h + d10 * t0 + d11 * t1


@kernel
def blend_linear(rows: Array, row: int, u: float, out: Array) -> None:
    """Write what lies a share ``u`` of the way from a row of a table (n, d) to the next."""
    for i in range(rows.shape[1]):
        out[i] = (1.0 - u) * rows[row, i] + u * rows[row + 1, i]


@kernel
def normalize(quaternion: Array) -> None:
    """Scale a quaternion, shape (4,), to length one."""
    size = 0.0
    for i in range(4):
        size += quaternion[i] ** 2
    size = math.sqrt(size)
    for i in range(4):
        quaternion[i] /= size


@kernel
def _blend_pose(
    columns: tuple[Array, Array, Array, Array], place: float, h: float, point: Array, slope: Array,
    quaternion: Array, turning: Array,
) -> tuple[int, float]:  # fmt: skip
    """Points, their slopes, quaternions and turning at a ``place`` among rows ``h`` apart; the row and the
    share behind it."""
    row = min(int(place), columns[0].shape[0] - 2)
    u = place - row
    blend_cubic(columns[0], columns[1], row, u, h, point, slope)
    blend_linear(columns[3], row, u, turning)
    blend_linear(columns[2], row, u, quaternion)
    normalize(quaternion)
    return row, u


@kernel
def sample_path(
    table: PathTable, s: float, position: Array, tangent: Array, quaternion: Array, turning: Array
) -> int:
    """Evaluate a path at arc length ``s`` [m] (clamped to its ends); returns the row of the table at or
    before it.

    Written are the tool point [m] and its derivative ``tangent``, (3,) each, R_base_tool as unit quaternion
    wxyz (4,), and the rotation per arc length ``turning`` [rad/m], (3,).
    """
    place = min(max(s, 0.0), table.length) / table.spacing
    columns = table.positions, table.tangents, table.quaternions, table.turning
    return _blend_pose(columns, place, table.spacing, position, tangent, quaternion, turning)[0]


@kernel
def sample_column(table: PathTable, column: Array, s: float) -> float:
    """A column of the rows at arc length ``s`` [m] (clamped to the path's ends); exact between equal
    values."""
    return _between(column, min(max(s, 0.0), table.length) / table.spacing)


@kernel
def _between(column: Array, place: float) -> float:
    """Between two rows, exact between equal values."""
    row = min(int(place), column.shape[0] - 2)
    return float(column[row] + (place - row) * (column[row + 1] - column[row]))


# A motion over time, which may be sampled at a clock of another rate.

ROW_S = 0.005  # between rows; short against a jerk-limited corner [s]
MOST_ROWS = 400_000  # longer motions get longer rows


class TimedPath(Bundle):
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


def time_path(table: PathTable, pace: Pace) -> TimedPath:
    """Follow a path at constant speed, from rest to rest with limited jerk along it.

    The pace's speed is that at a feed share of 1; the path's bends are not slowed for. Where the feed share
    is below its greatest one, the motion's rates say so.
    """
    top = pace.speed * float(table.feed_share.max())
    boxes = np.zeros(3)
    if table.length > 0.0:
        boxes = stop_times(table.length, top, pace.acceleration, pace.jerk)
    clock = row_times(sum(boxes))
    places, speeds = np.zeros((2, len(clock)))
    if table.length > 0.0:
        times, coefficients = rest_to_rest(boxes)
        way = PPoly(table.length * coefficients[:, ::-1].T, times)
        places, speeds = np.minimum(way(clock), table.length), np.maximum(way(clock, 1), 0.0)
    n = len(clock)
    positions, velocities, spins = np.empty((3, n, 3))
    motion = TimedPath(
        float(clock[1] - clock[0]),
        sum(boxes),
        positions,
        velocities,
        np.empty((n, 4)),
        spins,
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
    gain = np.full_like(rates, 2.0 * rate_change * motion.spacing)
    return motion._replace(rates=slowed_before(rates, gain))


def row_times(duration: float) -> Array:
    """Times of the rows of a motion [s], shape (n,), n at least 2; a motion of no duration gets two equal
    ones."""
    rows = min(max(2, math.ceil(duration / ROW_S) + 1), MOST_ROWS)
    return np.linspace(0.0, duration if duration > 0.0 else ROW_S, rows)


@njit
def _fill(table: PathTable, motion: TimedPath) -> None:
    for i in range(len(motion.places)):
        row = motion.positions[i], motion.velocities[i], motion.quaternions[i], motion.spins[i]
        sample_path(table, motion.places[i], *row)
        for axis in range(3):
            motion.velocities[i, axis] *= motion.speeds[i]
            motion.spins[i, axis] *= motion.speeds[i]


@kernel
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
    columns = motion.positions, motion.velocities, motion.quaternions, motion.spins
    row, u = _blend_pose(columns, share, motion.spacing, position, velocity, quaternion, spin)
    place[0] = (1.0 - u) * motion.places[row] + u * motion.places[row + 1]
    place[1] = (1.0 - u) * motion.speeds[row] + u * motion.speeds[row + 1]


@kernel
def sample_rate(motion: TimedPath, clock: float) -> float:
    """Largest rate at which a motion may be played at its own time ``clock`` [s]; exactly 1 between ones."""
    return _between(motion.rates, min(max(clock, 0.0), motion.duration) / motion.spacing)


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
        continuous_quaternions(seen.rotations),
        np.ascontiguousarray(seen.spins[:, 0]),
        places,
        speeds,
        np.ones(len(clock)),
    )
