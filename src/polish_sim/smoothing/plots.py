"""Pictures of a smoothed path: rates with limits over time, and corners seen from near."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from polish_sim.analysis.style import (
    BLUE,
    DASHES,
    GREEN,
    GREY,
    ORANGE,
    head,
    limit_line,
    new_figure,
    styled,
)
from polish_sim.arrays import Array, Indices, foot_on_chord, norms, perpendicular, turns_along, unit
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.deviation import Deviation, deviation_curve, vertex_distances
from polish_sim.motion.rules.limits import ORDERS, Arm
from polish_sim.motion.rules.schedule import SmoothMotion
from polish_sim.smoothing.figures import MeasuredMotion, motion_at
from polish_sim.smoothing.place import SmoothingTask

DRAWN = 20_000  #: Samples of a curve; motions of more than that many milliseconds are drawn with fewer
SUFFIX = ("/s", "/s²", "/s³")
LOOKS = ((BLUE, DASHES[0]), (ORANGE, DASHES[1]))
DEGREES = 180.0 / np.pi
MICRO = 1e6
#: A limit is drawn to scale if the curve reaches this share of it; others are only labelled
NEAR = 0.4
SHOWN = 6  #: Corners in the figure
LEAST_VIEW_M = 5e-6  #: Half the width of a view is this at least
VIEW = 2.5  #: Half the width of a view in distances of the corner from the tip
LEAST_TURN = 1e-4  #: A way point the path turns less at is no corner [rad]
GRID = 300  #: Places along each side of a view where the distance from the path is known
SAMPLES = 1500  #: Of each way through a view
WINDOW = 12  #: Way points on either side that a view's path is made of


def draw_smoothing(task: SmoothingTask, motions: Sequence[MeasuredMotion], name: str) -> dict[str, Figure]:
    """Draw tool, joints and corners of a smoothed path, by file name; one curve a rule."""
    raw = task.placed.chain
    limits = task.limits.table
    arm = task.placed.arm
    curves = [_curves(motion, arm) for motion in motions]
    facts = [
        f"{len(raw.lengths)} segments, {1e3 * raw.lengths.sum():.4g} mm",
        ", ".join(f"{each.rule} {each.motion.end:.4g} s" for each in motions),
        f"tolerance {1e3 * task.tolerance:g} mm, {math.degrees(task.axis_tolerance):.3g}°",
    ]
    plots = {"tool.png": plot_tool_rates(curves, limits, f"Tool along {name}", facts)}
    if arm is not None:
        plots["joints.png"] = plot_joints(curves, limits, f"Joints along {name}", facts)
    turns = path_turns(raw)
    ways = [DrawnWay(each.motion, *vertex_distances(each.motion, raw)) for each in motions]
    views = [
        view_corner(raw, task.placed.rows, ways, corner, turns[corner[0]], task.tolerance)
        for corner in chosen_corners(turns, ways[0], motions[0].deviation)
    ]
    if views:
        plots["corners.png"] = plot_corners(
            views, [curve.label for curve in curves], f"Corners of {name}", facts
        )
    return plots


def _curves(measured: MeasuredMotion, arm: Arm | None) -> Curves:
    motion = measured.motion
    times = np.linspace(0.0, motion.end, int(min(DRAWN, max(1e3 * motion.end, 500.0))) + 1)
    return Curves(measured.rule, times, motion_at(motion, times, arm).rates)


class Curves(NamedTuple):
    """One rule's rates over time."""

    label: str
    times: Array  #: [s], shape (n,)
    rates: Array  #: As `SampledMotion.rates`


@styled
def plot_tool_rates(curves: Sequence[Curves], limits: Array, title: str, facts: Sequence[str]) -> Figure:
    """Speed, acceleration and jerk of tip and tool axis over time, with limits; one curve a rule."""
    figure = new_figure(11.0, 7.0)
    grid = figure.subplots(3, 2, sharex=True)
    for (order, column), axes in np.ndenumerate(grid):
        scale, what = ((1e3, "tip [mm"), (DEGREES, "axis [deg"))[column]
        top = _draw(axes, curves, [scale * curve.rates[order, :, column] for curve in curves], 0.9)
        limit = float(scale * limits[order, column])
        if top < NEAR * limit:
            axes.set_ylim(0.0, 1.4 * top if top > 0.0 else 1.0)
            text = f"limit {limit:.4g}" if np.isfinite(limit) else "no limit"
            look: dict[str, Any] = {"ha": "right", "va": "top", "color": GREEN, "fontsize": 8.0}
            axes.text(0.99, 0.97, text, transform=axes.transAxes, **look)
        else:
            limit_line(axes, limit, "limit")
            axes.set_ylim(0.0, 1.12 * max(limit, top))
        axes.set_ylabel(f"{ORDERS[order]} of the {what}{SUFFIX[order]}]")
    _finish(figure, grid, curves, title, facts)
    return figure


