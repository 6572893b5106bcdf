"""Zig-zag: lines side by side along the region's long axis, joined by rounded turns (pattern; Region -> runs).

The middle line is a plane section; every other one is the offset of its neighbour, so that lines keep their
distance on the surface, not in a projection.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from polish_sim.errors import PlanError
from polish_sim.geometry import Region, Surface
from polish_sim.planning.curve import Curve, unit
from polish_sim.planning.level_set import LevelLine, level_lines
from polish_sim.planning.offset_curve import nearest_of, offset_curve
from polish_sim.planning.request import PatternRequest, Report
from polish_sim.planning.run import Run, SurfaceRun, finish_run
from polish_sim.planning.triangulation import Triangulation
from polish_sim.planning.turns import border_curves, distance_to

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MARGIN = 0.5
"""Distance of the lines' ends from the border in step-overs."""
LONGEST_TRIM = 1.5
"""A line that runs along the border loses no more than this many step-overs at its ends."""
REACH = 6.0
"""A line's ends are thought to go on straight for this many step-overs where its neighbour is longer."""
LINK = 8.0
"""Longest way from line to line without a lift, in step-overs."""
OFF = 0.15
"""How far the straight way from line to line may leave the surface, in step-overs."""


class Stretch(NamedTuple):
    """A piece of a line inside the region."""

    line: int
    """Number of the line, counted across the region."""
    positions: Array
    """Points [m], shape (n, 3)."""


