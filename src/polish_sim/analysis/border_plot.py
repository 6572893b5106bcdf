"""The map of where a force loop is stable: springs over latency, model and cell (layer 8c)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from polish_sim.analysis.rest import Border, Rest
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, YELLOW, new_figure, styled

REACH = (2.0, 20.0, 0.2, 5.0)
"""Latency [ms] and scale of the springs a controller should bear without retuning."""


@styled
def plot_border(border: Border) -> Figure:
    """Draw, controller by controller, where the cell came to rest and where the linear model says it should.

    Args:
        border: The map.

    Returns:
        The figure.
    """
    names = list(border.rests)
    figure = new_figure(1.2 + 3.4 * len(names), 4.6)
    panels = figure.subplots(1, len(names), sharex=True, sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        _draw_line(axes, border, name)
        _draw_runs(axes, border, name)
        _draw_reach(axes)
        axes.set_title(f"{name}: {_count(border, name)} stable", fontsize=9.5)
        axes.set_xlabel("latency, sensor and command [ms]")
    panels[0].set_ylabel("springs by what the plan takes them for [-]")
    _scale(panels[0], border)
    figure.suptitle("Where the force loop breaks, nothing retuned", x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3 if len(panels) < 3 else 6)
    return figure


def _draw_line(axes: Axes, border: Border, name: str) -> None:
    top = 2e3 * float(border.latencies.max())
    latest = np.minimum(1e3 * border.lines[name], top)
    axes.fill_betweenx(border.line_scales, latest, top, color=ORANGE, alpha=0.10, lw=0, label="unstable by the model")
    axes.plot(np.where(latest < top, latest, np.nan), border.line_scales, color=BLUE, lw=1.6, label="border, model")


def _draw_runs(axes: Axes, border: Border, name: str) -> None:
    runs = [
        (1e3 * latency, scale, _kind(rest))
        for latency, row in zip(border.latencies, border.rests[name], strict=True)
        for scale, rest in zip(border.scales, row, strict=True)
    ]
    for kind, (label, marker, color) in _LOOKS.items():
        points = np.array([run[:2] for run in runs if run[2] == kind]).reshape(-1, 2)
        axes.plot(points[:, 0], points[:, 1], ls="", marker=marker, color=color, ms=5.0, mew=1.4, label=label)


_LOOKS = {
    "rest": ("cell: at rest", "o", GREEN),
    "swing": ("cell: swings by less than ±2 N", "d", YELLOW),
    "unstable": ("cell: unstable", "x", ORANGE),
}


def _kind(rest: Rest) -> str:
    return "rest" if rest.resting else "swing" if rest.stable else "unstable"


def _draw_reach(axes: Axes) -> None:
    first, last, low, high = REACH
    axes.add_patch(
        Rectangle((first, low), last - first, high - low, fill=False, ls=":", lw=1.2, ec=GREY, label="reach")
    )


def _scale(axes: Axes, border: Border) -> None:
    axes.set_yscale("log")
    axes.set_ylim(border.line_scales.min(), border.line_scales.max())
    axes.set_xlim(0.0, 1.08e3 * float(border.latencies.max()))
    axes.yaxis.set_major_locator(FixedLocator([0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _count(border: Border, name: str) -> str:
    rests = [rest for row in border.rests[name] for rest in row]
    return f"{sum(rest.stable for rest in rests)} of {len(rests)} runs"
