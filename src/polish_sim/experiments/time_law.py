"""How long the smoothed motion along a path takes and where it is slower than the feed (layer 9)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.cell import Job
from polish_sim.config import Scenario
from polish_sim.errors import SmoothingError
from polish_sim.experiments.stroke_motion import Stroke, stroke_motion
from polish_sim.motion.timed_path import TimedPath
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import rotation_to_axis

Array = NDArray[np.float64]

KEPT = 0.99
"""Share of the feed from which it counts as kept [-]."""
END_M = 0.001
"""At the ends of a stroke the tool comes from rest and goes to rest: so far the least feed is not looked for [m]."""


class FedStroke(NamedTuple):
    """The motion of one stroke and where it begins."""

    motion: TimedPath
    start_s: float
    """Arc length of the path [m]."""
    feed: float
    """Feed of the process [m/s]."""


def feed_figures(strokes: Sequence[FedStroke]) -> dict[str, float]:
    """Figures of the time law of all strokes.

    Args:
        strokes: The strokes in order.

    Returns:
        motion_time_s: of the strokes in contact; feed_kept: share of the way at ``KEPT`` of the feed or more;
        feed_least_m_s and feed_least_at_m: least feed away from the strokes' ends, and where on the path.
    """
    times, lengths, kept, slowest = 0.0, 0.0, 0.0, (math.nan, math.nan)
    for motion, start, feed in strokes:
        fed = motion.speeds * motion.rates
        steps = np.diff(motion.places)
        times += motion.playing_time
        lengths += float(steps.sum())
        kept += float(steps[np.minimum(fed[1:], fed[:-1]) >= KEPT * feed].sum())
        inner = np.flatnonzero((motion.places > END_M) & (motion.places < motion.places[-1] - END_M))
        if len(inner):
            row = inner[fed[inner].argmin()]
            if not fed[row] >= slowest[0]:
                slowest = (float(fed[row]), start + float(motion.places[row]))
    return {
        "motion_time_s": times,
        "feed_kept": kept / lengths if lengths > 0.0 else math.nan,
        "feed_least_m_s": slowest[0],
        "feed_least_at_m": slowest[1],
    }


def feed_of_jobs(jobs: Sequence[Job]) -> dict[str, float]:
    """``feed_figures`` of the jobs a cell is given."""
    return feed_figures([FedStroke(job.motion, job.start_s, job.feed) for job in jobs])


def time_law(scenario: Scenario, path: ToolPath) -> dict[str, float]:
    """``feed_figures`` of a path on the part without a robot: limits of the tool alone, the path not pressed in.

    Args:
        scenario: Feed, smoothing.
        path: The path.

    Returns:
        The figures; undefined ones for a path that cannot be smoothed.
    """
    strokes: list[FedStroke] = []
    for rows in _stretches(path):
        feed = np.full(len(rows), scenario.process.feed_m_s) if path.feed is None else path.feed[rows]
        tips, into = path.positions_work[rows], -path.axes_work[rows]
        hint = np.eye(3)[int(np.abs(into).max(axis=0).argmin())]
        try:
            stroke = Stroke(tips, rotation_to_axis(into, hint), path.s[rows] - path.s[rows[0]], feed)
            motion = stroke_motion(scenario, stroke, None)
        except SmoothingError:
            return dict.fromkeys(feed_figures(()), math.nan)
        if motion is not None:
            strokes.append(FedStroke(motion, float(path.s[rows[0]]), scenario.process.feed_m_s))
    return feed_figures(strokes)


def _stretches(path: ToolPath) -> list[NDArray[np.int64]]:
    """Rows of every stretch in contact."""
    rows = np.flatnonzero(path.process)
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []
