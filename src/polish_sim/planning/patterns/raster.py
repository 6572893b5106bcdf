"""Zig-zag along the border's inside, and a turn along the border itself (pattern; Region -> runs).

Lines side by side are cut where they come near the border; from line to line the path follows the border. One
closed turn half a step-over inside the border covers what the lines' ends leave; it is joined to the zig-zag
without a lift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polish_sim.arrays import Array, Bools, joined, longest_side, norms, unit
from polish_sim.errors import PlanError
from polish_sim.geometry import Region, Surface
from polish_sim.planning.curve import Curve, CurveSet
from polish_sim.planning.ground import Triangulation, footprint
from polish_sim.planning.offset_curve import level_lines, offset_curve
from polish_sim.planning.patterns.raster_walk import ENDS, LinePiece, ZigZag, fillet, walk
from polish_sim.planning.patterns.run import PatternRequest, Run, SurfaceRun
from polish_sim.planning.toolpath import arc_length, stretches
from polish_sim.planning.turns import Report, border_curves, distance_to

# Lines side by side across a region, a step-over apart on the surface (Region -> rows of open curves).
#
# The middle line is a plane section; every other one is the offset of its neighbour, so that lines keep their
# distance on the surface, not in a projection.

MOST = 1.55  #: Largest distance of the first and the last line from the border [step-overs]
#: A line's ends are extended straight for this many step-overs where its neighbour is longer
REACH = 6.0
#: Differences below this share of a step-over, or of a length, are rounding and decide nothing
ROUNDING = 1e-6
AS_NARROW = 1e-6  #: Ways across a region that differ by less than this share of its size are equally narrow


def _parallel_lines(request: PatternRequest) -> list[list[Curve]]:
    """Lines from one side of the region to the other in order, each the pieces between borders."""
    region = request.region
    mesh = request.mesh
    stepover = request.stepover
    report = request.report
    heights = (mesh.vertices - mesh.vertices.mean(axis=0)) @ _across(region, request.plan.raster_direction)
    lines, above, below = _both_sides(region, mesh, heights, 0.0, stepover, lambda share: report(0.5 * share))
    width = above + below + (len(lines) - 1) * stepover
    needed = max(int(np.ceil(width / stepover - 2.0 * MOST - ROUNDING)) + 1, 1)
    margin = 0.5 * (width - (needed - 1) * stepover)
    half = (0.5 + ROUNDING) * stepover
    shift = np.mod(above - margin + half, stepover) - half
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
    narrow = seen.ways[widths < widths.min() + AS_NARROW * longest_side(flat)]
    # Break ties by an odd moment of the points, so that the choice turns with the part.
    odd = np.sin(1.0 + np.arange(len(flat))) @ (flat - flat.mean(axis=0))
    along = narrow @ odd
    best = np.abs(along).argmax()
    return np.copysign(1.0, along[best]) * (seen.frame @ narrow[best])


def _both_sides(
    region: Region, mesh: Triangulation, heights: Array, level: float, stepover: float, report: Report
) -> tuple[list[list[Curve]], float, float]:
    """Offset the section at a height to both sides; how much is left beyond the last lines above and below
    [m]."""
    middle = [line.curve for line in level_lines(mesh, heights, level) if not line.closed]
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
            share = 0.5 * (mesh.vertex_areas[inside].sum() / mesh.vertex_areas.sum())
            report(0.75 - 0.25 * side - share)
        # How far the region extends beyond its last line.
        beyond_last = distance_to(mesh, np.flatnonzero(inside), last, 2.0 * stepover)
        left.append(beyond_last[beyond_last < 2.0 * stepover].max(initial=0.0))
    return lines, left[0], left[1]


def _next_line(
    region: Region, mesh: Triangulation, lines: Sequence[Curve], inside: Bools, stepover: float
) -> tuple[list[Curve], Bools]:
    """The line one step-over further out, and the vertices beyond it."""
    longer = [_extended(region.surface, line, REACH * stepover) for line in lines]
    # Behind the last line there is no distance, so that the level line does not run round its ends.
    distance = np.full(len(inside), -1.0)
    rows = np.flatnonzero(inside)
    distance[rows] = distance_to(mesh, rows, longer, 2.5 * stepover)
    found = [
        offset_curve(region.surface, longer, line, stepover)
        for line in level_lines(mesh, distance, stepover)
        if not line.closed and len(line.positions) > 3
    ]
    return found, inside & (distance > (1.0 + ROUNDING) * stepover)


def _extended(surface: Surface, line: Curve, length: float) -> Curve:
    """A line that goes straight on at both ends, but no further than the middle of a hole."""
    ends = []
    for s, sign in ((0.0, -1.0), (line.length, 1.0)):
        position, normal = line.at(np.array([s]))
        way = sign * line.tangents(np.array([s]), min(0.02 * line.length, 0.25 * length))
        more = position + np.linspace(0.0, length, 49)[1:, None] * way
        off = norms(surface.closest(more).positions - more)
        back = off < 0.5 * np.maximum.accumulate(off) - ROUNDING * length
        if back.any():
            more = more[: off[: back.argmax()].argmax() + 1]
        ends.append((more[::-1] if sign < 0.0 else more, np.tile(normal, (len(more), 1))))
    positions, normals = joined([ends[0], (line.positions, line.normals), ends[1]])
    return Curve(positions, normals, False)


BORDER_TURN = 0.5  #: Distance of the border turn from the border, in step-overs
#: A line this much too near to a border in passing bends round it, in step-overs; else it is cut
GIVES_WAY = 0.5
SHORTEST = 0.3  #: A piece of a line shorter than this many step-overs is left out
LEAD = 1.2  #: Step-overs over which the border turn leads over into a line that runs the same way
LATER = 0.4  #: How much further on the border turn begins where it ends by leading over [step-overs]
RASTER_REACH = 1.6  #: A border turn this many step-overs from where a zig-zag begins is joined to it there
GAP = 0.5  #: Half the gap a turn around a hole is entered and left through, in step-overs
SMALL = 0.25  #: No gap is more than this share of a turn


def raster_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with a zig-zag and a turn along its border, in one stroke where the region allows.

    Raises:
        PlanError: No line runs across the region.
    """
    mesh, stepover = request.mesh, request.stepover
    borders = border_curves(mesh)
    turns, ends = (_inside(request, borders, distance * stepover) for distance in (BORDER_TURN, ENDS))
    lines = _parallel_lines(request)
    pieces = [
        p
        for number, row in enumerate(lines)
        for line in row
        for p in _cut(number, line, borders, ends, stepover)
    ]
    strokes = walk(pieces, ends, stepover, request.plan.start)
    return request.finished(_with_turns(strokes, turns, stepover))


