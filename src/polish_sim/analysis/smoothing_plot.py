"""Speed, acceleration and jerk of tool and joints over time, with limits (layer 8c; paper 4, fig. 6-8)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.style import BLUE, GREEN, ORANGE, new_figure, styled
from polish_sim.motion.smoothing.deviation_curve import DeviationCurve

Array = NDArray[np.float64]

ORDERS: Final = ("speed", "acceleration", "jerk")
SUFFIX: Final = ("/s", "/s²", "/s³")
COLOURS: Final = (BLUE, ORANGE)


class Curves(NamedTuple):
    """One rule's rates over time."""

    label: str
    times: Array
    """[s], shape (n,)."""
    tip: Array
    """Norms of the tip's derivatives [m/s..], shape (3, n)."""
    axis: Array
    """Norms of the axis' [rad/s..], shape (3, n)."""
    joints: Array
    """Joint rates with sign [rad/s..], shape (3, n, 6), or (3, n, 0) without a robot."""
    deviation: DeviationCurve
    """Of tip and axis from the path."""


class LimitRows(NamedTuple):
    """What the rates must not exceed; each a row of speed, acceleration, jerk."""

    tip: Array
    """[m/s..], shape (3,)."""
    axis: Array
    """[rad/s..], shape (3,)."""
    joints: Array
    """[rad/s..], shape (3, 6)."""


@styled
def plot_tool(curves: Sequence[Curves], limits: LimitRows, title: str, facts: Sequence[str]) -> Figure:
    """Speed, acceleration and jerk of tip and tool axis over time, with limits; one curve a rule."""
    figure = new_figure(11.0, 7.0)
    grid = figure.subplots(3, 2, sharex=True)
    for order, row in enumerate(grid):
        columns = (
            (row[0], "tip", 1e3, f"tip [mm{SUFFIX[order]}]", limits.tip[order]),
            (row[1], "axis", 180.0 / np.pi, f"axis [deg{SUFFIX[order]}]", limits.axis[order]),
        )
        for axes, name, scale, label, limit in columns:
            for curve, colour in _backwards(curves):
                values = getattr(curve, name)[order]
                axes.plot(curve.times, scale * values, color=colour, lw=0.9, label=curve.label)
            top = max(float(getattr(curve, name)[order].max(initial=0.0)) for curve in curves)
            _draw_limit(axes, scale * limit, scale * top, both_signs=False)
            axes.set_ylabel(f"{ORDERS[order]} of the {label}")
    _finish(figure, grid, curves, title, facts)
    return figure


@styled
def plot_deviation(
    curves: Sequence[Curves], tolerances: tuple[float, float], title: str, facts: Sequence[str]
) -> Figure:
    """How far tip and tool axis are from the path over time, with tolerances [m, rad]; one curve a rule."""
    figure = new_figure(11.0, 5.4)
    grid = figure.subplots(2, 1, sharex=True, squeeze=False)
    rows = (
        (grid[0, 0], "tip", 1e6, "tip off the path [µm]", tolerances[0]),
        (grid[1, 0], "axis", 180e3 / np.pi, "axis off its path [mdeg]", tolerances[1]),
    )
    for axes, name, scale, label, tolerance in rows:
        for curve, colour in _backwards(curves):
            axes.plot(curve.times, scale * getattr(curve.deviation, name), color=colour, lw=0.9, label=curve.label)
        top = max(float(getattr(curve.deviation, name).max(initial=0.0)) for curve in curves)
        axes.axhline(scale * tolerance, color=GREEN, lw=1.0, ls="--", label="tolerance")
        axes.set_ylim(0.0, scale * max(1.12 * tolerance, 1.12 * top, 1e-9))
        axes.set_ylabel(label)
    _finish(figure, grid, curves, title, facts)
    return figure


@styled
def plot_joints(curves: Sequence[Curves], limits: LimitRows, title: str, facts: Sequence[str]) -> Figure:
    """Speed, acceleration and jerk of the six joints over time, with limits; one curve a rule."""
    figure = new_figure(12.0, 11.0)
    grid = figure.subplots(6, 3, sharex=True)
    degrees = 180.0 / np.pi
    for joint, row in enumerate(grid):
        for order, axes in enumerate(row):
            for curve, colour in _backwards(curves):
                axes.plot(curve.times, degrees * curve.joints[order, :, joint], color=colour, lw=0.8, label=curve.label)
            top = max(float(np.abs(curve.joints[order, :, joint]).max(initial=0.0)) for curve in curves)
            _draw_limit(axes, degrees * limits.joints[order, joint], degrees * top, both_signs=True)
            if joint == 0:
                axes.set_title(f"{ORDERS[order]} [deg{SUFFIX[order]}]", fontsize=9.0, fontweight="normal")
        row[0].set_ylabel(f"joint {joint + 1}")
    _finish(figure, grid, curves, title, facts)
    return figure


def _backwards(curves: Sequence[Curves]) -> list[tuple[Curves, str]]:
    """The first rule's curve is drawn last, on top."""
    return list(zip(curves, COLOURS, strict=False))[::-1]


NARROW: Final = 11.0
"""A figure less wide has no room for facts and legend in one line [inch]."""
NEAR: Final = 0.4
"""A limit is drawn to scale when the curve comes to this share of it; a farther one is only told."""


def _draw_limit(axes: Axes, limit: float, top: float, both_signs: bool) -> None:
    if top < NEAR * limit:
        reach = 1.15 * top if top > 0.0 else 1.0
        axes.set_ylim(-reach if both_signs else 0.0, 1.25 * reach)
        text = f"limit {limit:.4g}" if np.isfinite(limit) else "no limit"
        axes.text(0.99, 0.97, text, transform=axes.transAxes, ha="right", va="top", color=GREEN, fontsize=8.0)
        return
    for sign in (1.0, -1.0) if both_signs else (1.0,):
        axes.axhline(sign * limit, color=GREEN, lw=1.0, ls="--", label="limit")
    reach = 1.12 * max(limit, top)
    axes.set_ylim(-reach if both_signs else 0.0, reach)


def _finish(figure: Figure, grid: Any, curves: Sequence[Curves], title: str, facts: Sequence[str]) -> None:
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
        axes.set_xlim(0.0, max(float(curve.times[-1]) for curve in curves))
    named = {
        label: handle for axes in grid.flat for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    order = [curve.label for curve in curves] + [label for label in ("limit", "tolerance") if label in named]
    close(figure, title, facts, [named[label] for label in order], order)


def close(figure: Figure, title: str, facts: Sequence[str], handles: Sequence[Any], labels: Sequence[str]) -> None:
    """Head a figure with what it shows; at its foot its figures in small print and the legend, beside it if narrow."""
    figure.suptitle(title, x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    if figure.get_figwidth() < NARROW:
        figure.legend(handles, labels, loc="outside right upper")
        figure.supxlabel("     ".join(facts), x=0.01, ha="left", fontsize=9.0, color="#444444")
    else:
        figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
        figure.text(0.01, 0.008, "     ".join(facts), fontsize=9.0, color="#444444")
