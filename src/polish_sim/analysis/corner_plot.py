"""Corners of a smoothed path seen from near: path, tolerance and the way the tip takes (layer 8c)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from polish_sim.analysis.smoothing_plot import close
from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, new_figure, styled

Array = NDArray[np.float64]

MICRO: Final = 1e6
SHOWN: Final = 6
"""Corners in the figure."""
LEAST_VIEW_M: Final = 5e-6
"""Half the width of a view is this at least."""
VIEW: Final = 2.5
"""Half the width of a view in distances of the corner from the tip."""


class CornerView(NamedTuple):
    """One corner, flat: x along the old segment, y to the side it turns to, both from the corner [m]."""

    name: str
    path: Array
    """The way points near, shape (k, 2)."""
    ways: tuple[Array, ...]
    """What the tip does near, one a rule, each of shape (m, 2)."""
    tolerance: float
    """[m]."""
    vertex: float
    """Distance of the corner from the tip's way [m]."""
    contour: float
    """Largest distance of the tip from the path near the corner [m]."""
    turn: float
    """How much the path turns [rad]."""


def flat_view(points: Array, corner: int) -> Array:
    """A frame to see a corner in, rows along and across, shape (2, 3).

    Args:
        points: Way points [m], shape (n, 3); those beside the corner differ from it.
        corner: Its row.
    """
    old, new = points[corner] - points[corner - 1], points[corner + 1] - points[corner]
    along = old / np.linalg.norm(old)
    across = new - (new @ along) * along
    size = np.linalg.norm(across)
    if size < 1e-9 * np.linalg.norm(new):
        across = np.cross(along, np.eye(3)[int(np.abs(along).argmin())])
        size = np.linalg.norm(across)
    return np.stack([along, across / size])


@styled
def plot_corners(views: Sequence[CornerView], labels: Sequence[str], title: str, facts: Sequence[str]) -> Figure:
    """Up to six corners: way points, the tolerance about them, and what the tip does; deviations in µm."""
    columns = 2 if len(views) == 4 else min(3, max(len(views), 1))
    rows = -(-max(len(views), 1) // columns)
    # Wide enough for the facts, however few the corners.
    figure = new_figure(max(4.0 * columns + (0.5 if columns == 3 else 2.0), 6.5), 4.5 * rows + 0.8)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, view in zip(grid.flat, views, strict=False):
        _draw(axes, view, labels)
    for axes in list(grid.flat)[len(views) :]:
        axes.set_visible(False)
    handles, names = grid[0, 0].get_legend_handles_labels()
    close(figure, title, facts, handles, names)
    for axes, view in zip(grid.flat, views, strict=False):
        axes.set_title(
            f"{view.name}, turn {np.degrees(view.turn):.1f}°\n"
            f"corner {_micro(view.vertex)} µm off, path left by {_micro(view.contour)} µm",
            fontsize=8.5,
            fontweight="normal",
            color="#444444",
        )
    return figure


def _micro(value: float) -> str:
    """A length in µm, rounding left out."""
    return f"{round(MICRO * value, 3):.3g}"


def _draw(axes: Axes, view: CornerView, labels: Sequence[str]) -> None:
    half = MICRO * max(VIEW * max(view.vertex, view.tolerance), LEAST_VIEW_M)
    path = MICRO * view.path
    if view.tolerance > 0.0:
        tubes = [_tube(a, b, MICRO * view.tolerance) for a, b in pairwise(path) if np.any(a != b)]
        # One outline of several, so that where they overlap it is no darker.
        tube = PathPatch(Outline.make_compound_path(*tubes), color=GREEN, alpha=0.13, lw=0, label="tolerance")
        axes.add_patch(tube)
    axes.plot(path[:, 0], path[:, 1], ".-", color=GREY, lw=1.0, ms=5, label="path")
    for way, label, colour in list(zip(view.ways, labels, (BLUE, ORANGE), strict=False))[::-1]:
        axes.plot(MICRO * way[:, 0], MICRO * way[:, 1], color=colour, lw=1.4, label=label)
    axes.set_aspect("equal")
    axes.set_xlim(-half, half)
    axes.set_ylim(-half, half)
    axes.set_xlabel("along the old segment [µm]")
    axes.set_ylabel("across [µm]")


def _tube(start: Array, end: Array, radius: float) -> Outline:
    """Outline of what is nearer to a segment than a radius, counter-clockwise."""
    along = (end - start) / np.linalg.norm(end - start)
    side = np.array([-along[1], along[0]])
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 33)[:, None]
    half_circle = radius * (np.cos(angles) * along + np.sin(angles) * side)
    outline = np.concatenate([end + half_circle, start - half_circle])
    return Outline(np.concatenate([outline, outline[:1]]), closed=True)