def _inside(request: PatternRequest, borders: Sequence[Curve], distance: float) -> list[Curve]:
    """Closed curves at a distance from all borders, the longest first."""
    mesh = request.mesh
    values = distance_to(mesh, np.arange(len(mesh.vertices)), borders, 3.0 * distance)
    lines = [line for line in level_lines(mesh, values, distance) if line.closed]
    curves = [offset_curve(request.region.surface, borders, line, distance) for line in lines]
    return sorted(curves, key=lambda curve: -curve.length)


def _cut(
    number: int, line: Curve, borders: Sequence[Curve], ends: Sequence[Curve], stepover: float
) -> list[LinePiece]:
    """The pieces of a line that keep away from the border."""
    s = np.linspace(0.0, line.length, max(int(line.length / (0.05 * stepover) + 1e-6), 8) + 1)
    points = line.points(s)
    depth = CurveSet(borders).nearest(points).distances / stepover - ENDS
    # Where it comes only a little too near to the border it bends aside.
    for i, j in stretches(depth <= 0.0):
        if i > 0 and j + 1 < len(s) and depth[i : j + 1].min() > -GIVES_WAY and ends:
            points[i : j + 1] = CurveSet(ends).nearest(points[i : j + 1]).positions
            depth[i : j + 1] = 1e-9
    pieces = []
    for i, j in stretches(depth > 0.0):
        kept = [points[i : j + 1]]
        if i > 0:
            kept.insert(0, _between(points[i - 1], points[i], depth[i - 1 : i + 1]))
        if j + 1 < len(s):
            kept.append(_between(points[j], points[j + 1], depth[j : j + 2]))
        positions = np.concatenate(kept)
        if arc_length(positions)[-1] > SHORTEST * stepover:
            pieces.append(LinePiece(number, positions))
    return pieces


