"""How every figure looks: colours, head, legend, marks; readable for colour-blind eyes and in black and
white.

Everywhere blue is what was measured or run, green what was asked of it (band, target, limit), grey what it
was made of or compared with, orange an event or a second series, red a protective stop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache, wraps
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import matplotlib
import numpy as np
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import ScaledTranslation

from polish_sim.analysis.claim import figure_of
from polish_sim.arrays import Array, Bools, diagonal_of, norms, unit
from polish_sim.row_file import Metrics

P = ParamSpec("P")
FigureT = TypeVar("FigureT", Figure, Figure | None)

# Colours of Okabe and Ito: distinguishable with every common kind of colour blindness.
BLUE = "#0072B2"
ORANGE = "#D55E00"
GREEN = "#009E73"
YELLOW = "#E69F00"
SKY = "#56B4E9"
PINK = "#CC79A7"
GREY = "#6E6E6E"
RED = "#E00020"
SERIES = (BLUE, ORANGE, GREEN, PINK, YELLOW, SKY)
DASHES: Any = ("-", (0, (5, 1.5)), (0, (1.5, 1)), (0, (6, 1.5, 1.5, 1.5)), (0, (3, 3)))
MARKS = ("o", "^", "s", "D", "v", "P")
HATCHES = ("", "//")  #: Of bars of two series
AXIS_COLORS = (BLUE, ORANGE, PINK)  #: Of x, y and z, of force and place alike
GAP = " " * 5  #: Between the figures of a head

_RC: Any = matplotlib.rc_params_from_file(
    Path(__file__).with_name("style.mplstyle"), use_default_template=False
)


OTHER_SCRIPTS = (
    "Noto Sans CJK JP",
    "Noto Sans CJK SC",
    "WenQuanYi Zen Hei",
    "IPAGothic",
    "Microsoft YaHei",
)
"""Fonts for names of parts in Chinese and Japanese, where they are installed."""


@cache
def _fonts() -> list[str]:
    known = {font.name for font in font_manager.fontManager.ttflist}
    return ["DejaVu Sans", *(name for name in OTHER_SCRIPTS if name in known)]


def styled(plot: Callable[P, FigureT]) -> Callable[P, FigureT]:
    """Draw a figure in the house style; matplotlib's own settings are back as they were afterwards."""

    @wraps(plot)
    def draw(*args: P.args, **kwargs: P.kwargs) -> FigureT:
        with matplotlib.rc_context(_RC | {"font.family": _fonts()}):
            return plot(*args, **kwargs)

    return draw


def new_figure(width: float, height: float) -> Figure:
    """An empty figure whose parts arrange themselves without overlap; sizes in inch."""
    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def line_look(number: int) -> dict[str, Any]:
    """Colour and dashes of the line of a series: distinct without colours too."""
    return {"color": SERIES[number % len(SERIES)], "ls": DASHES[number % len(DASHES)]}


# The head of a figure: its title, under it what it comes to in figures, and why the run stopped; the legend
# is below.

TITLE_SIZE = 11.5
LINE = 1.2 * TITLE_SIZE / 72.0  #: Height of a line of the head [inch]
TOP = 5.5 / 72.0  #: From the figure's border to the top of its first line [inch]
LETTERS_PER_INCH = 13.5  #: Of small print
MARGIN = 0.03  #: Beside the data of a panel, share of their width
HANDLE = 9  #: Width of the mark before a name in a legend, in letters