def plan_raster(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with a zig-zag, one where the region allows.

    Args:
        request: What to cover and how.

    Returns:
        The zig-zags, on the surface.
    """
    region, mesh, stepover, report = request.region, request.mesh, request.stepover, request.report
    borders = border_curves(mesh)
    lines = _parallel_lines(region, mesh, stepover, report)
    stretches = [_trimmed(number, line, borders, stepover) for number, pieces in enumerate(lines) for line in pieces]
    stretches = [stretch for stretch in stretches if len(stretch.positions) > 1]
    return [finish_run(region.surface, run, stepover) for run in _zigzags(region.surface, stretches, stepover)]


def _parallel_lines(region: Region, mesh: Triangulation, stepover: float, report: Report) -> list[list[Curve]]:
    """Lines from one side of the region to the other, each the pieces between borders."""
    heights = (mesh.vertices - mesh.vertices.mean(axis=0)) @ _short_axis(mesh, region.up)
    lines, above, below = _both_sides(region, mesh, heights, 0.0, stepover, lambda share: report(0.5 * share))
    # Shift all lines so that the first and the last run at most 0.55 step-overs inside the border.
    width = above + below + (len(lines) - 1) * stepover
    needed = max(int(np.ceil(width / stepover - 0.1)), 1)
    margin = 0.5 * (width - (needed - 1) * stepover)
    shift = float(np.mod(above - margin + 0.5 * stepover, stepover) - 0.5 * stepover)
    return _both_sides(region, mesh, heights, shift, stepover, lambda share: report(0.5 + 0.5 * share))[0]


def _both_sides(
    region: Region, mesh: Triangulation, heights: Array, level: float, stepover: float, report: Report
) -> tuple[list[list[Curve]], float, float]:
    """Offset the section at a height to both sides; how much is left beyond the last lines above and below [m]."""
    middle = [Curve(line.positions, unit(line.normals), False) for line in _open(level_lines(mesh, heights, level))]
    if not middle:
        raise PlanError(
            "lines side by side do not fit this region: none across its middle runs from border to border. "
            "Choose a region that looks one way, e.g. 'auto', or another pattern."
        )
    lines, left = [middle], []
    for side in (1.0, -1.0):
        inside, last = side * (heights - level) > 0.0, middle
        while True:
            following, beyond = _next_line(region, mesh, last, inside, stepover)
            if not following:
                break
            last, inside = following, beyond
            lines = [*lines, last] if side > 0.0 else [last, *lines]
            share = 0.5 * float(mesh.vertex_areas[inside].sum() / mesh.vertex_areas.sum())
            report(0.75 - 0.25 * side - share)
        left.append(_depth_beyond(mesh, last, inside, stepover))
    return lines, left[0], left[1]


def _depth_beyond(mesh: Triangulation, lines: Sequence[Curve], inside: Mask, stepover: float) -> float:
    """How far the region goes on beyond its last line [m]."""
    if not inside.any():
        return 0.0
    distance = distance_to(mesh, np.flatnonzero(inside), lines, 2.0 * stepover)
    return float(distance[np.isfinite(distance)].max(initial=0.0))


def _short_axis(mesh: Triangulation, up: Array) -> Array:
    """Horizontal direction in which the region is narrowest, seen from above, shape (3,)."""
    first = np.cross(up, np.eye(3)[int(np.abs(up).argmin())])
    first /= np.linalg.norm(first)
    second = np.cross(up, first)
    flat = mesh.vertices @ np.stack([first, second], axis=1)
    corners = flat[ConvexHull(flat).vertices]
    # The narrowest way is always square to a side of the convex hull.
    sides = unit(np.roll(corners, -1, axis=0) - corners)
    across = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    narrowest = across[np.ptp(corners @ across.T, axis=0).round(9).argmin()]
    return np.asarray(narrowest[0] * first + narrowest[1] * second)


def _open(lines: Sequence[LevelLine]) -> list[LevelLine]:
    return [line for line in lines if not line.closed]


def _next_line(
    region: Region, mesh: Triangulation, lines: Sequence[Curve], inside: Mask, stepover: float
) -> tuple[list[Curve], Mask]:
    """The line one step-over further out, and the vertices beyond it."""
    longer = [_extended(line, REACH * stepover) for line in lines]
    # Behind the last line there is no distance, so that the level line does not run round its ends.
    distance = np.full(len(inside), -1.0)
    rows = np.flatnonzero(inside)
    distance[rows] = np.minimum(distance_to(mesh, rows, longer, 2.5 * stepover), 2.5 * stepover)
    found = _open(level_lines(mesh, distance, stepover))
    return (
        [offset_curve(region.surface, longer, line, stepover) for line in found if len(line.positions) > 3],
        inside & (distance > stepover),
    )


def _extended(line: Curve, length: float) -> Curve:
    """A line that goes straight on at both ends."""
    ends = []
    for s, sign in ((0.0, -1.0), (line.length, 1.0)):
        position, normal = line.at(np.array([s]))
        way = sign * line.tangents(np.array([s]), min(0.02 * line.length, 0.25 * length))
        steps = np.linspace(0.0, length, 25)[1:, None]
        more = position + steps * way
        ends.append((more[::-1] if sign < 0.0 else more, np.tile(normal, (len(more), 1))))
    return Curve(
        np.concatenate([ends[0][0], line.positions, ends[1][0]]),
        np.concatenate([ends[0][1], line.normals, ends[1][1]]),
        False,
    )


def _trimmed(number: int, line: Curve, borders: Sequence[Curve], stepover: float) -> Stretch:
    """A line without its ends, which come too near the border."""
    s = np.linspace(0.0, line.length, max(int(line.length / (0.05 * stepover)), 8) + 1)
    positions = line.at(s)[0]
    clear = nearest_of(borders, positions).nearest.distances > 0.98 * MARGIN * stepover
    longest = min(LONGEST_TRIM * stepover, 0.4 * line.length)
    first = int(np.argmax(clear | (s >= longest)))
    last = len(s) - 1 - int(np.argmax(clear[::-1] | (line.length - s[::-1] >= longest)))
    return Stretch(number, positions[first : last + 1])


def _zigzags(surface: Surface, stretches: Sequence[Stretch], stepover: float) -> list[Run]:
    """Walk the stretches line by line, turning round at the ends; lift where no next line begins nearby."""
    waiting = list(stretches)
    runs = []
    while waiting:
        stretch = waiting.pop(0)
        points, passes = [stretch.positions], [np.full(len(stretch.positions), stretch.line)]
        while True:
            following = _follower(surface, waiting, stretch.line, points[-1][-1], stepover)
            if following is None:
                break
            index, positions = following
            stretch = waiting.pop(index)
            points.append(positions)
            passes.append(np.full(len(positions), stretch.line))
        runs.append(Run(np.concatenate(points), np.concatenate(passes)))
    return runs


def _follower(
    surface: Surface, waiting: Sequence[Stretch], line: int, end: Array, stepover: float
) -> tuple[int, Array] | None:
    """The stretch of the next line that begins nearest, in the direction to walk it."""
    best, found = LINK * stepover, None
    for index, stretch in enumerate(waiting):
        if stretch.line > line + 1:
            break
        if stretch.line != line + 1:
            continue
        for positions in (stretch.positions, stretch.positions[::-1]):
            away = float(np.linalg.norm(positions[0] - end))
            way = end + np.linspace(0.0, 1.0, 17)[:, None] * (positions[0] - end)
            if away < best and _stays_on(surface, way, OFF * stepover):
                best, found = away, (index, positions)
    return found


def _stays_on(surface: Surface, way: Array, tolerance: float) -> bool:
    """Whether a straight way runs over the surface, not across a hole or the outside."""
    return bool((np.linalg.norm(surface.closest(way).positions - way, axis=1) < tolerance).all())
