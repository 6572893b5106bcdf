"""Experiment ``arc``: the tool point on a circle at constant feed, in free space (paper 1, fig. 12)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from polish_sim.analysis.metrics import PAPER_ARC, measure_arc
from polish_sim.cell import SILENT, Observer, tool_on_flange
from polish_sim.config import Checked
from polish_sim.experiments.assembly import kept_place
from polish_sim.experiments.beliefs import believe_tool
from polish_sim.experiments.free_space import free_cell
from polish_sim.experiments.part_setup import random_streams
from polish_sim.experiments.placement import check_whole_path, find_reach, tool_rotations
from polish_sim.experiments.registry import CheckedPath
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.motion.trajectory import build_path_table
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length
from polish_sim.spatial import turned

TOOL_AXIS = np.array([0.0, 0.0, 1.0])  # the tool points straight down [-]


def arc_path() -> ToolPath:
    """The circle of paper 1, once round, in the base frame, starting at its horizontal extreme."""
    points, normal, center = 1257, PAPER_ARC.normal, PAPER_ARC.center
    across = np.array([-normal[1], normal[0], 0.0])
    angle = np.linspace(0.0, 2.0 * math.pi, points)
    positions = center + PAPER_ARC.radius * turned(across, np.cross(normal, across), angle)
    return ToolPath(
        positions,
        np.tile(TOOL_AXIS, (points, 1)),
        arc_length(positions),
        np.zeros(points, np.int64),
        np.full(points, PROCESS, np.int8),
        np.zeros(points),
    )


def prepare_arc(scenario: Checked, observer: Observer = SILENT) -> CheckedPath:
    """Check that the arm can do the circle, which is the same in every scenario.

    Raises:
        ReachError: If it cannot; names the first bad point.
    """
    return kept_place(scenario, _circle)


def _circle() -> CheckedPath:
    path, T_flange_tool = arc_path(), tool_on_flange()
    reach = find_reach(path.positions_work, path.axes_work, [np.eye(4)], T_flange_tool, above_table=False)
    check_whole_path(reach, path.positions_work, path.axes_work, T_flange_tool)
    return CheckedPath(path, reach)


def run_arc(scenario: Checked, observer: Observer = SILENT) -> RunResult:
    """Follow the circle and measure speed and distance from it; part, plan, pad and spindle play no role.

    Raises:
        ReachError: If the arm cannot do the circle.
    """
    path, reach, _ = prepare_arc(scenario)
    table = build_path_table(path.positions_work, tool_rotations(path.axes_work, reach.spin))
    start = build_path_table(path.positions_work[:1], tool_rotations(path.axes_work[:1], reach.spin))
    free = replace(scenario, spindle=replace(scenario.spindle, speed_rpm=0.0))
    observer.stage("simulate")
    rng = np.random.default_rng(scenario.seed)
    cell = free_cell(free, start, table, scenario.process.feed_m_s, reach.q_start, rng)
    believe_tool(cell, random_streams(scenario.seed).payload)
    run = cell.run(observer)
    done = run.trace.path_s_m[-1] / table.length
    figures = measure_arc(run.trace) | common_figures(run, scenario, done, None)
    return RunResult(
        scenario, run.log, run.trace, figures, run.stop_reason, run.interrupted, path, None,
        run.files,
    )  # fmt: skip