@styled
def plot_joints(curves: Sequence[Curves], limits: Array, title: str, facts: Sequence[str]) -> Figure:
    """Share of its limits that the joint nearest to them uses over time, by rule."""
    figure = new_figure(11.0, 7.0)
    grid = figure.subplots(3, 1, squeeze=False, sharex=True)
    for order, axes in enumerate(grid[:, 0]):
        shares = [100.0 * curve.rates[order, :, 2:] / limits[order, 2:] for curve in curves]
        _draw(axes, curves, [share.max(axis=1) for share in shares], 0.8)
        limit_line(axes, 100.0, "limit")
        axes.set(ylabel=f"{ORDERS[order]} [% of limit]", ylim=(0.0, None))
    grid[0, 0].set_title("the joint that is nearest to its limit")
    _finish(figure, grid, curves, title, facts)
    return figure


def _draw(axes: Axes, curves: Sequence[Curves], values: Sequence[Array], width: float) -> float:
    """Draw one value of every rule, the first rule's on top; returns the largest absolute value."""
    for curve, value, (colour, dashes) in list(zip(curves, values, LOOKS, strict=False))[::-1]:
        axes.plot(curve.times, value, color=colour, ls=dashes, lw=width, label=curve.label)
    return max(np.abs(value).max(initial=0.0) for value in values)


def _finish(figure: Figure, grid: Any, curves: Sequence[Curves], title: str, facts: Sequence[str]) -> None:
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
        axes.set_xlim(0.0, max(curve.times[-1] for curve in curves))
    head(figure, title, facts, legend=grid.flat)


# Corners: which are worth a look, and how they are seen from near.


class CornerView(NamedTuple):
    """One corner, flat: x along the old segment, y to the side it turns to, both from the corner [m]."""

    name: str
    path: Array  #: The way points near, shape (k, 2)
    ways: tuple[Array, ...]  #: The tip near it, one a rule, each of shape (m, 2)
    tolerance: float  #: [m]
    vertex: float  #: Distance of the corner from the tip's way [m]
    contour: float  #: Largest distance of the tip from the path near the corner [m]
    turn: float  #: Angle the path turns by [rad]


class DrawnWay(NamedTuple):
    """One rule's motion, with when it is nearest to each way point of the path."""

    motion: SmoothMotion
    distances: Array  #: [m], shape (n + 1,)
    times: Array  #: [s], shape (n + 1,)


def path_turns(raw: Chain) -> Array:
    """Angle the tip's path turns by at every way point [rad], 0 where it begins, ends or stays, shape (n +
    1,)."""
    turns = turns_along(raw.directions)
    turns[(raw.lengths[:-1] == 0.0) | (raw.lengths[1:] == 0.0)] = 0.0
    return np.concatenate([[0.0], turns, [0.0]])


def chosen_corners(turns: Array, way: DrawnWay, deviation: Deviation) -> list[tuple[int, str]]:
    """Up to six way points to be shown with what is special about them: the worst, then typical ones by their
    turn.

    ``turns`` are those of the path (n + 1,) [rad].
    """
    corners = np.flatnonzero(turns > LEAST_TURN)
    if not len(corners):
        return []
    nearest = corners[np.abs(way.times[corners] - deviation.contour.time).argmin()]
    chosen = {nearest: "path left furthest"}
    chosen.setdefault(corners[way.distances[corners].argmax()], "corner missed furthest")
    by_turn = corners[turns[corners].argsort(kind="stable")]
    for share in np.linspace(1.0, 0.0, SHOWN):
        if len(chosen) < SHOWN:
            chosen.setdefault(by_turn[round(share * (len(by_turn) - 1))], "corner")
    return list(chosen.items())


