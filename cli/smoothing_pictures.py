"""The pictures of a smoothed path: corners, tool and joints over time; imported only inside commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.deviation import deviation_curve
from polish_sim.motion.rules.limits import Arm
from polish_sim.smoothing.figures import Measured, axis_limits, sample_motion, tip_limits
from polish_sim.smoothing.place import SmoothingTask
from polish_sim.smoothing.plots import (
    Curves,
    LimitRows,
    chosen_corners,
    path_turns,
    plot_corners,
    plot_deviation,
    plot_joints,
    plot_tool,
    view_corner,
    way_past,
)

DRAWN: Final = 20_000
"""Samples of a curve; motions of more than that many milliseconds are drawn with fewer."""


def draw_smoothing(task: SmoothingTask, motions: Sequence[Measured], name: str) -> dict[str, Figure]:
    """Draw what a smoothed path is judged by, by file name; one curve a rule."""
    raw, limits, arm = task.placed.chain, task.limits.values(), task.placed.arm
    curves = [_curves(motion, raw, arm) for motion in motions]
    rows = LimitRows(np.array(tip_limits(limits)), np.array(axis_limits(limits)), limits.joint)
    times = ", ".join(f"{motion.rule} {motion.schedule.end:.4g} s" for motion in motions)
    facts = [f"{len(raw.lengths)} segments, {1e3 * raw.lengths.sum():.4g} mm", times]
    tolerances = f"tolerance {1e3 * task.tolerance:g} mm, {math.degrees(task.axis_tolerance):.3g}°"
    allowed = (task.tolerance, task.axis_tolerance)
    plots = {
        "tool.png": plot_tool(curves, rows, f"Tool along {name}", [*facts, tolerances]),
        "deviation.png": plot_deviation(curves, allowed, f"Deviation from {name}", [*facts, tolerances]),
    }
    if arm is not None:
        plots["joints.png"] = plot_joints(curves, rows, f"Joints along {name}", [*facts, tolerances])
    return plots | _corners(task, motions, name, [*facts, tolerances])


def _curves(motion: Measured, raw: Chain, arm: Arm | None) -> Curves:
    end = motion.schedule.end
    times = np.linspace(0.0, end, int(min(DRAWN, max(1e3 * end, 500.0))) + 1)
    seen = sample_motion(motion.chain, motion.schedule, times, arm)
    strays = deviation_curve(motion.chain, motion.schedule, raw, times)
    return Curves(motion.rule, times, seen.tip_rates, seen.axis_rates, seen.q[1:], strays)


def _corners(task: SmoothingTask, motions: Sequence[Measured], name: str, facts: list[str]) -> dict[str, Figure]:
    raw = task.placed.chain
    turns = path_turns(raw)
    ways = [way_past(raw, motion.chain, motion.schedule) for motion in motions]
    chosen = chosen_corners(turns, ways[0], motions[0].deviation)
    if not chosen:
        return {}
    views = [
        view_corner(raw, task.placed.rows, ways, corner, float(turns[corner[0]]), task.tolerance) for corner in chosen
    ]
    return {"corners.png": plot_corners(views, [motion.rule for motion in motions], f"Corners of {name}", facts)}
