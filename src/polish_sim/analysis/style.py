"""How every figure looks: one set of colours and sizes, safe for colour-blind eyes (layer 8c)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Final, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

P = ParamSpec("P")
Array = NDArray[np.float64]

# Colours of Okabe and Ito: distinguishable with every common kind of colour blindness.
BLUE: Final = "#0072B2"
ORANGE: Final = "#D55E00"
GREEN: Final = "#009E73"
YELLOW: Final = "#E69F00"
SKY: Final = "#56B4E9"
PINK: Final = "#CC79A7"
GREY: Final = "#6E6E6E"
SERIES: Final = (BLUE, ORANGE, GREEN, PINK, YELLOW, SKY)

_RC: Final[Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": "#222222",
    "axes.edgecolor": "#888888",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.7,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "lines.linewidth": 1.2,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.facecolor": "white",
    "path.simplify": True,
}


def styled(plot: Callable[P, Figure]) -> Callable[P, Figure]:
    """Draw a figure in the house style; matplotlib's own settings are back as they were afterwards."""

    @wraps(plot)
    def draw(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with matplotlib.rc_context(_RC):
            return plot(*args, **kwargs)

    return draw


def new_figure(width: float = 8.0, height: float = 4.5) -> Figure:
    """An empty figure whose parts arrange themselves without overlap; sizes in inch."""
    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def head(figure: Figure, axes: Axes, text: str, facts: Sequence[str]) -> None:
    """Head a figure with what it shows and, over its first axes in small print, its figures."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=11.5, fontweight="bold")
    axes.set_title("     ".join(facts), loc="left", fontsize=9.0, fontweight="normal", color="#444444")


def shade_band(axes: Axes, center: float, half_width: float, label: str) -> None:
    """Shade a tolerance band around a target and draw the target as a line."""
    axes.axhspan(center - half_width, center + half_width, color=GREEN, alpha=0.13, lw=0, label=label, zorder=0)
    axes.axhline(center, color=GREEN, lw=0.9, ls="--", zorder=1)
