"""Smoothing rules by name, and what they plan: when each segment of a chain is passed.

The paper's rules answer in cubic pieces of time: boxes filtered twice are piecewise cubic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple, Protocol

import numpy as np

from polish_sim.arrays import Array, Indices, crosses, turned
from polish_sim.errors import InputError, check_name
from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.derivatives import carried, jet_of
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits
from polish_sim.spatial import rotations_from_vectors


class Schedule(NamedTuple):
    """Progress of every segment over time: 0 before its first piece, 1 after its last, cubic in each.

    Segments overlap at corners: while segment k ends, k + 1 already begins. The tip is the first way
    point plus the sum of ``progress * length * direction``; the tool's rotation is composed in the same
    order, ``... exp(b n_2) exp(a n_1) R_0``, later segments on the left, rolls added up.
    """

    segments: Indices  #: Segment each piece belongs to, not falling, shape (m,)
    starts: Array  #: When each piece begins [s], rising within a segment, shape (m,)
    durations: Array  #: [s], shape (m,); a segment's pieces follow one another without a gap
    coefficients: Array  #: Progress c0 + c1 t + c2 t^2 + c3 t^3 with t from the piece's start, shape (m, 4)
    end: float  #: When the last segment has arrived [s]: the cycle time


class Samples(NamedTuple):
    """Motion at n times."""

    tips: Array  #: Tip and its first three time derivatives [m/s^k], shape (n, 4, 3)
    axes: Array  #: Unit tool axis and its first three time derivatives [1/s^k], shape (n, 4, 3)
    rotations: Array  #: Tool frames, third column the tool axis, shape (n, 3, 3)
    spins: Array  #: Angular velocity, roll included, and its first two derivatives [rad/s^k], shape (n, 3, 3)


class SmoothMotion(Protocol):
    """A motion along a chain, whatever rule planned it."""

    @property
    def end(self) -> float:
        """The cycle time [s]."""

    @property
    def edges(self) -> Array:
        """Times between which all derivatives are smooth, from 0 to the end [s], rising."""

    def sample(self, times: Array) -> Samples:
        """Pose and rates of the tool at ``times`` (n,) [s]; at rest at the end and after it."""

    def under_way(self, times: Array) -> tuple[Indices, Indices]:
        """First segment the motion is on or near at times (n,) [s], and the one past the last; none at
        rest."""

    def places_at(self, marks: Array, times: Array) -> tuple[Array, Array]:
        """Arc length reached at rising times (n,) [s] and its rate; way points are at ``marks`` (segments +
        1,) [m]."""

    def stretched(self, factor: float) -> SmoothMotion:
        """The same in ``factor`` times the time: accelerations fall by its square, jerks by its cube."""


Rule = Callable[[Chain, SmoothingLimits, float, float, Arm | None, Array | None], SmoothMotion]
"""Plans the motion along a chain, within limits of tool and joints and tolerances of tip [m] and tool axis
[rad].

