"""The arm over its path, drawn from joint positions: the cell where nothing can render one (layer 8c)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray

from polish_sim.analysis.rows import numbers
from polish_sim.analysis.run_record import RunRecord
from polish_sim.analysis.style import BLUE, GREY, ORANGE, new_figure, styled
from polish_sim.motion import link_frames

Array = NDArray[np.float64]


@styled
def plot_cell(record: RunRecord) -> Figure:
    """Draw base, links and tool in the middle of a run, and the way of the tool point.

    Args:
        record: Any run with at least one row.

    Returns:
        The figure.
    """
    figure = new_figure(7.5, 6.0)
    axes = figure.add_subplot(projection="3d")
    assert isinstance(axes, Axes3D)
    way = numbers(record.log, "tcp_position_m")
    middle = len(way) // 2
    arm = link_frames(numbers(record.log, "q_rad")[middle])[:, :3, 3]
    tool = np.array([arm[-1], way[middle]])
    axes.plot(*arm.T, "-o", color=GREY, lw=7.0, ms=9.0, solid_capstyle="round", alpha=0.85, label="arm")
    axes.plot(*tool.T, "-", color="#222222", lw=4.0, label="spindle and head")
    axes.plot(*way.T, color=BLUE, lw=0.8, label="way of the tool point")
    axes.plot(*way[middle], "o", color=ORANGE, ms=6.0)
    _draw_table(axes, float(way[:, 2].min()))
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.set_box_aspect((1.0, 1.0, 0.8))
    axes.set(xlim=(-0.6, 0.6), ylim=(-0.95, 0.25), zlim=(min(-0.1, way[:, 2].min()), 0.86))
    axes.view_init(elev=22.0, azim=-55.0)
    axes.legend(loc="upper left")
    text = f"The cell in the middle of the run, {record.scenario.experiment}"
    figure.suptitle(text, x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    return figure


def _draw_table(axes: Axes3D, lowest: float) -> None:
    """The table's plane z = 0, where the tool stays above it."""
    if lowest < 0.0:
        return
    x, y = np.meshgrid([-0.5, 0.5], [-0.9, 0.2])
    axes.plot_surface(x, y, np.zeros_like(x), color="#CCCCCC", alpha=0.35, shade=False)
