"""Lines side by side across a region, a step-over apart on the surface (Region -> rows of open curves).

The middle line is a plane section; every other one is the offset of its neighbour, so that lines keep their
distance on the surface, not in a projection.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import PlanError
from polish_sim.geometry import Region, Surface
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.curves.level_set import LevelLine, level_lines
from polish_sim.planning.curves.offset_curve import offset_curve
from polish_sim.planning.curves.turns import distance_to
from polish_sim.planning.ground.footprint import footprint
from polish_sim.planning.ground.triangulation import Triangulation
from polish_sim.planning.patterns.request import PatternRequest, Report
from polish_sim.spatial import unit

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST = 1.55
"""The first and the last line run no more than so many step-overs inside the border."""
REACH = 6.0
"""A line's ends are thought to go on straight for this many step-overs where its neighbour is longer."""
ROUNDING = 1e-6
"""Differences below this share of a step-over, or of a length, are rounding and decide nothing."""
AS_NARROW = 1e-6
"""Ways across a region that differ by less than this share of its size are equally narrow."""


def parallel_lines(request: PatternRequest) -> list[list[Curve]]:
    """Lines from one side of the region to the other, each the pieces between borders.

    Args:
        request: What to cover; its plan may say which way the lines run.

    Returns:
        The lines in order.

    Raises:
        PlanError: No line runs across the region, or their direction is square to it.
    """
    region, mesh, stepover, report = request.region, request.mesh, request.stepover, request.report
    heights = (mesh.vertices - mesh.vertices.mean(axis=0)) @ _across(region, request.plan.raster_direction)
    lines, above, below = _both_sides(region, mesh, heights, 0.0, stepover, lambda share: report(0.5 * share))
    width = above + below + (len(lines) - 1) * stepover
    needed = max(int(np.ceil(width / stepover - 2.0 * MOST - ROUNDING)) + 1, 1)
    margin = 0.5 * (width - (needed - 1) * stepover)
    half = (0.5 + ROUNDING) * stepover
    shift = float(np.mod(above - margin + half, stepover) - half)
    return _both_sides(region, mesh, heights, shift, stepover, lambda share: report(0.5 + 0.5 * share))[0]


def _across(region: Region, wanted: Sequence[float]) -> Array:
    """Unit direction square to the lines and to the region's up, shape (3,)."""
    if not len(wanted):
        return _short_axis(region)
    across = np.cross(region.up, np.array(wanted, dtype=float))
    if np.linalg.norm(across) < 1e-3 * np.linalg.norm(wanted):
        raise PlanError(
            f"lines cannot run along {tuple(wanted)}: that is the way the region looks. "
            "Set a raster direction that lies in the region, or none."
        )
    return unit(across)


def _short_axis(region: Region) -> Array:
    """Direction in which the region is narrowest, seen from above, shape (3,); turns with the part."""
    seen = footprint(region)
    flat, widths = seen.points, seen.widths
    narrow = seen.ways[widths < widths.min() + AS_NARROW * np.ptp(flat, axis=0).max()]
    # Which of equally narrow ways, and which sense, must not hang on how the part lies: any odd mean of its points.
    odd = np.sin(1.0 + np.arange(len(flat))) @ (flat - flat.mean(axis=0))
    along = narrow @ odd
    best = int(np.abs(along).argmax())
    return np.asarray(np.copysign(1.0, along[best]) * (seen.frame @ narrow[best]))


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
        inside, last = side * (heights - level) > ROUNDING * stepover, middle
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


def _open(lines: Sequence[LevelLine]) -> list[LevelLine]:
    return [line for line in lines if not line.closed]


def _next_line(
    region: Region, mesh: Triangulation, lines: Sequence[Curve], inside: Mask, stepover: float
) -> tuple[list[Curve], Mask]:
    """The line one step-over further out, and the vertices beyond it."""
    longer = [_extended(region.surface, line, REACH * stepover) for line in lines]
    # Behind the last line there is no distance, so that the level line does not run round its ends.
    distance = np.full(len(inside), -1.0)
    rows = np.flatnonzero(inside)
    distance[rows] = np.minimum(distance_to(mesh, rows, longer, 2.5 * stepover), 2.5 * stepover)
    found = _open(level_lines(mesh, distance, stepover))
    return (
        [offset_curve(region.surface, longer, line, stepover) for line in found if len(line.positions) > 3],
        inside & (distance > (1.0 + ROUNDING) * stepover),
    )


def _extended(surface: Surface, line: Curve, length: float) -> Curve:
    """A line that goes straight on at both ends, but no further than the middle of a hole."""
    ends = []
    for s, sign in ((0.0, -1.0), (line.length, 1.0)):
        position, normal = line.at(np.array([s]))
        way = sign * line.tangents(np.array([s]), min(0.02 * line.length, 0.25 * length))
        more = position + np.linspace(0.0, length, 49)[1:, None] * way
        off = np.linalg.norm(surface.closest(more).positions - more, axis=1)
        back = off < 0.5 * np.maximum.accumulate(off) - ROUNDING * length
        if back.any():
            more = more[: int(off[: int(back.argmax())].argmax()) + 1]
        ends.append((more[::-1] if sign < 0.0 else more, np.tile(normal, (len(more), 1))))
    return Curve(
        np.concatenate([ends[0][0], line.positions, ends[1][0]]),
        np.concatenate([ends[0][1], line.normals, ends[1][1]]),
        False,
    )