The rule says of which distance of the tip. An arm of None leaves the joints out. Last come the tip's largest
speeds on the segments [m/s], shape (n,), infinite where there is none; None for no such limits. Raises a
ReachError for a place out of reach or singular, a SmoothingError if no speed keeps the joint limits."""

RULES: Mapping[str, Rule] = {
    "spline": FunctionOnUse("polish_sim.motion.spline.motion", "smooth_by_spline"),
    "joint-jerk": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_jerk"),
    "joint-acceleration": FunctionOnUse("polish_sim.motion.rules.paper_rules", "plan_joint_acceleration"),
}


def check_rule(where: str, name: str, known: Mapping[str, object]) -> None:
    """Raise an InputError, which says where the rule was named, if it is not a known one."""
    if name == "certified":
        raise InputError(f"{where} 'certified' is no longer there: set it to 'spline', which took its place.")
    check_name(where, name, known)


class Smoothed(NamedTuple):
    """A chain and when its segments are passed: a `SmoothMotion`."""

    chain: Chain
    schedule: Schedule

    @property
    def end(self) -> float:
        """See `SmoothMotion`."""
        return self.schedule.end

    @property
    def edges(self) -> Array:
        """See `SmoothMotion`."""
        starts, end = self.schedule.starts, self.schedule.end
        return np.unique(
            np.clip(np.concatenate([starts, starts + self.schedule.durations, [0.0, end]]), 0.0, end)
        )

    @property
    def lookup(self) -> ScheduleIndex:
        """Where its pieces are."""
        return index_schedule(self.chain, self.schedule)

    def sample(self, times: Array) -> Samples:
        """See `SmoothMotion`; at rest before the start, too.

        The composition is exact however many segments overlap: with A = exp(phi n) the angular velocity grows
        by ``w -> n phi' + A w``, differentiated twice in closed form.
        """
        chain, (first, _) = self.chain, self.under_way(times)
        tips, spin = np.zeros((4, len(times), 3)), np.zeros((3, len(times), 3))
        roll = np.zeros((4, len(times)))
        tips[0], R = chain.tips[first], chain.rotations[first]
        for rows, k, progress in self._passing(times):
            tips[:, rows] += (progress * chain.lengths[k])[..., None] * chain.directions[k]
            roll[:, rows] += progress * chain.rolls[k]
            n, (phi, *rates) = chain.turn_axes[k], (progress * chain.angles[k])[..., None]
            turn = rotations_from_vectors(phi * n)
            R[rows] = turn @ R[rows]
            w = (turn @ spin[:, rows, :, None])[..., 0]
            # (A w)' = phi' n x A w + A w', and once more.
            u = crosses(n, w[0])
            across = crosses(n, rates[0] * u + 2.0 * w[1])
            spin[:, rows] = w + np.stack(
                [rates[0] * n, rates[1] * n + rates[0] * u, rates[2] * n + rates[1] * u + rates[0] * across]
            )
        axis = carried(spin, R[:, :, 2])
        spin += jet_of(np.multiply, roll[1:, :, None], axis, 3)
        x, y = R[:, :, 0], R[:, :, 1]
        rolled = turned(x, y, roll[0]), turned(y, -x, roll[0]), axis[0]
        return Samples(
            tips.swapaxes(0, 1), np.stack(axis, axis=1), np.stack(rolled, axis=-1), spin.swapaxes(0, 1)
        )

    def _passing(self, times: Array) -> Iterator[tuple[Indices, Indices, Array]]:
        """Segments under way at times (n,) [s], one after the other: rows of the times (m,), segments (m,)
        and their progress with three derivatives (4, m)."""
        schedule, ends = self.schedule, self.lookup.first_pieces
        longest = int(np.diff(ends).max(initial=0))
        first, stop = self.under_way(times)
        for number in range(int((stop - first).max(initial=0))):
            rows = np.flatnonzero(first + number < stop)
            k, t = first[rows] + number, times[rows]
            piece, last = ends[k], ends[k + 1] - 1
            begun = (piece <= last) & (t >= schedule.starts[np.minimum(piece, len(schedule.starts) - 1)])
            for _ in range(longest - 1):
                after = np.minimum(piece + 1, last)
                piece = np.where(t >= schedule.starts[after], after, piece)
            piece = np.minimum(piece, last)
            t = t - schedule.starts[piece]
            ended = begun & (piece == last) & (t >= schedule.durations[piece])
            c = schedule.coefficients[piece].T
            found = np.array([
                c[0] + t * (c[1] + t * (c[2] + t * c[3])), c[1] + t * (2.0 * c[2] + 3.0 * t * c[3]),
                2.0 * c[2] + 6.0 * t * c[3], 6.0 * c[3],
            ])  # fmt: skip
            found[:, ended | ~begun] = 0.0
            found[0, ended] = 1.0
            yield rows, k, found

    def under_way(self, times: Array) -> tuple[Indices, Indices]:
        """See `SmoothMotion`."""
        lookup = self.lookup
        first = np.searchsorted(lookup.all_ended, times, side="right")
        return first, np.maximum(first, np.searchsorted(lookup.none_begun, times, side="right"))

    def places_at(self, marks: Array, times: Array) -> tuple[Array, Array]:
        """See `SmoothMotion`."""
        places, speeds = marks[self.under_way(times)[0]], np.zeros(len(times))
        for rows, k, progress in self._passing(times):
            places[rows] += progress[0] * np.diff(marks)[k]
            speeds[rows] += progress[1] * np.diff(marks)[k]
        return np.maximum.accumulate(places), speeds

    def stretched(self, factor: float) -> Smoothed:
        """See `SmoothMotion`."""
        segments, starts, durations, coefficients, end = self.schedule
        slower = coefficients * factor ** -np.arange(4.0)
        return self._replace(
            schedule=Schedule(segments, starts * factor, durations * factor, slower, end * factor)
        )


class ScheduleIndex(NamedTuple):
    """Where to find the pieces that matter at a time."""

    #: First piece of each segment and, last, the number of pieces, shape (segments + 1,)
    first_pieces: Indices
    all_ended: Array  #: When the segment and all before it have ended [s], shape (segments,)
    none_begun: Array  #: Until when neither the segment nor any after it has begun [s], shape (segments,)


def index_schedule(chain: Chain, schedule: Schedule) -> ScheduleIndex:
    """Find each segment's pieces; a segment without any stays at its start."""
    first = np.searchsorted(schedule.segments, np.arange(len(chain.lengths) + 1))
    begins, ends = np.full((2, len(chain.lengths)), np.inf)
    filled = np.flatnonzero(np.diff(first))
    begins[filled] = schedule.starts[first[filled]]
    last = first[filled + 1] - 1
    ends[filled] = schedule.starts[last] + schedule.durations[last]
    return ScheduleIndex(
        first.astype(np.int64), np.maximum.accumulate(ends), np.minimum.accumulate(begins[::-1])[::-1].copy()
    )


def turning(axes: Array) -> Array:
    """Angular velocity of the tool axis without spin, o x o', and its first two derivatives [rad/s^k], shape
    (n, 3, 3).

    ``axes`` are the axis and three derivatives, shape (n, 4, 3).
    """
    o, o1, o2, o3 = (axes[:, k] for k in range(4))
    return np.stack([crosses(o, o1), crosses(o, o2), crosses(o1, o2) + crosses(o, o3)], axis=1)
