"""Smooths a path for its command and writes its folder; imported only inside commands."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.analysis.run_record import METRICS, package_versions, write_json
from polish_sim.cli.given_plan import plan_facts
from polish_sim.cli.smoothing_outcome import SmoothOutcome
from polish_sim.cli.smoothing_pictures import draw_smoothing
from polish_sim.errors import InputError, PolishSimError, unknown_name
from polish_sim.exchange import Unknown, WayPoints, read_way_points, refuse_unknown
from polish_sim.experiments.report import save_plots
from polish_sim.experiments.stroke_motion import STROKE_RULES
from polish_sim.motion.rules.limits import SmoothingLimits, limits_toml, load_limits
from polish_sim.motion.rules.rule import RULES
from polish_sim.planning import PlanObserver
from polish_sim.smoothing.figures import Measured, measure_smoothing, sample_in_blocks, smoothing_figures
from polish_sim.smoothing.place import (
    SmoothingTask,
    feeds_on_way,
    path_without_robot,
    place_path,
    prepare_rule,
    smooth_path,
)
from polish_sim.smoothing.trajectory_file import even_times, write_trajectory

LIMITS = "limits.toml"
MANY = 20_000
"""A path of more segments is smoothed by the rules asked for only."""


class SmoothRequest(NamedTuple):
    """What was asked for, in SI."""

    path: Path
    rules: tuple[str, ...]
    """The rule, and one to be put beside it if wanted."""
    tolerance: float
    """[m]."""
    axis_tolerance: float
    """[rad]."""
    limits: Path | None
    feed: float | None
    """[m/s]."""
    pose: tuple[float, ...] | None
    """Pose of the path's frame in the robot's base [m, rad]; empty: to be chosen; None: no robot."""
    lenient: bool
    rate: float
    """[Hz]."""


def smooth_file(request: SmoothRequest, folder: Path, observer: PlanObserver) -> SmoothOutcome:
    """Read a path, smooth it, measure the motion and write all files into a folder.

    Args:
        request: What was asked for.
        folder: An existing folder.
        observer: Told of the progress.

    Returns:
        What is to be shown.

    Raises:
        PolishSimError: The path or the limits cannot be used, or no motion keeps to them; says where.
    """
    _check_rules(request.rules)
    notes: list[str] = []
    limits = load_limits(request.limits) if request.limits is not None else SmoothingLimits()
    observer.stage("read the path")
    points = read_way_points(request.path, _unknown(request, notes))
    if points.assumed:
        notes.append(points.assumed)
    task = _prepare(request, points, limits, observer, notes)
    motions = [_smooth(task, rule, observer) for rule in request.rules]
    figures = smoothing_figures(motions[0], task.placed.chain, points, task.placed.rows)
    figures |= {"tolerance_m": request.tolerance, "axis_tolerance_rad": request.axis_tolerance}
    figures["cycle_time_by_rule_s"] = _times_by_rule(task, motions, observer, notes)
    figures["T_base_work"] = None if task.placed.arm is None else task.placed.arm.T_base_work
    for other in motions[1:]:
        figures["against"] = smoothing_figures(other, task.placed.chain, points, task.placed.rows)
    observer.stage("write")
    _write(task, motions, folder, request.rate)
    write_json(folder / METRICS, figures | {"notes": notes, "versions": package_versions()})
    observer.stage("draw")
    save_plots(folder, draw_smoothing(task, motions, request.path.name))
    return SmoothOutcome(request.path.name, figures, notes)


def _check_rules(rules: Sequence[str]) -> None:
    """Refuse rules there are not, and one that would be compared with itself."""
    for rule in rules:
        if rule in STROKE_RULES and rule not in RULES:
            raise InputError(
                f"rule '{rule}' is for strokes on a part only ('run surface --set smoothing.rule={rule}'): it needs "
                f"their arc length and feed. For any path: {', '.join(sorted(RULES))}."
            )
        if rule not in RULES:
            raise unknown_name("rule", rule, RULES)
    if len(set(rules)) < len(rules):
        raise InputError(f"--against {rules[1]} is the rule itself: there would be nothing to compare. Name another.")


def _unknown(request: SmoothRequest, notes: list[str]) -> Unknown:
    """What becomes of words nobody knows: refused, or left out and told."""
    return (lambda error: notes.append(f"left out: {error}")) if request.lenient else refuse_unknown


def _prepare(
    request: SmoothRequest, points: WayPoints, limits: SmoothingLimits, observer: PlanObserver, notes: list[str]
) -> SmoothingTask:
    """Place the path and collect what it is to be smoothed by."""
    if request.pose is None:
        placed = path_without_robot(points)
    else:
        observer.stage("place it before the robot")
        up = plan_facts(request.path).get("up")
        placed = place_path(points, None if up is None else np.array(up, dtype=float), request.pose)
    repeated = len(points.path.s) - len(placed.rows)
    if repeated:
        notes.append(f"{repeated} points that repeat the one before them are left out")
    if request.feed is not None:
        limits, feeds = replace(limits, tip_speed=request.feed), None
    else:
        feeds = feeds_on_way(points.path, placed.rows)
    return SmoothingTask(placed, limits, request.tolerance, request.axis_tolerance, feeds)


def _smooth(task: SmoothingTask, rule: str, observer: PlanObserver) -> Measured:
    """Smooth by a rule, compiled before its time is taken, and measure the motion."""
    observer.stage(f"smooth by {rule}")
    prepare_rule(task, rule)
    begin = time.perf_counter()
    smoothed = smooth_path(task, rule)
    took = time.perf_counter() - begin
    observer.stage("measure")
    placed = task.placed
    return measure_smoothing(rule, smoothed.chain, smoothed.schedule, placed.chain, placed.arm, task.limits, took)


def _times_by_rule(
    task: SmoothingTask, motions: Sequence[Measured], observer: PlanObserver, notes: list[str]
) -> dict[str, float | None]:
    """Cycle time of every rule [s]; none where a rule finds no motion, with a note why."""
    times: dict[str, float | None] = {motion.rule: motion.schedule.end for motion in motions}
    few = len(task.placed.chain.lengths) <= MANY
    for rule in RULES:
        if rule in times or not few:
            continue
        observer.stage(f"smooth by {rule}")
        try:
            times[rule] = smooth_path(task, rule).schedule.end
        except PolishSimError as error:
            times[rule] = None
            notes.append(f"{rule} finds no motion: {error}")
    return {rule: times[rule] for rule in RULES if rule in times}


def _write(task: SmoothingTask, motions: Sequence[Measured], folder: Path, rate: float) -> None:
    motion = motions[0]
    times = even_times(motion.schedule.end, rate)
    write_trajectory(folder, sample_in_blocks(motion.chain, motion.schedule, times, task.placed.arm))
    (folder / LIMITS).write_text(limits_toml(task.limits), encoding="utf-8")
