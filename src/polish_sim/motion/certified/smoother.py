"""The rule ``certified``: short chords merged, corner kernels, fastest runs between them, a look-ahead.

`Smoother` is its stream as Python sees it: feed way points, take pieces of the motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.errors import ReachError, SmoothingError, place_in_mm
from polish_sim.motion.certified.corner import corner_shapes
from polish_sim.motion.certified.fitting import new_course
from polish_sim.motion.certified.merge import Shares
from polish_sim.motion.certified.stream import NO_LAW, make_room, new_stream, take_points
from polish_sim.motion.certified.window import BLOCK
from polish_sim.motion.rules.chain import Chain, build_chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits, arm_or_none
from polish_sim.motion.rules.schedule import Schedule, Smoothed
from polish_sim.motion.segment_rates import REACHED, UNREACHABLE

MERGING_SHARE = 0.5  #: Share of either tolerance that merging short chords may use; what it leaves goes to the corners


class MotionPieces(NamedTuple):
    """Segments of the merged chain that are decided on, and when each is passed (as in Schedule)."""

    tips: Array  #: Way points the segments end at [m], shape (m, 3)
    rotations: Array  #: Tool frames there, shape (m, 3, 3)
    way_points: Indices  #: Their numbers among the way points fed, shape (m,)
    segments: Indices  #: Segment of each row, counted from the path's start, shape (r,)
    starts: Array  #: [s], shape (r,)
    durations: Array  #: [s], shape (r,)
    coefficients: Array  #: Progress as a cubic in time, shape (r, 4)


class Smoother:
    """Smooths a path while it comes in.

    A segment is given out once eight more are known or the path has ended. Segments are counted after merging: a
    chord of up to 32 way points is one. Memory does not grow with the path.
    """

    def __init__(
        self, limits: SmoothingLimits, tolerance: float, axis_tolerance: float, arm: Arm | None = None
    ) -> None:
        """Begin a path at rest.

        ``tolerance`` [m] is the largest distance of the tip from the path (0: exact stops), ``axis_tolerance`` [rad]
        that of the tool's axis. Without an arm only the tool's limits count.
        """
        if not (tolerance >= 0.0 and axis_tolerance >= 0.0):
            raise SmoothingError(f"tolerances are {tolerance:g} m and {axis_tolerance:g} rad: 0 or more is needed.")
        # Merging pays where a segment is shorter than full speed covers while the acceleration builds up.
        length = limits.tip_speed * limits.tip_acceleration / limits.tip_jerk
        turn = limits.axis_speed * limits.axis_acceleration / limits.axis_jerk
        shares = Shares(MERGING_SHARE * tolerance, MERGING_SHARE * axis_tolerance, length, turn)
        self._shapes = corner_shapes()
        self._course = new_course(limits.values(), (float(tolerance), float(axis_tolerance)), shares, arm_or_none(arm))
        self._stream = new_stream(arm_or_none(arm))

    @property
    def time(self) -> float:
        """When the last segment given out has handed over to the next one [s]; after `finish` the cycle time."""
        return float(self._stream.clock)

    def feed(self, tips: Array, rotations: Array, feeds: Array | None = None) -> MotionPieces:
        """Take in way points and give out what has become certain.

        ``tips`` are (n, 3) [m], ``rotations`` tool frames (n, 3, 3), third column the axis into the part; ``feeds``
        (n,) [m/s] cap the tip's speed on the way to each of them, the path's first one counts for nothing.

        Raises:
            ReachError: The robot cannot go to a way point, or not at any speed that can be proven.
            SmoothingError: No law of time was found for a line.
        """
        tips, rotations = np.ascontiguousarray(tips, dtype=float), np.ascontiguousarray(rotations, dtype=float)
        caps = np.full(len(tips), np.inf) if feeds is None else np.ascontiguousarray(feeds, dtype=float)
        pieces = [
            self._take(tips[i : i + BLOCK], rotations[i : i + BLOCK], caps[i : i + BLOCK], False)
            for i in range(0, len(tips), BLOCK)
        ]
        return pieces[0] if len(pieces) == 1 else join_pieces(pieces)

    def finish(self) -> MotionPieces:
        """End the path at rest; all that is left of the motion."""
        return self._take(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0), True)

    def _take(self, tips: Array, rotations: Array, caps: Array, ends: bool) -> MotionPieces:
        """Take in at most BLOCK way points; what has become certain, copied out of the stream."""
        make_room(self._stream)
        take_points(self._stream, self._course, self._shapes, tips, rotations, caps, ends)
        self._check()
        box, m, r = self._stream.pen.outbox, self._stream.out_segments, self._stream.out_rows
        rows = box.segments[:r].copy(), box.starts[:r].copy(), box.durations[:r].copy(), box.coefficients[:r].copy()
        return MotionPieces(box.tips[:m].copy(), box.rotations[:m].copy(), box.way_points[:m].copy(), *rows)

    def _check(self) -> None:
        """Raise what went wrong."""
        stream, tips = self._stream, self._stream.segments.tips
        if stream.status == REACHED:
            return
        if stream.status == NO_LAW:
            first, last = stream.lines.first[stream.given : stream.given + 2]
            start, end = place_in_mm(tips[first]), place_in_mm(tips[last])
            raise SmoothingError(
                f"between {start} and {end} no law of time was found that keeps every bend within limits and "
                "tolerance. Widen the tolerance, or set it to 0 to stop at every point."
            )
        k = stream.count
        start, end = place_in_mm(tips[k]), place_in_mm(tips[k + 1])
        if stream.status == UNREACHABLE:
            raise ReachError(f"the robot cannot reach all of the path between {start} and {end}. Move the part.")
        raise ReachError(
            f"between {start} and {end} the arm is so close to a singular position that no speed keeps its joints "
            "within their limits. Move the part or turn the tool."
        )


def join_pieces(pieces: list[MotionPieces]) -> MotionPieces:
    """Many pieces, in order, as one."""
    return MotionPieces(*(np.concatenate(parts) for parts in zip(*pieces, strict=True)))


def plan_certified(
    chain: Chain, limits: SmoothingLimits, tolerance: float, axis_tolerance: float, arm: Arm | None,
    feeds: Array | None = None,
) -> Smoothed:  # fmt: skip
    """Schedule a chain within all limits and tolerances, proven on intervals; arguments as of `Rule`.

    Returns the chain with short segments merged, its way points a part of the given ones, and its schedule.

    Raises:
        ReachError: A place out of reach or singular.
        SmoothingError: No motion was found within the limits.
    """
    smoother = Smoother(limits, tolerance, axis_tolerance, arm)
    caps = None if feeds is None else np.concatenate([[np.inf], feeds])
    pieces = join_pieces([smoother.feed(chain.tips, chain.rotations, caps), smoother.finish()])
    merged = build_chain(
        np.concatenate([chain.tips[:1], pieces.tips]), np.concatenate([chain.rotations[:1], pieces.rotations])
    )
    if not np.isfinite(smoother.time):
        raise SmoothingError("no motion was found within the limits: those of the joints are too tight for this path.")
    schedule = Schedule(pieces.segments, pieces.starts, pieces.durations, pieces.coefficients, smoother.time)
    return Smoothed(merged, schedule)
