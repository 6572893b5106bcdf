"""What the tool of two robots does on the part: pressed on it, or above it without touching (layer 9)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.cell import Job
from polish_sim.cell.feed_pace import feed_pace
from polish_sim.config import Scenario
from polish_sim.errors import SmoothingError
from polish_sim.experiments.part_setup import (
    PlacedTool,
    placed_strokes,
    points_before,
    stretches_in_contact,
    travel_to,
)
from polish_sim.experiments.stroke_motion import CELL_LIMITS, Stroke, stroke_motion
from polish_sim.motion.smoothing.limits import SmoothingLimits
from polish_sim.motion.timed_path import TimedPath, time_path
from polish_sim.motion.trajectory import build_path_table, with_set_points
from polish_sim.planning import ToolPath
from polish_sim.spatial import apply

SPARE_S: Final = 1.0
"""Of feed that is planned beyond the most there may be: a feed comes to rest in less [s]."""


def pair_strokes(scenario: Scenario, path: ToolPath, placed: PlacedTool) -> list[Job]:
    """The strokes of a path as ``run dual`` does them; with ``dual.standoff_m`` above 0 nothing is touched.

    Raises:
        SmoothingError: The tool's motion cannot be made; of the follower's arm says what would do.
    """
    strokes = placed_strokes if scenario.dual.standoff_m == 0.0 else free_strokes
    kept = _fed_at_most(scenario, path)
    placed = placed._replace(rotations=placed.rotations[kept])
    try:
        return strokes(scenario, path.rows(kept), placed, 0.0, scenario.plan.clearance_m)
    except SmoothingError as error:
        if placed.arm is None:
            raise
        raise SmoothingError(
            f"the follower's motion, smoothed with the part where it starts: {error} Hold the part elsewhere with "
            "--part-pose, or stop earlier with --set process.max_feed_s=..."
        ) from error


def _fed_at_most(scenario: Scenario, path: ToolPath) -> NDArray[np.bool_]:
    """Points of a path the tool may come to in ``process.max_feed_s``, and a little beyond, mask (n,)."""
    process = scenario.process
    if process.max_feed_s == 0.0:
        return np.ones(len(path.s), dtype=bool)
    top = process.feed_m_s if path.feed is None else float(path.feed.max())
    on = path.process
    fed = np.cumsum(np.r_[0.0, np.where(on[1:] & on[:-1], np.diff(path.s), 0.0)])
    return np.asarray(np.r_[0.0, fed[:-1]] <= top * (process.max_feed_s + SPARE_S))


def air_limits(feed: float) -> SmoothingLimits:
    """Limits of a stroke above the part: position alone is held there, the tip is accelerated as gently as a feed."""
    pace = feed_pace(feed)
    return replace(
        CELL_LIMITS,
        tip_acceleration=min(pace.acceleration, CELL_LIMITS.tip_acceleration),
        tip_jerk=min(pace.jerk, CELL_LIMITS.tip_jerk),
    )


def lifted(path: ToolPath, standoff: float) -> ToolPath:
    """All of a path raised along its tool axes [m]; above the part it begins and ends with what is worked on."""
    if standoff == 0.0:
        return path
    on = np.flatnonzero(path.process)
    kept = (np.arange(len(path.s)) >= on[0]) & (np.arange(len(path.s)) <= on[-1])
    path = path.rows(kept)
    return replace(path, positions_work=path.positions_work + standoff * path.axes_work)


def is_gentle(motion: TimedPath, limits: SmoothingLimits) -> bool:
    """Whether a path's bends and its axes' turns take no more acceleration than a tool may have."""
    change = np.gradient(motion.velocities, motion.spacing, axis=0)
    along = motion.velocities / np.maximum(np.linalg.norm(motion.velocities, axis=1, keepdims=True), 1e-12)
    across = change - np.sum(change * along, axis=1, keepdims=True) * along
    axes = Rotation.from_quat(motion.quaternions, scalar_first=True).as_matrix()[:, :, 2]
    turning = np.gradient(np.cross(motion.spins, axes), motion.spacing, axis=0)
    # Where it begins and ends it has no direction.
    bends, turns = (np.linalg.norm(rate[2:-2], axis=1) for rate in (across, turning))
    return bool(np.all(bends <= limits.tip_acceleration) and np.all(turns <= limits.axis_acceleration))


def free_strokes(scenario: Scenario, path: ToolPath, placed: PlacedTool, hold: float, lift: float) -> list[Job]:
    """Every stretch of a path followed where it is, without touching anything; between two the tool is lifted.

    A stretch with bends too sharp for the feed is smoothed as strokes on the part are, with gentler limits.

    Args:
        scenario: Feed, smoothing.
        path: The path, work frame.
        placed: Where it is, and how the tool stands.
        hold: Time to stay at the end of a stretch [s].
        lift: Height of the retract between two stretches [m].

    Returns:
        The jobs in order, in the base frame.
    """
    process, stretches = scenario.process, stretches_in_contact(path)
    limits = air_limits(process.feed_m_s)
    points, rotations = apply(placed.T_base_work, path.positions_work), placed.rotations
    pace = feed_pace(process.feed_m_s)
    jobs: list[Job] = []
    left = process.max_feed_s or math.inf
    for number, (first, last) in enumerate(stretches):
        during, down = slice(first, last + 1), slice(first - points_before(path, first), first + 1)
        table = build_path_table(points[during], rotations[during], path.s[during])
        feed = np.full(last + 1 - first, process.feed_m_s) if path.feed is None else path.feed[during]
        table = with_set_points(table, path.s[during], None, feed / process.feed_m_s)
        stroke = Stroke(points[during], rotations[during], path.s[during] - path.s[first], feed, limits)
        motion = time_path(table, pace)
        if scenario.smoothing.limits_file or not is_gentle(motion, limits):
            motion = stroke_motion(scenario, stroke, placed.arm) or motion
        start = build_path_table(points[first][None], rotations[first][None])
        more = number + 1 < len(stretches) and left > motion.playing_time
        job = Job(
            travel=travel_to(jobs, points[down], rotations[down]) if jobs else time_path(start, pace),
            lead_in=start, process=table, motion=motion, depth=0.0, force=0.0, contact=0.0,
            approach_speed=process.approach_speed_m_s, feed=process.feed_m_s, threshold=math.inf,
            search_depth=0.0, hold=hold, feed_time=left, lift=lift if more else 0.0, start_s=float(path.s[first]),
        )  # fmt: skip
        jobs.append(job)
        left -= motion.playing_time
        if not more:
            break
    return jobs
