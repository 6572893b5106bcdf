"""Picture of a reach map: how far from the robot the part may stand, and how it may be turned there."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from polish_sim.analysis.style import ORANGE, head, new_figure, styled
from polish_sim.arrays import Array
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
    figure = new_figure(7.5, 5.2)
    axes = figure.add_subplot()
    best = np.where(by_turn[height] > 0.0, by_turn[height], np.nan)
    drawn = axes.pcolormesh(np.degrees(TURNS), MM * DISTANCES, best, vmin=0.0, vmax=by_turn.max() or 1.0)
    if T_base_work is not None:
        turn = T_base_work[:3, :3] @ found.R_up.T
        middle = T_base_work[:3, 3] + turn @ found.middle
        angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]) + np.arctan2(middle[0], -middle[1])) % 360.0
        axes.plot(angle, MM * np.hypot(*middle[:2]), "o", color=ORANGE, ms=9, mec="white", label="as placed")
    axes.set_xlabel("turn of the part about the vertical, in front of the robot [deg]")
    axes.set_ylabel("middle of the path from the base axis [mm]")
    figure.colorbar(drawn, ax=axes, label="least manipulability along the path [m$^3$]")
    title = f"Reach map of {mesh.name}, part {MM * HEIGHTS[height]:.0f} mm above the table"
    head(figure, title, legend=(axes,))
    return figure
