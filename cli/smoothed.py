"""What `polish-sim smooth` does: motion, files, pictures and table; imported only inside it."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from polish_sim.arms import FIRST
from polish_sim.cli import console
from polish_sim.cli.options import Given
from polish_sim.errors import InputError, PolishSimError, count_text, first_twice, number_text
from polish_sim.exchange import WayPoints, plan_facts, read_way_points, refuse_unknown
from polish_sim.motion import use_arm
from polish_sim.motion.rules.deviation import measure_deviation
from polish_sim.motion.rules.limits import ORDERS, SmoothingLimits, limits_toml, load_limits
from polish_sim.motion.rules.schedule import RULES, check_rule
from polish_sim.page import Table, figure_rows
from polish_sim.planning import PlanObserver
from polish_sim.row_file import Metrics, put_file, save_plots, write_metrics
from polish_sim.smoothing.figures import (
    MeasuredMotion,
    even_times,
    find_peaks,
    sample_in_blocks,
    smoothing_figures,
    write_trajectory,
)
from polish_sim.smoothing.place import (
    SmoothingTask,
    feeds_on_way,
    path_without_robot,
    place_path,
    prepare_rule,
    smooth_path,
)
from polish_sim.smoothing.plots import draw_smoothing

LIMITS = "limits.toml"
LONGEST_H = 2.0  #: Of a motion [h]: every hour of it takes about a minute and 3.5 GB of memory
MANY = 20_000  #: A path of more segments is smoothed by the rules asked for only


def smooth_file(
    path: Path, given: Given, folder: Path, observer: PlanObserver
) -> tuple[dict[str, Any], list[str]]:
    """Read and smooth a path, measure the motion, write all files into a folder; returns figures and
    notes."""
    rules = [rule for rule in (given["--rule"] or "spline", given["--against"]) if rule is not None]
    for rule in rules:
        check_rule("rule", rule, RULES)
    if twice := first_twice(rules):
        raise InputError(
            f"--against {twice} is the rule itself: there would be nothing to compare. Name another."
        )
    notes: list[str] = []
    limits = SmoothingLimits() if given["--limits"] is None else load_limits(given["--limits"])
    observer.stage("read the path")
    lenient = (lambda error: notes.append(f"left out: {error}")) if given["--lenient"] else refuse_unknown
    points = read_way_points(path, lenient)
    if points.assumed:
        notes.append(points.assumed)
    task = _prepare(path, given, points, limits, observer, notes)
    motions = [_smooth(task, rule, observer) for rule in rules]
    figures = smoothing_figures(motions[0], task.placed.chain, points, task.placed.rows)
    figures |= {"tolerance_m": task.tolerance, "axis_tolerance_rad": task.axis_tolerance}
    figures["cycle_time_by_rule_s"] = _times_by_rule(task, motions, observer, notes)
    figures["T_base_work"] = task.placed.arm and task.placed.arm.T_base_work
    for other in motions[1:]:
        figures["against"] = smoothing_figures(other, task.placed.chain, points, task.placed.rows)
    observer.stage("write")
    first = motions[0]
    times = even_times(first.motion.end, given["--rate"] or 500.0)
    write_trajectory(folder, sample_in_blocks(first.motion, times, task.placed.arm))
    put_file(folder, LIMITS, limits_toml(task.limits))
    write_metrics(folder, {**figures, "notes": notes})
    observer.stage("draw")
    save_plots(folder, draw_smoothing(task, motions, path.name))
    return figures, notes


def _prepare(
    path: Path,
    given: Given,
    points: WayPoints,
    limits: SmoothingLimits,
    observer: PlanObserver,
    notes: list[str],
) -> SmoothingTask:
    """Place the path and collect what it is to be smoothed by."""
    facts = plan_facts(path)
    if given["--no-joints"]:
        placed = path_without_robot(points)
    else:
        observer.stage("place it before the robot")
        use_arm((facts.get("proof") or {}).get("arm", FIRST))
        placed = place_path(points, given["--part-pose"] or ())
    if repeated := len(points.path.s) - len(placed.rows):
        notes.append(f"{count_text(repeated, 'repeated point')} left out")
    if given["--feed"] is not None:
        limits = replace(limits, tip_speed=given["--feed"])
        feeds = None
    else:
        feeds = feeds_on_way(points.path, placed.rows)
        if planned := facts.get("feed_m_s"):
            notes.append(f"the plan's feed is no limit here: --feed {number_text(1e3 * planned)} keeps it")
    speed = limits.tip_speed if feeds is None else np.minimum(feeds, limits.tip_speed)
    hours = (placed.chain.lengths / speed).sum() / 3600.0
    if hours > LONGEST_H:
        raise InputError(
            f"'{path}' takes at least {hours:.3g} h at its feed; a motion of more than {LONGEST_H:g} "
            "h is not smoothed in one piece. Set a higher --feed, or divide the path."
        )
    tip, axis = (
        default if given[name] is None else given[name]
        for name, default in (("--tolerance", 2e-5), ("--axis-tolerance", math.radians(0.02)))
    )
    return SmoothingTask(placed, limits, tip, axis, feeds)


def _smooth(task: SmoothingTask, rule: str, observer: PlanObserver) -> MeasuredMotion:
    """Smooth by a rule, compiled before its time is taken, and measure the motion."""
    observer.stage(f"smooth by {rule}")
    prepare_rule(task, rule)
    begin = time.perf_counter()
    motion = smooth_path(task, rule)
    took = time.perf_counter() - begin
    observer.stage("measure")
    placed = task.placed
    peaks, off = find_peaks(motion, placed.arm), measure_deviation(motion, placed.chain)
    return MeasuredMotion(rule, motion, peaks, off, task.limits, took)


def _times_by_rule(
    task: SmoothingTask, motions: Sequence[MeasuredMotion], observer: PlanObserver, notes: list[str]
) -> dict[str, float | None]:
    """Cycle time of every rule [s]; none where a rule finds no motion, with a note why."""
    times: dict[str, float | None] = {each.rule: each.motion.end for each in motions}
    few = len(task.placed.chain.lengths) <= MANY
    for rule in RULES:
        if rule in times or not few:
            continue
        observer.stage(f"smooth by {rule}")
        try:
            times[rule] = smooth_path(task, rule).end
        except PolishSimError as error:
            times[rule] = None
            notes.append(f"{rule} finds no motion: {error}")
    return {rule: times[rule] for rule in RULES if rule in times}


def show_smoothing(name: str, figures: Metrics) -> None:
    """Print the table of figures."""
    columns = [figures] + ([figures["against"]] if "against" in figures else [])
    times = figures["cycle_time_by_rule_s"]
    rows = [*ROWS, *((f"cycle time by {rule}", "s", rule, ".3f") for rule in times)]
    shown = figure_rows(rows, figures | times, *columns[1:])
    console.table(Table(f"{name}, smoothed", ["figure", "unit", *(m["rule"] for m in columns)], shown))


ROWS = (
    ("segments", "", "segments", ".0f"),
    ("path length", "mm", "path_length_m", ".1f"),
    ("cycle time", "s", "cycle_time_s", ".3f"),
    ("tip off the path, at most", "µm", "tip_deviation_contour_max_m", ".2f"),
    ("corner off the tip's way, at most", "µm", "tip_deviation_vertex_max_m", ".2f"),
    ("tool axis off its path, at most", "deg", "axis_deviation_max_rad", ".4f"),
    *(
        (f"{part} {order}, peak / limit", "", f"{part}_{order}_ratio_max", ".4f")
        for part in ("tool", "axis", "joint")
        for order in ORDERS
    ),
    ("planned, segments per second", "1/s", "segments_per_s", ".0f"),
)
"""Figures that are shown."""
