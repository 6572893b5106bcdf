"""Speed, acceleration and jerk of tool and joints over time, with limits."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from polish_sim.analysis.style import BLUE, GREEN, GREY, ORANGE, new_figure, styled
from polish_sim.motion.rules.chain import Chain
from polish_sim.motion.rules.deviation import Deviation, DeviationCurve, deviation_curve, vertex_distances
from polish_sim.motion.rules.schedule import Schedule, sample_schedule

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


# Corners of a smoothed path seen from near: path, tolerance and the way the tip takes.

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


# Which corners of a smoothed path are worth a look, and what is seen there (Chain, Schedule -> CornerView).

LEAST_TURN: Final = 1e-4
"""A way point the path turns less at is no corner [rad]."""
SAMPLES: Final = 1500
"""Of each way through a view."""
WINDOW: Final = 12
"""The view's path is made of so many way points to either side."""


class Way(NamedTuple):
    """One rule's motion, with when it comes nearest to each way point of the path."""

    chain: Chain
    schedule: Schedule
    distances: Array
    """[m], shape (n + 1,)."""
    times: Array
    """[s], shape (n + 1,)."""


def way_past(raw: Chain, chain: Chain, schedule: Schedule) -> Way:
    """A motion, and when it comes nearest to each of the path's way points."""
    distances, times = vertex_distances(chain, schedule, raw)
    times = times.copy()
    times[0], times[-1] = 0.0, schedule.end
    return Way(chain, schedule, distances, times)


def path_turns(raw: Chain) -> Array:
    """How much the tip's path turns at every way point [rad], 0 where it begins, ends or stays, shape (n + 1,)."""
    old, new = raw.directions[:-1], raw.directions[1:]
    turns = np.arctan2(np.linalg.norm(np.cross(old, new), axis=1), np.sum(old * new, axis=1))
    turns[(raw.lengths[:-1] == 0.0) | (raw.lengths[1:] == 0.0)] = 0.0
    return np.concatenate([[0.0], turns, [0.0]])


def chosen_corners(turns: Array, way: Way, deviation: Deviation) -> list[tuple[int, str]]:
    """Way points to be shown with what is special about them: the worst ones, and typical ones by their turn.

    Args:
        turns: Of the path [rad], shape (n + 1,).
        way: The motion.
        deviation: Its largest deviations.

    Returns:
        Up to six, the worst first.
    """
    corners = np.flatnonzero(turns > LEAST_TURN)
    if not len(corners):
        return []
    nearest = int(corners[np.abs(way.times[corners] - deviation.contour.time).argmin()])
    chosen = {nearest: "path left furthest"}
    chosen.setdefault(int(corners[way.distances[corners].argmax()]), "corner missed furthest")
    by_turn = corners[turns[corners].argsort(kind="stable")]
    for share in np.linspace(1.0, 0.0, SHOWN):
        if len(chosen) < SHOWN:
            chosen.setdefault(int(by_turn[round(share * (len(by_turn) - 1))]), "corner")
    return list(chosen.items())


def view_corner(
    raw: Chain, rows: NDArray[np.int64], ways: Sequence[Way], corner: tuple[int, str], turn: float, tolerance: float
) -> CornerView:
    """See a corner from near, in the plane of its two segments.

    Args:
        raw: The path.
        rows: Row of the file's path of each way point, for the name.
        ways: The motions, one a rule.
        corner: The way point and what is special about it.
        turn: How much the path turns there [rad].
        tolerance: [m].

    Returns:
        What is seen.
    """
    k, name = corner
    frame = flat_view(raw.tips, k)
    near = slice(max(k - WINDOW, 0), k + WINDOW + 1)
    half = max(VIEW * max(ways[0].distances[k], tolerance), LEAST_VIEW_M)
    tips = [_tips_near(way, k, 1.5 * half) for way in ways]
    return CornerView(
        name=f"{name}: point {rows[k] + 1}",
        path=(raw.tips[near] - raw.tips[k]) @ frame.T,
        ways=tuple((way - raw.tips[k]) @ frame.T for way in tips),
        tolerance=tolerance,
        vertex=float(ways[0].distances[k]),
        contour=_contour_near(raw, ways[0], k),
        turn=turn,
    )


def _tips_near(way: Way, corner: int, radius: float) -> Array:
    """The tip's way [m] within a distance of a corner, shape (m, 3)."""
    at, place = float(way.times[corner]), None
    span = 1e-3
    # The tip is slow at sharp corners: the time it takes to leave the view is found by doubling.
    while True:
        times = np.linspace(max(at - span, 0.0), min(at + span, way.schedule.end), SAMPLES)
        tips = sample_schedule(way.chain, way.schedule, times).tips[:, 0]
        place = sample_schedule(way.chain, way.schedule, np.array([at])).tips[0, 0]
        ends = np.linalg.norm(tips[[0, -1]] - place, axis=1)
        out = (ends > radius) | np.array([at - span <= 0.0, at + span >= way.schedule.end])
        if out.all():
            return np.asarray(tips)
        span *= 2.0


def _contour_near(raw: Chain, way: Way, corner: int) -> float:
    """Largest distance of the tip from the path, half way to the neighbouring way points [m]."""
    before, at, after = way.times[corner - 1 : corner + 2]
    times = np.linspace(0.5 * (before + at), 0.5 * (at + after), SAMPLES)
    return float(deviation_curve(way.chain, way.schedule, raw, times).tip.max())
