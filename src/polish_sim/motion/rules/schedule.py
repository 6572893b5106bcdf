"""Smoothing rules by name, and what they plan: when each segment of a chain is passed.

The paper's rules answer in cubic pieces of time: boxes filtered twice are piecewise cubic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from polish_sim.arrays import Array, Indices, crosses
from polish_sim.errors import InputError, check_name
from polish_sim.kernel_cache import njit
from polish_sim.kernels import (
    add_to,
    cross,
    plus,
    scaled,
    second_by_turning,
    set_to,
    third_by_turning,
    turn_about,
)
from polish_sim.lazy import FunctionOnUse
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.limits import Arm, SmoothingLimits


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
        times = np.ascontiguousarray(times, dtype=float)
        n = len(times)
        samples = Samples(np.empty((n, 4, 3)), np.empty((n, 4, 3)), *np.empty((2, n, 3, 3)))
        _sample_all(self.chain, self.schedule, self.lookup, times, samples, np.empty((2, 4)))
        return samples

    def under_way(self, times: Array) -> tuple[Indices, Indices]:
        """See `SmoothMotion`."""
        return _under_way.py_func(self.lookup, times)  # type: ignore[no-any-return]

    def places_at(self, marks: Array, times: Array) -> tuple[Array, Array]:
        """See `SmoothMotion`."""
        places, speeds = np.empty((2, len(times)))
        _mark(self.schedule, self.lookup, times, marks, places, speeds)
        return np.maximum.accumulate(places), speeds

    def stretched(self, factor: float) -> Smoothed:
        """See `SmoothMotion`."""
        segments, starts, durations, coefficients, end = self.schedule
        slower = coefficients * factor ** -np.arange(4.0)
        return self._replace(
            schedule=Schedule(segments, starts * factor, durations * factor, slower, end * factor)
        )


@njit
def _mark(
    schedule: Schedule, index: ScheduleIndex, clock: Array, marks: Array, places: Array, speeds: Array
) -> None:
    rates = np.empty(4)
    for i in range(len(clock)):
        first, stop = _under_way(index, clock[i])
        places[i], speeds[i] = marks[first], 0.0
        for k in range(first, stop):
            progress_at(schedule, index, k, clock[i], rates)
            places[i] += rates[0] * (marks[k + 1] - marks[k])
            speeds[i] += rates[1] * (marks[k + 1] - marks[k])


class ScheduleIndex(NamedTuple):
    """Where to find the pieces that matter at a time."""

    #: First piece of each segment and, last, the number of pieces, shape (segments + 1,)
    first_pieces: Indices
    all_ended: Array  #: When the segment and all before it have ended [s], shape (segments,)
    none_begun: Array  #: Until when neither the segment nor any after it has begun [s], shape (segments,)


@njit(_nrt=False)
def _under_way(index: ScheduleIndex, times: Any) -> tuple[Any, Any]:
    """First segment under way and the one past the last at one time [s] or, in Python, at many."""
    first = np.searchsorted(index.all_ended, times, side="right")
    return first, np.maximum(first, np.searchsorted(index.none_begun, times, side="right"))


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


@njit(_nrt=False)
def _sample_all(
    chain: Chain, schedule: Schedule, index: ScheduleIndex, times: Array, out: Samples, room: Array
) -> None:
    """Write pose and rates at every time; ``room`` (2, 4) is room for the progress of one segment and the
    roll."""
    rates, roll = room[0], room[1]
    for n in range(times.shape[0]):
        tip, R, spin = out.tips[n], out.rotations[n], out.spins[n]
        first, stop = _under_way(index, times[n])
        roll[:] = 0.0
        for i in range(3):
            tip[0, i] = chain.tips[first, i]
            for d in range(1, 4):
                tip[d, i] = 0.0
            for j in range(3):
                R[i, j] = chain.rotations[first, i, j]
                spin[i, j] = 0.0
        for k in range(first, stop):
            progress_at(schedule, index, k, times[n], rates)
            for d in range(4):
                for i in range(3):
                    tip[d, i] += rates[d] * chain.lengths[k] * chain.directions[k, i]
                roll[d] += rates[d] * chain.rolls[k]
            if chain.angles[k] != 0.0:
                turn_on(chain.turn_axes[k], chain.angles[k], rates, R, spin)
        roll_on((roll[0], roll[1], roll[2], roll[3]), R, spin, out.axes[n])


@njit
def roll_on(roll: tuple[float, float, float, float], R: Array, spin: Array, axis: Array) -> None:
    """Put a roll, given with three derivatives, on frame ``R`` and its angular velocity; write ``axis`` (4,
    3)."""
    follow_axis(R, spin, axis)
    for i in range(3):
        spin[2, i] += roll[3] * axis[0, i] + 2.0 * roll[2] * axis[1, i] + roll[1] * axis[2, i]
        spin[1, i] += roll[2] * axis[0, i] + roll[1] * axis[1, i]
        spin[0, i] += roll[1] * axis[0, i]
    cosine, sine = math.cos(roll[0]), math.sin(roll[0])
    for i in range(3):
        x, y = R[i, 0], R[i, 1]
        R[i, 0], R[i, 1] = cosine * x + sine * y, cosine * y - sine * x


@njit
def progress_at(schedule: Schedule, index: ScheduleIndex, k: int, time: float, rates: Array) -> None:
    """Write progress of segment ``k`` at a time [s] and its three derivatives into ``rates`` (4,)."""
    begin, end = index.first_pieces[k], index.first_pieces[k + 1]
    rates[0] = rates[1] = rates[2] = rates[3] = 0.0
    if begin == end or time < schedule.starts[begin]:
        return
    piece = begin
    while piece + 1 < end and time >= schedule.starts[piece + 1]:
        piece += 1
    t = time - schedule.starts[piece]
    if piece + 1 == end and t >= schedule.durations[piece]:
        rates[0] = 1.0
        return
    c0, c1, c2, c3 = schedule.coefficients[piece]
    rates[0] = c0 + t * (c1 + t * (c2 + t * c3))
    rates[1] = c1 + t * (2.0 * c2 + 3.0 * t * c3)
    rates[2] = 2.0 * c2 + 6.0 * t * c3
    rates[3] = 6.0 * c3


@njit
def turn_on(n: Array, angle: float, rates: Array, R: Array, spin: Array) -> None:
    """Put one more turn about ``n`` on the left of frame ``R`` and of its angular velocity and
    derivatives."""
    phi, phi_1, phi_2, phi_3 = angle * rates[0], angle * rates[1], angle * rates[2], angle * rates[3]
    cosine, sine, rest = math.cos(phi), math.sin(phi), 2.0 * math.sin(0.5 * phi) ** 2
    for j in range(3):
        set_to(R[:, j], turn_about(n, cosine, sine, rest, R[:, j]))
        set_to(spin[j], turn_about(n, cosine, sine, rest, spin[j]))
    # (A w)' = phi' n x A w + A w', and once more.
    u = cross(n, spin[0])
    across = cross(n, plus(scaled(phi_1, u), scaled(2.0, spin[1])))
    add_to(spin[2], plus(plus(scaled(phi_3, n), scaled(phi_2, u)), scaled(phi_1, across)))
    add_to(spin[1], scaled(phi_2, n))
    add_to(spin[1], scaled(phi_1, u))
    add_to(spin[0], scaled(phi_1, n))


@njit(inline="always")
def follow_axis(R: Array, spin: Array, axis: Array) -> None:
    """Axis and derivatives from the angular velocity w: o' = w x o and so on."""
    w, dw, ddw, o = spin[0], spin[1], spin[2], axis[0]
    set_to(o, R[:, 2])
    set_to(axis[1], cross(w, o))
    set_to(axis[2], second_by_turning(w, dw, o))
    set_to(axis[3], third_by_turning(w, dw, ddw, o))
