"""Picture of a reach map: where the part may stand about the robot, and how it may be turned there."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from scipy.spatial import ConvexHull

from polish_sim.analysis.style import ORANGE, head, new_figure, styled
from polish_sim.arrays import Array
from polish_sim.cell.scene import TABLE
from polish_sim.experiments.reach_map import DISTANCES, HEIGHTS, TURNS, ReachMap
from polish_sim.geometry import PartMesh
from polish_sim.spatial import apply

MM = 1e3


@styled
def plot_reach_map(found: ReachMap, mesh: PartMesh, T_base_work: Array | None) -> Figure:
    """Draw how well the arm does a path by where the part stands; ``T_base_work`` (4, 4): the pose taken, if
    any."""
    by_turn = found.values.max(axis=3)
    if T_base_work is None:
        height = by_turn.max(axis=(1, 2)).argmax()
    else:
        stands = apply(T_base_work, mesh.vertices)[:, 2].min()
        height = np.abs(HEIGHTS - stands).argmin()
    figure = new_figure(12.0, 5.2)
    above, turns = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
    shown: dict[str, Any] = {
        "vmin": 0.0,
        "vmax": by_turn.max() or 1.0,
        "cmap": "viridis",
        "shading": "nearest",
    }
    best = np.where(by_turn[height] > 0.0, by_turn[height], np.nan)
    about = np.radians(np.arange(0.0, 361.0, 5.0))
    x, y = (MM * np.outer(DISTANCES, direction(about)) for direction in (np.sin, np.cos))
    around = np.repeat(np.max(np.nan_to_num(best), axis=1)[:, None], len(about), axis=1)
    above.pcolormesh(x, y, np.where(around > 0.0, around, np.nan), **{**shown, "shading": "gouraud"})
    corner, size = MM * (TABLE.middle - TABLE.half)[:2], 2.0 * MM * TABLE.half[:2]
    above.add_patch(Rectangle((corner[0], corner[1]), *size, fill=False, lw=1.5, label="table"))
    above.add_patch(Circle((0.0, 0.0), 75.0, color="0.4", label="robot"))
    drawn = turns.pcolormesh(np.degrees(TURNS), MM * DISTANCES, best, **shown)
    if T_base_work is not None:
        corners = MM * apply(T_base_work, mesh.vertices)[:, :2]
        above.fill(
            *corners[ConvexHull(corners, qhull_options="QJ").vertices].T,
            color=ORANGE,
            alpha=0.8,
            label="part",
        )
        turn = T_base_work[:3, :3] @ found.R_up.T
        middle = T_base_work[:3, 3] + turn @ found.middle
        angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]) + np.arctan2(middle[0], -middle[1])) % 360.0
        turns.plot(angle, MM * np.hypot(*middle[:2]), "o", color=ORANGE, ms=9, mec="white", label="as placed")
    above.set(xlabel="x of the base [mm]", ylabel="y of the base [mm]", aspect="equal")
    above.set_title("middle of the path, best turn of the part", fontsize=9.0)
    turns.set(
        xlabel="turn of the part about the vertical [deg]",
        ylabel="middle of the path from the base axis [mm]",
    )
    turns.set_title("in front of the robot", fontsize=9.0)
    figure.colorbar(drawn, ax=turns, label="least manipulability along the path [m$^3$]")
    head(
        figure,
        f"Reach map of {mesh.name}, part {MM * HEIGHTS[height]:.0f} mm above the table",
        legend=(above, turns),
    )
    return figure