def head(figure: Figure, title: str, facts: Sequence[str] = (), legend: Sequence[Axes] = ()) -> None:
    """Head a figure with what it shows and, in small print, its figures; name what the panels of a legend
    show.

    The legend stands below the figure, off the data; what several panels show is named once.
    """
    figure.suptitle(title, x=0.01, ha="left", fontsize=TITLE_SIZE, fontweight="bold")
    lines: list[str] = []
    for fact in facts:
        if lines and len(lines[-1]) + len(GAP) + len(fact) <= LETTERS_PER_INCH * figure.get_figwidth():
            lines[-1] += GAP + fact
        else:
            lines.append(fact)
    for line in lines:
        add_line(figure, line)
    named = {
        label: handle
        for axes in legend
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    if named:
        columns = int(LETTERS_PER_INCH * figure.get_figwidth() / (max(map(len, named)) + HANDLE))
        figure.legend(
            named.values(), named.keys(), loc="outside lower left", ncols=max(min(columns, len(named)), 1)
        )


def say_stop(figure: Figure, text: str) -> None:
    """Say in the head of a figure why the run it shows stopped."""
    add_line(figure, f"\u2715 {text}", RED)


def add_line(figure: Figure, text: str, color: str = "#444444") -> None:
    """Add a line in small print to the head of a figure."""
    title = figure.get_suptitle()
    # A blank line of the title, so that the layout leaves room.
    figure.suptitle(f"{title}\n ", x=0.01, ha="left", fontsize=TITLE_SIZE, fontweight="bold")
    down = ScaledTranslation(0.0, -TOP - LINE * (1 + title.count("\n")), figure.dpi_scale_trans)
    figure.text(0.01, 1.0, text, color=color, fontsize=9.0, va="top", transform=figure.transFigure + down)


def say_instead(axes: Axes, text: str) -> None:
    """Say in an empty panel why it is."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center")


def mark_stop(panels: Sequence[Axes], where: float) -> None:
    """Draw a line at a protective stop's place on the first axis of finished panels, which end there."""
    for axes in panels:
        data = [np.asarray(line.get_xdata(), dtype=float) for line in axes.lines]
        low = min([np.nanmin(x) for x in data if len(x) > 2], default=where)
        low = max(low, axes.get_xlim()[0])
        # Where a run stops as it starts, what came after is all there is.
        high = where if where > low else axes.get_xlim()[1]
        axes.set_xlim(low - MARGIN * (high - low), high + MARGIN * (high - low))
        axes.axvline(
            where, color=RED, lw=1.6, zorder=4, label="protective stop" if axes is panels[0] else None
        )
    panels[0].plot(
        where, 1.0, "X", color=RED, ms=8, transform=panels[0].get_xaxis_transform(), clip_on=False, zorder=9
    )


def shade_band(axes: Axes, center: float, half_width: float, label: str) -> None:
    """Shade a tolerance band around a target and draw the target as a line."""
    axes.axhspan(
        center - half_width, center + half_width, color=GREEN, alpha=0.13, lw=0, label=label, zorder=0
    )
    for edge in (center - half_width, center + half_width):
        axes.axhline(edge, color=GREEN, lw=0.6, zorder=0)
    axes.axhline(center, color=GREEN, lw=0.9, ls="--", zorder=1)


def limit_line(axes: Axes, value: float, label: str) -> None:
    """Draw what is not to be exceeded as a line."""
    axes.axhline(value, color=GREEN, lw=1.0, ls="--", label=label)


def facts_of(metrics: Metrics, *rows: tuple[str, str, float]) -> list[str]:
    """Figures of a run as text, those it does not have left out; a row: text with a place, name and scale."""
    known = [(text, scale * figure_of(metrics, name)) for text, name, scale in rows]
    return [text.format(value) for text, value in known if not np.isnan(value)]


# The frame pictures of a part are drawn in: to the right, to the back, up (up -> rotation).

ALONG = 0.9998  #: Cosine of about one degree: a direction as close to an axis is called by its name


def view_frame(up: Array) -> Array:
    """R_view_work, its rows the picture's right, back and up in the work frame; ``up``: away from the table,
    (3,)."""
    right = np.cross([0.0, 1.0, 0.0], up) if abs(up[1]) < 0.9 else np.cross([0.0, 0.0, -1.0], up)
    right = unit(right)
    return np.stack([right, np.cross(up, right), up])


STEEP = 0.6  #: Least part of a region's mean normal that is level for it to be a side of the part
EDGE_ON = 0.05  #: Cosine of normal and viewer below which a surface is seen edge-on


class Views(NamedTuple):
    """How a region is looked at; rows: a picture's right, its up or back, and its third axis, work frame, (3,
    3)."""

    space: Array  #: R of the picture in space, its third row up, a side of the part turned to the front
    flat: Array  #: R of the flat one: from above, from below, or, of a side, along its face
    name: str  #: From where the flat one looks
    labels: tuple[str, str]  #: Of its axes

    def places(self, points: Array) -> Array:
        """Points (..., 3) [m] in the flat picture [mm], shape (..., 2)."""
        return 1e3 * (points @ self.flat.T)[..., :2]


def views_of(normals: Array, up: Array) -> Views:
    """How to look at a region by its outer normals (n, 3); ``up``: away from the table, (3,)."""
    below = (normals @ up).max(initial=-1.0) < -EDGE_ON
    facing = normals.mean(axis=0)
    level = facing - (facing @ up) * up
    if np.linalg.norm(level) < max(STEEP, 1.5 * abs(facing @ up)):
        frame = view_frame(-up if below else up)
        name = "from below" if below else "from above"
        flat = frame
        upwards = "to the back"
    else:
        frame = np.stack([np.cross(-unit(level), up), -unit(level), up])
        flat = np.stack([frame[0], np.cross(unit(facing), frame[0]), unit(facing)])
        name = f"along its face, from {axis_name(flat[2])}"
        upwards = "up"
    labels = f"to the right ({axis_name(flat[0])}) [mm]", f"{upwards} ({axis_name(flat[1])}) [mm]"
    return Views(frame, flat, name, labels)


def axis_name(direction: Array) -> str:
    """Which of the part's axes a direction of the picture is, to distinguish views: ``+x``, ``-y``, or as
    numbers."""
    largest = np.abs(direction).argmax()
    if abs(direction[largest]) > ALONG:
        return ("-" if direction[largest] < 0.0 else "+") + "xyz"[largest]
    # Adding zero turns -0.0 into 0.0.
    return ", ".join(f"{round(float(value), 2) + 0.0:g}" for value in direction)


# Which points of a picture the part itself stands before: a depth picture of its facets.

PIXELS = 250  #: Of a depth picture, along the longer side of the part
SAMPLE_PIXELS = 0.75  #: Pixels between samples of a facet, at most
#: Pixels by which points are taken off the surface: more than depths within a pixel of a plane differ
LIFT = 2.0
SAMPLES_AT_ONCE = 300_000


class DepthPicture(NamedTuple):
    """The part as a viewer sees it."""

    low: Array  #: Corner of the picture, shape (2,)
    pixel: float  #: Side of a pixel in the picture's own unit
    #: Depth of what is seen in each pixel, minus infinity beside the part, shape (columns, rows)
    depth: Array
    lift: float  #: Way off the surface that keeps it from hiding its own points, in the unit of the points


def depth_picture(corners: Array) -> DepthPicture:
    """Depths of a part in a picture, from corners of its facets (m, 3, 3), their third axis to the viewer;
    exact at samples less than a pixel apart."""
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    pixel = (high - low).max() / PIXELS
    depth = np.full(tuple(np.ceil((high - low) / pixel).astype(int) + 1), -np.inf)
    for samples in _samples(corners, SAMPLE_PIXELS * pixel):
        columns, rows = ((samples[:, :2] - low) / pixel).astype(int).T
        np.maximum.at(depth.ravel(), columns * depth.shape[1] + rows, samples[:, 2])
    return DepthPicture(low, pixel, depth, LIFT * diagonal_of(corners.reshape(-1, 3)) / PIXELS)


def seen_in(picture: DepthPicture, points: Array, off: Array) -> Bools:
    """Whether points (n, 3) are before the part or beside it; ``off``: unit vectors away from the part
    there; axes as of `depth_picture`."""
    places = points + picture.lift * off
    columns, rows = np.floor((places[:, :2] - picture.low) / picture.pixel).astype(int).T
    width, height = picture.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    before = np.full(len(points), True)
    before[inside] = places[inside, 2] >= picture.depth[columns[inside], rows[inside]]
    return before


def _samples(seen: Array, apart: float) -> Iterator[Array]:
    """Points on triangles (m, 3, 3), at most so far apart, some at a time, (k, 3)."""
    edges = norms(seen[:, :, :2] - np.roll(seen[:, :, :2], 1, axis=1)).max(axis=1)
    # Powers of two, so that few sets of weights are needed.
    steps = 2 ** np.ceil(np.log2(np.maximum(edges / apart, 1.0))).astype(int)
    for count in np.unique(steps):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        within = i + j <= count
        weights = np.column_stack([i[within], j[within], count - i[within] - j[within]]) / count
        chosen = np.flatnonzero(steps == count)
        for part in np.array_split(chosen, -(-len(chosen) * len(weights) // SAMPLES_AT_ONCE)):
            yield (weights @ seen[part]).reshape(-1, 3)