def view_corner(
    raw: Chain,
    rows: Indices,
    ways: Sequence[DrawnWay],
    corner: tuple[int, str],
    turn: float,
    tolerance: float,
) -> CornerView:
    """See a corner (way point and what is special about it) from near, in the plane of its two segments.

    ``rows`` are the file's rows of the way points, for the name; ``turn`` is the path's [rad], ``tolerance``
    the tip's [m].
    """
    k, name = corner
    frame = _flat_frame(raw.tips, k)
    first = ways[0]
    near = slice(max(k - WINDOW, 0), k + WINDOW + 1)
    half = max(VIEW * max(first.distances[k], tolerance), LEAST_VIEW_M)
    tips = tuple((_tips_near(way, k, 1.5 * half) - raw.tips[k]) @ frame.T for way in ways)
    # Contour: half way to the neighbouring way points.
    before, at, after = first.times[k - 1 : k + 2]
    times = np.linspace(0.5 * (before + at), 0.5 * (at + after), SAMPLES)
    contour = deviation_curve(first.motion, raw, times).tip.max()
    path = (raw.tips[near] - raw.tips[k]) @ frame.T
    vertex = first.distances[k]
    return CornerView(f"{name}: point {rows[k] + 1}", path, tips, tolerance, vertex, contour, turn)


def _flat_frame(points: Array, corner: int) -> Array:
    """Rows along the segment before a corner and across it, towards the segment after, shape (2, 3)."""
    old, new = points[corner] - points[corner - 1], points[corner + 1] - points[corner]
    along = unit(old)
    across = new - (new @ along) * along
    straight = np.linalg.norm(across) < 1e-9 * np.linalg.norm(new)
    return np.stack([along, perpendicular(along) if straight else unit(across)])


def _tips_near(way: DrawnWay, corner: int, radius: float) -> Array:
    """The tip's way [m] within a distance of a corner, shape (m, 3)."""
    at = way.times[corner]
    span = 1e-3
    place = way.motion.sample(np.array([at])).tips[0, 0]
    # The tip is slow at sharp corners: the time it takes to leave the view is found by doubling.
    while True:
        times = np.linspace(max(at - span, 0.0), min(at + span, way.motion.end), SAMPLES)
        tips = way.motion.sample(times).tips[:, 0]
        ends = norms(tips[[0, -1]] - place)
        out = (ends > radius) | np.array([at - span <= 0.0, at + span >= way.motion.end])
        if out.all():
            return tips
        span *= 2.0


@styled
def plot_corners(
    views: Sequence[CornerView], labels: Sequence[str], title: str, facts: Sequence[str]
) -> Figure:
    """Up to six corners: way points, the tolerance about them, and the tip's way; deviations in µm."""
    columns = 2 if len(views) == 4 else min(3, max(len(views), 1))
    rows = -(-max(len(views), 1) // columns)
    # Wide enough for the facts, however few the corners.
    figure = new_figure(max(4.0 * columns + (0.5 if columns == 3 else 2.0), 6.5), 4.5 * rows + 0.8)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, view in zip(grid.flat, views, strict=False):
        _draw_corner(axes, view, labels)
        axes.set_title(
            f"{view.name}, turn {np.degrees(view.turn):.1f}°\n"
            f"corner {_micro(view.vertex)} µm off, path left by {_micro(view.contour)} µm",
        )
    for axes in list(grid.flat)[len(views) :]:
        axes.set_visible(False)
    head(figure, title, facts, legend=(grid[0, 0],))
    return figure


def _micro(value: float) -> str:
    """A length in µm, rounding left out."""
    return f"{round(MICRO * value, 3):.3g}"


def _draw_corner(axes: Axes, view: CornerView, labels: Sequence[str]) -> None:
    half = MICRO * max(VIEW * max(view.vertex, view.tolerance), LEAST_VIEW_M)
    path = MICRO * view.path
    if view.tolerance > 0.0:
        across = np.linspace(-half, half, GRID)
        grid = np.stack(np.meshgrid(across, across), axis=-1)
        off = [foot_on_chord(grid - a, b - a)[1] for a, b in pairwise(path)]
        axes.contourf(
            across, across, np.min(off, axis=0), [0.0, MICRO * view.tolerance], colors=[GREEN], alpha=0.13
        )
        axes.fill([], [], color=GREEN, alpha=0.13, lw=0, label="tolerance")
    axes.plot(path[:, 0], path[:, 1], ".-", color=GREY, lw=1.0, ms=5, label="path")
    for way, label, (colour, dashes) in list(zip(view.ways, labels, LOOKS, strict=False))[::-1]:
        axes.plot(MICRO * way[:, 0], MICRO * way[:, 1], color=colour, ls=dashes, lw=1.4, label=label)
    axes.set_aspect("equal")
    axes.set(
        xlim=(-half, half), ylim=(-half, half), xlabel="along the old segment [µm]", ylabel="across [µm]"
    )
