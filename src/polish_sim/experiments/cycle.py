"""How long a path takes in the cell, planned without the robot (ToolPath -> figures of the time law)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, angles_between, joined, midpoints, norms, running_sums
from polish_sim.cell.stroke import (
    TARE_START,
    TARE_TIME,
    TOUCH_DOWN_TIME,
    Stroke,
    cycle_time,
    feed_acceleration,
)
from polish_sim.config import Scenario
from polish_sim.errors import SmoothingError
from polish_sim.experiments.part_setup import placed_strokes, placed_tool, unplaced_tool
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.stroke_motion import feed_figures, within_noise
from polish_sim.geometry.repair.skin import ScanNoise
from polish_sim.motion.trajectory import TimedPath
from polish_sim.planning.toolpath import ToolPath, interpolate
from polish_sim.spatial import matrices

OWN = ("cycle_time_s", "smoothed_off_max_m", "smoothed_axis_off_max_rad")


def cycle_strokes(
    scenario: Scenario,
    path: ToolPath,
    noise: ScanNoise,
    progress: Callable[[float, float], None],
    reach: Reach | None = None,
) -> list[Stroke]:
    """The strokes of a path, not pressed, as a run does them on the part where it is placed.

    Unplaced, without a ``reach``, they keep the tool's limits alone. There are none if the path cannot be
    smoothed. ``process.max_feed_s`` ends nothing here.
    """
    smoothing = within_noise(scenario.smoothing, noise)
    whole = replace(scenario, smoothing=smoothing, process=replace(scenario.process, max_feed_s=0.0))
    placed = placed_tool(path, reach) if reach else unplaced_tool(path)
    try:
        return placed_strokes(whole, path, placed, 0.0, scenario.plan.clearance_m, progress)
    except SmoothingError:
        return []


def time_figures(strokes: Sequence[Stroke]) -> dict[str, float]:
    """``feed_figures`` of a path's strokes, and

    - cycle_time_s: zeroing of the sensor, way down, touch-down, strokes, moves through the air and lifts;

    - smoothed_off_max_m, smoothed_axis_off_max_rad: how far the motion in contact is from the path, place and
      axis.

    They are undefined where there are no strokes.
    """
    if not strokes:
        return dict.fromkeys((*feed_figures(()), *OWN), math.nan)
    off = np.max([(0.0, 0.0), *(_deviations(stroke) for stroke in strokes)], axis=0)
    return feed_figures(strokes) | dict(zip(OWN, (cycle_time(strokes), *off), strict=True))


def _deviations(stroke: Stroke) -> tuple[float, float]:
    """Largest distance of a motion from its path at the same place of it [m], and angle between the axes
    [rad]."""
    motion, table = stroke.motion, stroke.process
    rows = np.arange(len(table.positions))
    at = np.minimum(motion.places / table.spacing, rows[-1])
    tips, along = (
        interpolate(at, rows, column) for column in (table.positions, matrices(table.quaternions)[:, :, 2])
    )
    turned = angles_between(matrices(motion.quaternions)[:, :, 2], along)
    return norms(motion.positions - tips).max(), turned.max()


# The whole cycle, row by row: what a picture of the plan in motion plays.

ROWS_S = 0.05  #: Between rows of a motion, about [s]


class Cycle(NamedTuple):
    """The tool over a cycle, base frame."""

    time: Array  #: [s], rising, shape (n,)
    positions: Array  #: Tool point, in contact pressed in [m], shape (n, 3)
    quaternions: Array  #: R_base_tool as wxyz, shape (n, 4)
    force: Array  #: To press with [N], zero in the air, shape (n,)
    curvature: Array  #: Of the part along the path [1/m], zero in the air, shape (n,)


def cycle_of(strokes: Sequence[Stroke]) -> Cycle:
    """Zeroing of the sensor, ways down, touch-downs, strokes and lifts one after the other, as in
    ``cycle_time``."""
    pieces: list[Cycle] = []

    def add(
        duration: Array,
        positions: Array,
        quaternions: Array,
        force: Array | float = 0.0,
        bend: Array | float = 0.0,
    ) -> None:
        begin, none = pieces[-1].time[-1] if pieces else 0.0, np.zeros(len(positions))
        pieces.append(Cycle(begin + duration, positions, quaternions, none + force, none + bend))

    for number, stroke in enumerate(strokes):
        way, table, motion = stroke.travel, stroke.process, stroke.motion
        if number == 0 or stroke.retare:
            rest = np.array([0.0, TARE_START + TARE_TIME])
            add(rest, way.positions[[0, 0]], way.quaternions[[0, 0]])
        add(*_thinned(_played(way), way.positions, way.quaternions))
        down, speed = stroke.lead_in, stroke.approach_speed
        takes = down.length / speed + 0.5 * speed / feed_acceleration.py_func(speed)
        add(*_thinned(np.linspace(0.0, takes, len(down.positions)), down.positions, down.quaternions))
        add(np.array([TOUCH_DOWN_TIME]), motion.positions[:1], motion.quaternions[:1], stroke.force[:1])
        rows = np.arange(len(table.positions)) * table.spacing
        force, bend = (np.interp(motion.places, rows, values) for values in (stroke.force, table.curvature))
        add(*_thinned(_played(motion), motion.positions, motion.quaternions, force, bend))
        lifted, takes = stroke.way_up
        above = motion.positions[-1] - lifted * matrices(motion.quaternions[-1])[:, 2]
        add(np.array([takes]), above[None], motion.quaternions[-1:])
    whole = Cycle(*joined(pieces))
    kept = np.append(np.diff(whole.time) > 1e-9, True)
    return Cycle(*(column[kept] for column in whole))


def _played(motion: TimedPath) -> Array:
    """When the rows of a motion are played at its largest rates [s], from 0."""
    slowness = 1.0 / motion.rates
    steps = midpoints(slowness) * motion.duration / max(len(slowness) - 1, 1)
    return running_sums(steps)


def _thinned(time: Array, *columns: Array) -> tuple[Array, ...]:
    """Rows about ``ROWS_S`` apart, the last one always."""
    every = max(1, int(ROWS_S * (len(time) - 1) / time[-1])) if time[-1] > 0.0 else 1
    kept = np.unique(np.append(np.arange(0, len(time), every), len(time) - 1))
    return (time[kept], *(column[kept] for column in columns))
