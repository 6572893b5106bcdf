"""Where the tool is on the part and how far the master has come by then: what two robots do, over time (layer 9)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.cell import Job
from polish_sim.cell.carrier import RAMP_S, time_held, time_let_go
from polish_sim.cell.stroke import RETRACT_SPEED, TOUCH_DOWN_TIME

Array = NDArray[np.float64]

FEWEST: Final = 3  # visits of every move, however short it is
BEYOND_S: Final = 1.0  # of the master's motion, as long as a feed takes to come to rest [s]
ON_THE_WAY: Final = -1  # to a stroke or from it


class Visits(NamedTuple):
    """Moments of the work, n of them in order; work frame."""

    points: Array
    """Tool points, pressed in [m], shape (n, 3)."""
    axes: Array
    """Unit tool axes from the part to the tool, shape (n, 3)."""
    s: Array
    """Place on the path [m], never falling, shape (n,)."""
    time: Array
    """Since the start of the work, contact where it is expected [s], shape (n,)."""
    clock: Array
    """Time of the master's motion: it passes while the tool is fed along the part [s], shape (n,)."""
    rate: Array
    """At which it passes [-], shape (n,)."""
    meant: Array
    """Time of the master's motion the tool's turn about its axis is meant for: it is kept while the tool is lifted and
    the master comes to rest [s], shape (n,)."""
    stroke: NDArray[np.int64]
    """Which stroke is being fed, from 0, or ``ON_THE_WAY``, shape (n,)."""

    def clock_at(self, s: Array) -> Array:
        """Time of the master's motion at places on the path, (k,) [m] -> (k,) [s].

        Beyond a feed that is broken off it goes on for a while as it went: the tool's turn has no bend there.
        """
        fed = np.flatnonzero(self.stroke != ON_THE_WAY)
        s_fed, clock = self.s[fed], self.clock[fed]
        slowness = (clock[-1] - clock[-2]) / max(s_fed[-1] - s_fed[-2], 1e-9)
        beyond = np.minimum(slowness * np.maximum(s - s_fed[-1], 0.0), BEYOND_S)
        return np.asarray(np.interp(s, s_fed, clock) + beyond)


def plan_visits(jobs: Sequence[Job], step: float) -> Visits:
    """Follow strokes from beginning to end as the cell does if contact is where it is expected.

    Args:
        jobs: The strokes, in the work frame.
        step: Time between visits, at most [s].
    """
    done: list[Visits] = []
    time = clock = meant = 0.0
    for number, job in enumerate(jobs):
        for visits in _moves(job, number, step, meant - clock):
            done.append(
                visits._replace(time=time + visits.time, clock=clock + visits.clock, meant=clock + visits.meant)
            )
            time = float(done[-1].time[-1])
        clock, meant = float(done[-1].clock[-1]), float(done[-1].meant[-1])
    return Visits(*(np.concatenate(columns) for columns in zip(*done, strict=True)))


def _moves(job: Job, number: int, step: float, meant: float) -> Iterator[Visits]:
    """Travel, way down, feed and way up of a stroke; time from each move's beginning, clock from the stroke's.

    What the tool's turn was meant for as the last stroke ended, ``meant``, is led to the stroke's beginning meanwhile.
    """
    if number > 0:
        times = _times(job.travel.duration, step)
        rows = np.rint(times / job.travel.spacing).astype(int)
        yield _resting(job.travel.positions[rows], _axes(job.travel.quaternions[rows]), job.start_s, times)._replace(
            meant=np.linspace(meant, 0.0, len(rows))
        )
    if job.contact > 0.0:
        times = _times(job.lead_in.length / job.approach_speed, step)
        rows = np.rint(times * job.approach_speed / job.lead_in.spacing).astype(int)
        yield _resting(job.lead_in.positions[rows], _axes(job.lead_in.quaternions[rows]), job.start_s, times)
    fed = _fed(job, number, step)
    yield fed
    lift = job.lift + job.depth if job.lift > 0.0 else 0.0
    times = _times(max(lift / RETRACT_SPEED, RAMP_S), step)
    up = fed.points[-1] + np.minimum(RETRACT_SPEED * times, lift)[:, None] * fed.axes[-1]
    held = time_held(float(fed.time[-1]) - _touching(job), times)
    yield _resting(up, np.repeat(fed.axes[-1:], len(times), axis=0), float(fed.s[-1]), times)._replace(
        clock=fed.clock[-1] + held.clock, rate=held.rate, meant=np.full(len(times), fed.clock[-1])
    )


def _fed(job: Job, number: int, step: float) -> Visits:
    """A stroke's feed, at the largest rates its motion may be played at."""
    motion = job.motion
    slowness = 1.0 / motion.rates
    played = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]) * motion.spacing)]
    if motion.duration == 0.0:
        played *= 0.0
    end = min(float(played[-1]), job.feed_time)
    rows = np.clip(np.searchsorted(played, _times(end, step)), 0, len(played) - 1)
    master = time_let_go(played[rows])
    return Visits(
        motion.positions[rows], _axes(motion.quaternions[rows]), job.start_s + motion.places[rows],
        played[rows] + _touching(job), master.clock, master.rate, master.clock,
        np.full(len(rows), number),
    )  # fmt: skip


def _resting(points: Array, axes: Array, s: float, times: Array) -> Visits:
    """A move in the air, the master at rest."""
    n, still = len(times), np.zeros(len(times))
    return Visits(points, axes, np.full(n, s), times, still, still, still, np.full(n, ON_THE_WAY))


def _touching(job: Job) -> float:
    """How long touch-down takes before the feed [s]."""
    return TOUCH_DOWN_TIME if job.contact > 0.0 else 0.0


def _times(duration: float, step: float) -> Array:
    return np.linspace(0.0, duration, max(FEWEST, math.ceil(duration / step) + 1))


def _axes(quaternions: Array) -> Array:
    """From the part to the tool, for tool frames as wxyz (n, 4), shape (n, 3)."""
    return np.asarray(-Rotation.from_quat(quaternions, scalar_first=True).as_matrix()[:, :, 2])


__all__ = ["ON_THE_WAY", "Visits", "plan_visits"]
