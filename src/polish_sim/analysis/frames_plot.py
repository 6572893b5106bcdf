"""Calibrations of tool and bases as pictures: points, fitted circles, axes, and what is left of each (8c)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, PINK, SERIES, head, new_figure, styled

Array = NDArray[np.float64]

_FRAME_COLOURS = (ORANGE, GREEN, BLUE)
DARK = "#222222"
_MANY = 100


class Residuals(NamedTuple):
    """What is left of one group of measurements."""

    name: str
    distances: Array
    """[m], shape (n,)."""
    used: NDArray[np.bool_]
    """Shape (n,)."""


class ToolScene(NamedTuple):
    """Touches of one point."""

    T_base_flange: Array
    """Shape (n, 4, 4)."""
    T_flange_tool: Array
    """Shape (4, 4)."""
    touched: Array
    """The point [m], shape (3,)."""
    moved: Array
    """Tips of the moves, the start first [m], shape (m, 3)."""
    residuals: Residuals


class BaseScene(NamedTuple):
    """Measured points and what was found from them, all in one frame."""

    points: Sequence[tuple[str, Array]]
    """Groups of points [m], each (n, 3)."""
    circles: Sequence[Array]
    """Fitted circles as closed lines [m], each (k, 3)."""
    axes: Sequence[Array]
    """Axes as lines [m], each (2, 3)."""
    frames: Sequence[tuple[str, Array]]
    """Bases, each (4, 4)."""
    residuals: Sequence[Residuals]
    frame: str
    """Whose frame it is, for the axes."""


@styled
def plot_tool(scene: ToolScene, title: str, facts: Sequence[str]) -> Figure:
    """Flanges round the touched point with the tool drawn in, and how far each tip was from the fit."""
    figure, space, bars = _canvas()
    for k, T in enumerate(scene.T_base_flange):
        tip = T @ scene.T_flange_tool[:, 3]
        colour = BLUE if scene.residuals.used[k] else GREY
        label = {0: "flange to tip"}.get(k)
        space.plot(*np.stack([T[:3, 3], tip[:3]], axis=1), color=colour, lw=1.0, alpha=0.6, label=label)
        _draw_frame(space, T, 0.03)
    for k, end in enumerate(scene.moved[1:]):
        label = {0: "moves of the tip"}.get(k)
        space.plot(*np.stack([scene.moved[0], end], axis=1), ".--", color=PINK, lw=1.2, label=label)
    tool = scene.T_base_flange[0] @ scene.T_flange_tool
    _draw_frame(space, tool, 0.06, "xyz")
    space.plot(*scene.touched[:, None], "o", color=DARK, ms=5, zorder=10, label="touched point, tool frame")
    _finish(space, np.concatenate([scene.T_base_flange[:, :3, 3], scene.touched[None]]), "base")
    _residual_bars(bars, [scene.residuals])
    bars.set_xlabel("touch")
    head(figure, bars, title, facts)
    return figure


@styled
def plot_bases(scene: BaseScene, title: str, facts: Sequence[str]) -> Figure:
    """Measured points, fitted circles, axes and bases in space, and how far each point was from the fit."""
    figure, space, bars = _canvas()
    for (name, points), colour in zip(scene.points, SERIES * 2, strict=False):
        space.scatter(*points.T, color=colour, s=4, label=name)
    for line in scene.circles:
        space.plot(*line.T, color=GREY, lw=0.7)
    for line in scene.axes:
        space.plot(*line.T, color=GREY, lw=0.9, ls="--")
    for name, T in scene.frames:
        _draw_frame(space, T, 0.3, "xyz")
        below = T[:3, 3] - 0.2 * T[:3, 2]
        space.text(*below, name, fontsize=9, fontweight="bold", ha="center", va="center", zorder=10)
    # Not along an axis of either arm: circles would look like lines.
    space.view_init(elev=24.0, azim=-32.0)
    everything = [points for _, points in scene.points] + [T[None, :3, 3] for _, T in scene.frames]
    _finish(space, np.concatenate(everything), scene.frame)
    _residual_bars(bars, scene.residuals)
    bars.set_xlabel("measurement, group by group")
    head(figure, bars, title, facts)
    return figure


def _canvas() -> tuple[Figure, Any, Axes]:
    figure = new_figure(11.0, 5.2)
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1.0))
    return figure, figure.add_subplot(grid[0], projection="3d"), figure.add_subplot(grid[1])


def _draw_frame(space: Any, T: Array, size: float, names: str = "") -> None:
    """Axes of a frame, with their names at the ends if there are any; unnamed ones by colour."""
    for axis, colour in enumerate(_FRAME_COLOURS):
        end = T[:3, 3] + size * T[:3, axis]
        space.plot(*np.stack([T[:3, 3], end], axis=1), color=DARK if names else colour, lw=1.6)
        if names:
            space.text(*(end + 0.12 * size * T[:3, axis]), names[axis], fontsize=8, ha="center", va="center")


def _finish(space: Any, points: Array, frame: str) -> None:
    """Equal scales, labels with units."""
    middle, reach = 0.5 * (points.max(axis=0) + points.min(axis=0)), 0.55 * float(np.ptp(points, axis=0).max())
    for axis, center in zip("xyz", middle, strict=True):
        getattr(space, f"set_{axis}lim")(center - reach, center + reach)
        getattr(space, f"set_{axis}label")(f"{axis}, {frame} [m]")
        space.tick_params(axis, labelsize=7)
    space.set_box_aspect((1, 1, 1))
    space.locator_params(nbins=4)
    space.legend(loc="upper left", fontsize=7.5)


def _residual_bars(axes: Axes, groups: Sequence[Residuals]) -> None:
    first = 1
    for group, colour in zip(groups, SERIES * 2, strict=False):
        number = first + np.arange(len(group.distances))
        width = 1.4 if len(number) < _MANY else 0.5
        axes.vlines(
            number[group.used], 0.0, 1e3 * group.distances[group.used], color=colour, lw=width, label=group.name
        )
        for k in np.flatnonzero(~group.used):
            axes.axvspan(number[k] - 0.5, number[k] + 0.5, color=GREY, alpha=0.35, lw=0)
        first += len(group.distances) + (len(group.distances) > 20) * 5
    # An outlier, which is shaded, would flatten everything else.
    kept = [group.distances[group.used].max(initial=0.0) for group in groups]
    axes.set_ylim(0.0, max(1.25e3 * max(kept), 1e-9))
    axes.set_ylabel("distance from the fit [mm]")
    axes.locator_params(axis="x", integer=True)
    if len(groups) > 1:
        for line in axes.legend(loc="upper right", ncols=2).get_lines():
            line.set_linewidth(1.4)
