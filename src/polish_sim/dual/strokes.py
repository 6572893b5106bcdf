"""Strokes of the tool on the part or above it, and when it is where, with the master's motion meanwhile."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    evenly_to,
    joined,
    midpoints,
    running_sums,
)
from polish_sim.cell import Stroke
from polish_sim.cell.stroke import LIFT_ACCELERATION, RETRACT_SPEED, TOUCH_DOWN_TIME, feed_pace
from polish_sim.config import Checked, ProcessConfig
from polish_sim.dual.carrier import RAMP_S, time_held, time_let_go
from polish_sim.experiments.part_setup import PlacedTool, placed_strokes
from polish_sim.experiments.stroke_motion import CELL_LIMITS
from polish_sim.motion.rules.limits import SmoothingLimits
from polish_sim.planning import ToolPath
from polish_sim.spatial import matrices

#: Of feed that is planned beyond the most there may be: a feed comes to rest in less [s]
SPARE_S = 1.0
FEWEST = 3  # visits of every move, however short it is
BEYOND_S = 1.0  # of the master's motion, as long as a feed takes to come to rest [s]
ON_THE_WAY = -1  # to a stroke or from it


def pair_strokes(scenario: Checked, path: ToolPath, placed: PlacedTool) -> list[Stroke]:
    """The strokes of a path as ``run dual`` does them; with ``dual.standoff_m`` above 0 nothing is touched.

    The tool's limits alone count: joints of the follower depend on how the part moves meanwhile, and
    `check_motion` follows them. Raises SmoothingError if the tool's motion is impossible.
    """
    kept = _fed_at_most(scenario.process, path)
    placed = placed._replace(rotations=placed.rotations[kept])
    air = air_limits(scenario.process.feed_m_s) if scenario.dual.standoff_m else None
    return placed_strokes(scenario, path.rows(kept), placed, 0.0, scenario.plan.clearance_m, air=air)


def _fed_at_most(process: ProcessConfig, path: ToolPath) -> Bools:
    """Points of a path the tool may reach in ``process.max_feed_s``, and a little beyond, mask (n,)."""
    if process.max_feed_s == 0.0:
        return np.ones(len(path.s), dtype=bool)
    top = process.feed_m_s if path.feed is None else path.feed.max()
    on = path.process
    fed = running_sums(np.where(on[1:] & on[:-1], np.diff(path.s), 0.0))
    return np.r_[0.0, fed[:-1]] <= top * (process.max_feed_s + SPARE_S)


def air_limits(feed: float) -> SmoothingLimits:
    """Limits of a stroke above the part: position alone is held there, the tip is accelerated as gently as a
    feed."""
    pace = feed_pace(feed)
    return replace(
        CELL_LIMITS,
        tip_acceleration=min(pace.acceleration, CELL_LIMITS.tip_acceleration),
        tip_jerk=min(pace.jerk, CELL_LIMITS.tip_jerk),
    )


def lifted(path: ToolPath, standoff: float) -> ToolPath:
    """All of a path raised along its tool axes [m]; above the part it begins and ends with what is worked
    on."""
    if standoff == 0.0:
        return path
    on = np.flatnonzero(path.process)
    kept = (np.arange(len(path.s)) >= on[0]) & (np.arange(len(path.s)) <= on[-1])
    path = path.rows(kept)
    return replace(path, positions_work=path.positions_work + standoff * path.axes_work)


class Visits(NamedTuple):
    """Moments of the work, n of them in order; work frame."""

    points: Array  #: Tool points, pressed in [m], shape (n, 3)
    axes: Array  #: Unit tool axes from the part to the tool, shape (n, 3)
    s: Array  #: Place on the path [m], never falling, shape (n,)
    time: Array  #: Since the start of the work, contact where it is expected [s], shape (n,)
    #: Time of the master's motion: it passes while the tool is fed along the part [s], shape (n,)
    clock: Array
    rate: Array  #: At which it passes [-], shape (n,)
    meant: Array
    """Time of the master's motion for which the tool's turn about its axis is planned: it is kept while the
    tool is lifted and the master comes to rest [s], shape (n,)."""
    stroke: Indices  #: Which stroke is being fed, from 0, or ``ON_THE_WAY``, shape (n,)

    def clock_at(self, s: Array) -> Array:
        """Time of the master's motion at places on the path, (k,) [m] -> (k,) [s].

        Beyond a feed that is cut short it continues as before: the tool's turn has no bend there.
        """
        fed = np.flatnonzero(self.stroke != ON_THE_WAY)
        s_fed = self.s[fed]
        clock = self.clock[fed]
        slowness = (clock[-1] - clock[-2]) / max(s_fed[-1] - s_fed[-2], 1e-9)
        beyond = np.minimum(slowness * np.maximum(s - s_fed[-1], 0.0), BEYOND_S)
        return np.interp(s, s_fed, clock) + beyond


def plan_visits(strokes: Sequence[Stroke], step: float) -> Visits:
    """Follow strokes (work frame) as the cell does if contact is where it is expected; visits ``step`` [s]
    apart."""
    done: list[Visits] = []
    time = clock = meant = 0.0
    for number, stroke in enumerate(strokes):
        for visits in _moves(stroke, number, step, meant - clock):
            done.append(
                visits._replace(
                    time=time + visits.time, clock=clock + visits.clock, meant=clock + visits.meant
                )
            )
            time = done[-1].time[-1]
        clock = done[-1].clock[-1]
        meant = done[-1].meant[-1]
    return Visits(*joined(done))


def _moves(stroke: Stroke, number: int, step: float, meant: float) -> Iterator[Visits]:
    """Travel, way down, feed and way up of a stroke; time from each move's beginning, clock from the
    stroke's.

    ``meant`` goes from its value at the end of the last stroke to zero during the travel.
    """
    if number > 0:
        times = _times(stroke.travel.duration, step)
        rows = np.rint(times / stroke.travel.spacing).astype(int)
        yield _resting(
            stroke.travel.positions[rows], _axes(stroke.travel.quaternions[rows]), stroke.start_s, times
        )._replace(meant=np.linspace(meant, 0.0, len(rows)))
    if stroke.contact:
        times = _times(stroke.lead_in.length / stroke.approach_speed, step)
        rows = np.rint(times * stroke.approach_speed / stroke.lead_in.spacing).astype(int)
        yield _resting(
            stroke.lead_in.positions[rows], _axes(stroke.lead_in.quaternions[rows]), stroke.start_s, times
        )
    touch_down = TOUCH_DOWN_TIME if stroke.contact else 0.0
    fed = _fed(stroke, number, step, touch_down)
    yield fed
    lift, takes = stroke.way_up
    times = _times(max(takes, RAMP_S), step)
    ramp = RETRACT_SPEED / LIFT_ACCELERATION
    begun, ending = (np.clip(times - start, 0.0, ramp) for start in (0.0, takes - ramp))
    level = np.clip(times - ramp, 0.0, takes - 2.0 * ramp) + ending
    risen = 0.5 * LIFT_ACCELERATION * (begun**2 - ending**2) + RETRACT_SPEED * level
    up = fed.points[-1] + np.clip(risen, 0.0, lift)[:, None] * fed.axes[-1]
    clock, rate = time_held(fed.time[-1] - touch_down, times)
    yield _resting(up, np.repeat(fed.axes[-1:], len(times), axis=0), fed.s[-1], times)._replace(
        clock=fed.clock[-1] + clock, rate=rate, meant=np.full(len(times), fed.clock[-1])
    )


def _fed(stroke: Stroke, number: int, step: float, touch_down: float) -> Visits:
    """A stroke's feed after its touch-down [s], at the largest rates its motion may be played at."""
    motion = stroke.motion
    played = running_sums(midpoints(1.0 / motion.rates) * motion.spacing)
    if motion.duration == 0.0:
        played *= 0.0
    end = min(played[-1], stroke.feed_time)
    rows = np.clip(np.searchsorted(played, _times(end, step)), 0, len(played) - 1)
    clock, rate = time_let_go(played[rows])
    return Visits(
        motion.positions[rows], _axes(motion.quaternions[rows]), stroke.start_s + motion.places[rows],
        played[rows] + touch_down, clock, rate, clock,
        np.full(len(rows), number),
    )  # fmt: skip


def _resting(points: Array, axes: Array, s: float, times: Array) -> Visits:
    """A move in the air, the master at rest."""
    n = len(times)
    still = np.zeros(len(times))
    return Visits(points, axes, np.full(n, s), times, still, still, still, np.full(n, ON_THE_WAY))


def _times(duration: float, step: float) -> Array:
    return evenly_to(duration, step, FEWEST - 1)


def _axes(quaternions: Array) -> Array:
    """From the part to the tool, for tool frames as wxyz (n, 4), shape (n, 3)."""
    return -matrices(quaternions)[:, :, 2]
