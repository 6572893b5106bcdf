"""What the tool of two robots does on the part: pressed on it, or above it without touching (layer 9)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from polish_sim.cell import Job
from polish_sim.cell.feed_pace import feed_pace
from polish_sim.config import Scenario
from polish_sim.experiments.part_setup import (
    PlacedTool,
    placed_strokes,
    points_before,
    stretches_in_contact,
    travel_to,
)
from polish_sim.motion.timed_path import time_path
from polish_sim.motion.trajectory import build_path_table, with_set_points
from polish_sim.planning import ToolPath
from polish_sim.spatial import apply


def pair_strokes(scenario: Scenario, path: ToolPath, placed: PlacedTool) -> list[Job]:
    """The strokes of a path as ``run dual`` does them; with ``dual.standoff_m`` above 0 nothing is touched."""
    strokes = placed_strokes if scenario.dual.standoff_m == 0.0 else free_strokes
    return strokes(scenario, path, placed, 0.0, scenario.plan.clearance_m)


def lifted(path: ToolPath, standoff: float) -> ToolPath:
    """All of a path raised along its tool axes [m]; above the part it begins and ends with what is worked on."""
    if standoff == 0.0:
        return path
    on = np.flatnonzero(path.process)
    kept = (np.arange(len(path.s)) >= on[0]) & (np.arange(len(path.s)) <= on[-1])
    path = path.rows(kept)
    return replace(path, positions_work=path.positions_work + standoff * path.axes_work)


def free_strokes(scenario: Scenario, path: ToolPath, placed: PlacedTool, hold: float, lift: float) -> list[Job]:
    """Every stretch of a path followed where it is, without touching anything; between two the tool is lifted.

    Args:
        scenario: Feed.
        path: The path, work frame.
        placed: Where it is, and how the tool stands.
        hold: Time to stay at the end of a stretch [s].
        lift: Height of the retract between two stretches [m].

    Returns:
        The jobs in order, in the base frame.
    """
    process, stretches = scenario.process, stretches_in_contact(path)
    points, rotations = apply(placed.T_base_work, path.positions_work), placed.rotations
    pace = feed_pace(process.feed_m_s)
    jobs: list[Job] = []
    left = process.max_feed_s or math.inf
    for number, (first, last) in enumerate(stretches):
        during, down = slice(first, last + 1), slice(first - points_before(path, first), first + 1)
        table = build_path_table(points[during], rotations[during], path.s[during])
        feed = None if path.feed is None else path.feed[during] / process.feed_m_s
        table = with_set_points(table, path.s[during], None, feed)
        motion, start = time_path(table, pace), build_path_table(points[first][None], rotations[first][None])
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
