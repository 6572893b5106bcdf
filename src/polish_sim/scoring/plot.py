"""A score in one figure: every run a dot, every case a line, controllers side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from polish_sim.analysis.style import GREEN, GREY, MARKS, SERIES, head, new_figure, styled
from polish_sim.row_file import Metrics
from polish_sim.scoring.figures import Asked


class _Panel(NamedTuple):
    figure: str
    label: str
    least: float  #: Smaller values are drawn here: the axis is logarithmic


PANELS = (
    _Panel("settling_1n_s", "settling to ±1 N [s]", 0.05),
    _Panel("rms_error_n", "RMS error [N]", 0.02),
    _Panel("max_error_n", "largest error [N]", 0.1),
    _Panel("overshoot_n", "overshoot [N]", 0.02),
)
FAR = 100.0  #: Span of an axis beyond which only every other number fits
_ROW_INCH = 0.27


@styled
def plot_score(rows: Sequence[Metrics], cases: Mapping[str, bool], asked: Sequence[Asked]) -> Figure:
    """Draw settling, RMS and largest error and overshoot of every run.

    A run that is not stable is a cross, one whose figure is undefined stands at the right border. ``cases``:
    names from top to bottom, and whether the tool is fed along a path in them; ``asked``: the figures asked.
    """
    labels = list(dict.fromkeys(row["controller"] for row in rows))
    figure = new_figure(12.0, 1.5 + _ROW_INCH * len(cases) * (1.0 if len(labels) < 3 else 1.3))
    panels = figure.subplots(1, len(PANELS), sharey=True)
    for axes, panel in zip(panels, PANELS, strict=True):
        own = [row for row in rows if row["case"] in cases]
        if panel.figure == "settling_1n_s":  # not defined along a path
            own = [row for row in own if not cases[row["case"]]]
        _draw_panel(axes, panel, own, list(cases), labels)
        _draw_limits(axes, panel, list(cases), asked)
    panels[0].set_yticks(range(len(cases)), list(cases))
    panels[0].set_ylim(len(cases) - 0.4, -0.6)
    rest = (
        f" and {len(labels) - 1} more" if len(labels) > 2 else "".join(f" and {name}" for name in labels[1:])
    )
    for number, label in enumerate(labels):
        panels[-1].plot([], [], ls="", label=label, **_mark(number))
    panels[-1].plot([], [], "x", color=GREY, label="not stable (right border: no figure)")
    what = f"Score: {labels[0]}{rest}"
    head(figure, what, ["a mark a run, a line a case; further left is better"], legend=panels)
    return figure


def _draw_panel(
    axes: Axes, panel: _Panel, rows: Sequence[Metrics], cases: Sequence[str], labels: Sequence[str]
) -> None:
    known = [float(row[panel.figure]) for row in rows if row[panel.figure] is not None]
    right = 1.6 * max([*known, 10.0 * panel.least])
    axes.set_xlim(0.8 * panel.least, 1.4 * right)
    _scale(axes, right / panel.least)
    axes.set_xlabel(panel.label)
    axes.grid(axis="y", visible=False)
    for index in range(0, len(cases), 2):
        axes.axhspan(index - 0.5, index + 0.5, color="#F4F4F4", lw=0, zorder=0)
    offsets = np.linspace(-0.2, 0.2, len(labels)) if len(labels) > 1 else [0.0]
    for row in rows:
        value = row[panel.figure]
        place = labels.index(row["controller"])
        y = cases.index(row["case"]) + offsets[place]
        x = right if value is None else max(float(value), panel.least)
        look = _mark(place) if row["stable"] else _mark(place) | {"marker": "x"}
        axes.plot(x, y, ls="", ms=4.0, alpha=0.75, mew=1.1, **look)


def _mark(number: int) -> dict[str, Any]:
    """Mark and colour of a controller: another pair for each of the first thirty-six."""
    return {
        "marker": MARKS[number % len(MARKS)],
        "color": SERIES[(number + number // len(MARKS)) % len(SERIES)],
    }


def _scale(axes: Axes, span: float) -> None:
    """A logarithmic axis with several numbers on it, however many decades it spans, each written out."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if span > FAR else (1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


def _draw_limits(axes: Axes, panel: _Panel, cases: Sequence[str], asked: Sequence[Asked]) -> None:
    for one in asked:
        for y, case in enumerate(cases):
            if one.claim.figure == panel.figure and one.applies(case):
                axes.plot(
                    [one.claim.high] * 2, [y - 0.45, y + 0.45], color=GREEN, lw=1.8, zorder=1, label="asked"
                )