def _between(first: Array, second: Array, depth: Array) -> Array:
    """The point between two at which the depth is zero, shape (1, 3)."""
    share = depth[0] / (depth[0] - depth[1])
    return (first + share * (second - first))[None]


def _with_turns(strokes: Sequence[ZigZag], turns: Sequence[Curve], stepover: float) -> list[Run]:
    """Border turns joined to the strokes: one before a stroke's beginning, others where a stroke passes
    by."""
    waiting = list(turns)
    runs = []
    for stroke in strokes:
        positions = stroke.positions
        near = [k for k, turn in enumerate(waiting) if _away(turn, positions[0]) < RASTER_REACH * stepover]
        if near:
            positions = _turn_first(waiting.pop(near[0]), positions, stepover)
        for place in stroke.passing:
            near = [k for k, turn in enumerate(waiting) if _away(turn, place) < ENDS * stepover]
            if near:
                positions = _turn_between(waiting.pop(near[0]), positions, place, stepover)
        runs.append(positions)
    runs += [turn.between(0.0, turn.length - min(GAP * stepover, SMALL * turn.length)) for turn in waiting]
    return [Run(positions, np.full(len(positions), number)) for number, positions in enumerate(runs)]


def _away(turn: Curve, point: Array) -> float:
    return turn.nearest(point[None]).distances[0]


def _turn_first(turn: Curve, positions: Array, stepover: float) -> Array:
    """Once round a turn, then over into a stroke in the direction it sets out."""
    foot = turn.nearest(positions[:1]).s[0]
    ahead = unit(positions[min(8, len(positions) - 1)] - positions[0])
    along = turn.tangents(np.array([foot]), 0.25 * stepover)[0] @ ahead
    sign = 1.0 if along >= 0.0 else -1.0
    lead = LEAD * abs(along) * stepover
    corner = foot - sign * lead
    first = corner + sign * (GAP + LATER * abs(along)) * stepover
    begin, end = sorted([first, corner + sign * (turn.length - GAP * stepover)])
    lap = turn.between(begin, end)[:: int(sign)]
    over = fillet(lap[-1], turn.points(np.array([corner]))[0], positions[0])
    return np.concatenate([lap, over, positions])


def _turn_between(turn: Curve, positions: Array, place: Array, stepover: float) -> Array:
    """Once round a turn that a stroke passes by: out through a gap, round the other way, and back."""
    along = arc_length(positions)
    at = along[norms(positions - place).argmin()]
    leave = np.searchsorted(along, at - 0.5 * GAP * stepover) - 1
    come = np.searchsorted(along, at + 0.5 * GAP * stepover)
    leave, come = max(int(leave), 0), min(int(come), len(along) - 1)
    out, back = turn.nearest(positions[[leave, come]]).s
    with_it = turn.tangents(np.array([out]), 0.25 * stepover)[0] @ (positions[come] - positions[leave]) > 0.0
    lap = turn.along(out, -np.mod(out - back, turn.length) if with_it else np.mod(back - out, turn.length))
    return np.concatenate([positions[: leave + 1], lap, positions[come:]])
