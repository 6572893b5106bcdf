"""An error budget as a picture: each source as analysis and draws have it, and how large the whole is (layer 8c)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, head, new_figure, styled

Array = NDArray[np.float64]

_BINS = 50


class Bar(NamedTuple):
    """Root mean squares of one source [m]."""

    predicted: float
    predicted_across: float
    """Across the tool axis only."""
    drawn: float
    drawn_across: float
    drawn_std: float
    """How well the draws tell ``drawn``."""


class Total(NamedTuple):
    """The whole error."""

    lengths: Array
    """Of all draws and places [m], shape (n,)."""
    edges: Array
    """Lengths the prediction is given at [m], rising, shape (k,)."""
    probability: Array
    """Predicted share of errors no longer than each, shape (k,)."""
    rms_asked: float
    p95_asked: float


@styled
def plot_budget(bars: Mapping[str, Bar], total: Total, title: str, facts: Sequence[str]) -> Figure:
    """Draw bars of the sources, analysis beside draws, and the distribution of the whole with what is asked of it."""
    figure = new_figure(11.0, 4.8)
    left, right = figure.subplots(1, 2)
    _draw_bars(left, bars)
    _draw_total(right, total)
    head(figure, left, title, facts)
    return figure


def _draw_bars(axes: Axes, bars: Mapping[str, Bar]) -> None:
    place, width = np.arange(len(bars)), 0.36
    columns = 1e3 * np.array(list(bars.values()))
    for shift, colour, name, first in ((-0.5, BLUE, "analysis", 0), (0.5, ORANGE, "drawn", 2)):
        axes.bar(place + shift * width, columns[:, first], width, color=colour, alpha=0.4, label=name)
        axes.bar(
            place + shift * width, columns[:, first + 1], width, color=colour, label=f"{name}, across the tool axis"
        )
    axes.errorbar(
        place + 0.5 * width, columns[:, 2], 2.0 * columns[:, 4], fmt="none", ecolor=GREY, capsize=3, label="±2 std"
    )
    axes.set_xticks(place, list(bars))
    axes.set_ylabel("tool on the part, error, rms [mm]")
    axes.grid(visible=False, axis="x")
    axes.set_ylim(0.0, 1.35 * columns.max())
    axes.legend(loc="upper left", ncols=2)


def _draw_total(axes: Axes, total: Total) -> None:
    edges = 1e3 * total.edges
    axes.hist(
        1e3 * total.lengths,
        bins=_BINS,
        range=(0.0, edges[-1]),
        density=True,
        color=ORANGE,
        alpha=0.4,
        label="drawn, together",
    )
    density = np.diff(total.probability) / np.diff(edges)
    axes.plot(0.5 * (edges[1:] + edges[:-1]), density, color=BLUE, lw=1.6, label="analysis, together")
    rms, p95 = float(np.sqrt(np.mean(total.lengths**2))), float(np.percentile(total.lengths, 95.0))
    for value, asked, name, style in ((rms, total.rms_asked, "rms", "-"), (p95, total.p95_asked, "95%", "--")):
        axes.axvline(1e3 * value, color=ORANGE, ls=style, label=f"{name} {1e3 * value:.3f} mm")
        axes.axvline(1e3 * asked, color=GREEN, ls=style, label=f"{name} asked: {1e3 * asked:.2f} mm")
    axes.set_xlabel("size of the error, over calibrations and places on the rim [mm]")
    axes.set_ylabel("density [1/mm]")
    axes.legend(loc="upper right", frameon=True, framealpha=1.0, edgecolor="none")
