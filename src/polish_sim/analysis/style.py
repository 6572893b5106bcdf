"""How every figure looks: one set of colours and sizes, safe for colour-blind eyes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from typing import Any, Final, NamedTuple, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.arrays import Array, Bools
from polish_sim.spatial import unit

P = ParamSpec("P")

# Colours of Okabe and Ito: distinguishable with every common kind of colour blindness.
BLUE: Final = "#0072B2"
ORANGE: Final = "#D55E00"
GREEN: Final = "#009E73"
YELLOW: Final = "#E69F00"
SKY: Final = "#56B4E9"
PINK: Final = "#CC79A7"
GREY: Final = "#6E6E6E"
RED: Final = "#E00020"
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


def heading(figure: Figure, text: str) -> None:
    """Head a figure with what it shows."""
    figure.suptitle(text, x=0.01, ha="left", fontsize=11.5, fontweight="bold")


def head(figure: Figure, axes: Axes, text: str, facts: Sequence[str]) -> None:
    """Head a figure with what it shows and, over its first axes in small print, its figures."""
    heading(figure, text)
    axes.set_title("     ".join(facts), loc="left", fontsize=9.0, fontweight="normal", color="#444444")


def mark_stop(panels: Sequence[Axes], where: float) -> None:
    """Draw a line at a protective stop's place on the first axis of finished panels, behind their legends."""
    for axes in panels:
        axes.axvline(where, color=RED, lw=1.3, zorder=4)
        legend = axes.get_legend()
        if legend is not None:
            legend.set_frame_on(True)
            legend.get_frame().set(facecolor="white", edgecolor="none", alpha=1.0)
    panels[0].plot(where, 1.0, "X", color=RED, ms=8, transform=panels[0].get_xaxis_transform(), clip_on=False, zorder=9)


def say_stop(figure: Figure, text: str) -> None:
    """Say below a figure why the run it shows stopped."""
    figure.supxlabel(f"\u2715 {text}", x=0.01, ha="left", color=RED, fontsize=9.0)


def shade_band(axes: Axes, center: float, half_width: float, label: str) -> None:
    """Shade a tolerance band around a target and draw the target as a line."""
    axes.axhspan(center - half_width, center + half_width, color=GREEN, alpha=0.13, lw=0, label=label, zorder=0)
    axes.axhline(center, color=GREEN, lw=0.9, ls="--", zorder=1)


# The frame pictures of a part are drawn in: to the right, to the back, up (up -> rotation).

ALONG = 0.9998  #: Cosine of about one degree: a direction as close to an axis is called by its name


def view_frame(up: Array) -> Array:
    """R_view_work, its rows the picture's right, back and up in the work frame; ``up``: away from the table, (3,)."""
    right = np.cross([0.0, 1.0, 0.0], up) if abs(up[1]) < 0.9 else np.cross([0.0, 0.0, -1.0], up)
    right = unit(right)
    return np.stack([right, np.cross(up, right), up])


def axis_name(direction: Array) -> str:
    """Which of the part's axes a direction of the picture is, to tell views apart: ``+x``, ``-y``, or as numbers."""
    largest = int(np.abs(direction).argmax())
    if abs(direction[largest]) > ALONG:
        return ("-" if direction[largest] < 0.0 else "+") + "xyz"[largest]
    # Adding zero turns -0.0 into 0.0.
    return ", ".join(f"{round(float(value), 2) + 0.0:g}" for value in direction)


# Which points of a picture the part itself stands before: a depth picture of its facets.

Projection = Callable[[Array], Array]  #: Points to places and depths (larger is nearer), (n, 3); lines stay straight

PIXELS = 250  #: Of a depth picture, along the longer side of the part
APART = 0.75  #: Pixels between samples of a facet, at most
LIFT = 2.0  #: Pixels by which points are taken off the surface: more than depths within a pixel of a plane differ
SAMPLES_AT_ONCE = 300_000


class DepthPicture(NamedTuple):
    """The part as a viewer sees it."""

    project: Projection
    low: Array  #: Corner of the picture, shape (2,)
    pixel: float  #: Side of a pixel in the picture's own unit
    depth: Array  #: Depth of what is seen in each pixel, minus infinity beside the part, shape (columns, rows)
    lift: float  #: Way off the surface that keeps it from hiding its own points, in the unit of the points


def depth_picture(corners: Array, project: Projection) -> DepthPicture:
    """Depths of a part in a picture, from corners of its facets (m, 3, 3); exact at samples less than a pixel apart."""
    points = corners.reshape(-1, 3)
    seen = project(points).reshape(-1, 3, 3)
    low, high = seen[..., :2].min(axis=(0, 1)), seen[..., :2].max(axis=(0, 1))
    pixel = float((high - low).max()) / PIXELS
    depth = np.full(tuple(np.ceil((high - low) / pixel).astype(int) + 1), -np.inf)
    for samples in _samples(seen, APART * pixel):
        columns, rows = ((samples[:, :2] - low) / pixel).astype(int).T
        np.maximum.at(depth.ravel(), columns * depth.shape[1] + rows, samples[:, 2])
    lift = LIFT * float(np.linalg.norm(np.ptp(points, axis=0))) / PIXELS
    return DepthPicture(project, low, pixel, depth, lift)


def seen_in(picture: DepthPicture, points: Array, off: Array) -> Bools:
    """Whether points (n, 3) are before the part or beside it; ``off``: unit vectors away from the part there."""
    places = picture.project(points + picture.lift * off)
    columns, rows = np.floor((places[:, :2] - picture.low) / picture.pixel).astype(int).T
    width, height = picture.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    before = np.full(len(points), True)
    before[inside] = places[inside, 2] >= picture.depth[columns[inside], rows[inside]]
    return before


def _samples(seen: Array, apart: float) -> Iterator[Array]:
    """Points on triangles (m, 3, 3), at most so far apart, some at a time, (k, 3)."""
    edges = np.linalg.norm(seen[:, :, :2] - np.roll(seen[:, :, :2], 1, axis=1), axis=2).max(axis=1)
    # Powers of two, so that few sets of weights are needed.
    steps = 2 ** np.ceil(np.log2(np.maximum(edges / apart, 1.0))).astype(int)
    for count in np.unique(steps):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        within = i + j <= count
        weights = np.column_stack([i[within], j[within], count - i[within] - j[within]]) / count
        chosen = np.flatnonzero(steps == count)
        for part in np.array_split(chosen, -(-len(chosen) * len(weights) // SAMPLES_AT_ONCE)):
            yield (weights @ seen[part]).reshape(-1, 3)
