"""How long a path takes in the cell, planned without the robot (ToolPath -> figures of the time law)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.cell.stroke import Stroke, cycle_time
from polish_sim.config import Scenario
from polish_sim.errors import SmoothingError
from polish_sim.experiments.part_setup import PlacedTool, placed_strokes, placed_tool
from polish_sim.experiments.placement import Reach, tool_rotations
from polish_sim.experiments.stroke_motion import feed_figures, within_noise
from polish_sim.geometry.repair.skin import Noise
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import unit

OWN = ("cycle_time_s", "smoothed_off_max_m", "smoothed_axis_off_max_rad")


def time_law(
    scenario: Scenario,
    path: ToolPath,
    noise: Noise,
    progress: Callable[[float, float], None],
    reach: Reach | None = None,
) -> dict[str, float]:
    """Time a path, not pressed, on the part as a run does where it is placed; unplaced, with the tool's limits alone.

    Returns ``feed_figures`` and

    - cycle_time_s: zeroing of the sensor, way down, touch-down, strokes, moves through the air and lifts;

    - smoothed_off_max_m, smoothed_axis_off_max_rad: how far the motion in contact is from the path, place and axis.

    They are undefined for a path that cannot be smoothed. ``process.max_feed_s`` ends nothing here.
    """
    whole = replace(within_noise(scenario, noise), process=replace(scenario.process, max_feed_s=0.0))
    placed = placed_tool(path, reach) if reach else PlacedTool(np.eye(4), tool_rotations(path.axes_work, 0.0), None)
    try:
        strokes = placed_strokes(whole, path, placed, 0.0, scenario.plan.clearance_m, progress)
    except SmoothingError:
        return dict.fromkeys((*feed_figures(()), *OWN), math.nan)
    off = np.max([(0.0, 0.0), *(_deviations(stroke) for stroke in strokes)], axis=0)
    own = (cycle_time(strokes), float(off[0]), float(off[1]))
    return feed_figures(strokes) | dict(zip(OWN, own, strict=True))


def _deviations(stroke: Stroke) -> tuple[float, float]:
    """Largest distance of a motion from its path at the same place of it [m], and angle between the axes [rad]."""
    motion, table = stroke.motion, stroke.process
    at = np.minimum(motion.places / table.spacing, len(table.positions) - 1.0)
    axes = _axes(table.quaternions)
    wanted = [np.interp(at, np.arange(len(axes)), column) for column in np.concatenate([table.positions, axes], 1).T]
    tips, along = np.stack(wanted[:3], axis=1), unit(np.stack(wanted[3:], axis=1))
    chords = np.linalg.norm(_axes(motion.quaternions) - along, axis=1)
    turned = 2.0 * np.arcsin(np.minimum(0.5 * chords, 1.0))
    return float(np.linalg.norm(motion.positions - tips, axis=1).max()), float(turned.max())


def _axes(quaternions: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_quat(quaternions, scalar_first=True).apply([0.0, 0.0, 1.0]))
