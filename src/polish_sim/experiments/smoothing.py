"""A placed path smoothed by a rule, and what it takes by the others (layer 9)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import PolishSimError, unknown_name
from polish_sim.experiments.smoothing_place import PlacedPath
from polish_sim.motion.rules.registry import RULES
from polish_sim.motion.rules.rule import Smoothed
from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.limits import SmoothingLimits
from polish_sim.planning.toolpath import APPROACH, RETRACT, ToolPath

FEW = 3
"""So many segments are enough to have a rule compiled."""


class SmoothingTask(NamedTuple):
    """What is to be smoothed, and how well."""

    placed: PlacedPath
    limits: SmoothingLimits
    tolerance: float
    """Largest distance of the tip from the path [m]; 0: exact stops at corners."""
    axis_tolerance: float
    """Largest angle of the tool axis to its path [rad]."""
    feeds: NDArray[np.float64] | None = None
    """The tip's largest speed on every segment [m/s], infinite where it has none of its own, shape (segments,)."""


def smooth_path(task: SmoothingTask, rule: str) -> Smoothed:
    """Smooth a path by a rule.

    Args:
        task: The path, limits and tolerances.
        rule: A name in `RULES`.

    Returns:
        The segments passed, those of the task or fewer where the rule joins short ones, and when.

    Raises:
        InputError: There is no such rule; lists the known ones.
        SmoothingError: No motion keeps within the limits; says where.
    """
    if rule not in RULES:
        raise unknown_name("rule", rule, RULES)
    placed = task.placed
    return Smoothed(
        *RULES[rule](placed.chain, task.limits, task.tolerance, task.axis_tolerance, placed.arm, task.feeds)
    )


def feeds_on_way(path: ToolPath, rows: NDArray[np.int64]) -> NDArray[np.float64] | None:
    """The path's own feeds as smoothing takes them: that of the point a segment goes to; none in the air.

    Args:
        path: The path.
        rows: Its rows that are way points, shape (segments + 1,).

    Returns:
        [m/s], shape (segments,); None if the path has no feeds.
    """
    if path.feed is None:
        return None
    in_air = np.isin(path.segment[rows[1:]], (APPROACH, RETRACT))
    return np.where(in_air, np.inf, path.feed[rows[1:]])


def first_segments(chain: Chain, count: int) -> Chain:
    """The chain of the first segments only."""
    ends, inner = count + 1, count
    return Chain(
        chain.tips[:ends].copy(), chain.axes[:ends].copy(), chain.rotations[:ends].copy(),
        chain.lengths[:inner].copy(), chain.directions[:inner].copy(), chain.angles[:inner].copy(),
        chain.turn_axes[:inner].copy(), chain.rolls[:inner].copy(),
    )  # fmt: skip


def prepare_rule(task: SmoothingTask, rule: str) -> None:
    """Have a rule compiled before its time is taken, on the first segments of the path; its failures come later."""
    few = task.placed._replace(chain=first_segments(task.placed.chain, FEW))
    feeds = None if task.feeds is None else task.feeds[:FEW].copy()
    try:
        smooth_path(task._replace(placed=few, feeds=feeds), rule)
    except PolishSimError:
        return
