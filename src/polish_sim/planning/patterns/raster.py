"""Zig-zag along the border's inside, and a turn along the border itself (pattern; Region -> runs).

Lines side by side are cut where they come near the border; from line to line the path follows the border. One closed
turn half a step-over inside the border covers what the lines' ends leave; it is joined to the zig-zag without a lift.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.curves.level_set import level_lines
from polish_sim.planning.curves.offset_curve import nearest_of, offset_curve
from polish_sim.planning.curves.turns import border_curves, distance_to
from polish_sim.planning.patterns.raster_lines import parallel_lines
from polish_sim.planning.patterns.raster_walk import ENDS, LinePiece, ZigZag, fillet, walk
from polish_sim.planning.patterns.request import PatternRequest
from polish_sim.planning.patterns.run import Run, SurfaceRun, finish_run
from polish_sim.planning.toolpath import arc_length
from polish_sim.spatial import unit

Array = NDArray[np.float64]

BORDER_TURN = 0.5
"""Distance of the border turn from the border, in step-overs."""
GIVES_WAY = 0.5
"""A line that comes this much too near to a border in passing bends round it, in step-overs; else it is cut."""
SHORTEST = 0.3
"""A piece of a line shorter than this many step-overs is left out."""
LEAD = 1.2
"""Step-overs over which the border turn leads over into a line that runs the same way."""
LATER = 0.4
"""The border turn begins so much further on where it ends by leading over, in step-overs."""
REACH = 1.6
"""A border turn this many step-overs from where a zig-zag begins is joined to it there."""
GAP = 0.5
"""Half the gap a turn around a hole is entered and left through, in step-overs."""
SMALL = 0.25
"""No gap is more than this share of a turn."""


def raster_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with a zig-zag and a turn along its border, in one stroke where the region allows.

    Args:
        request: What to cover and how; its plan may say which way the lines run and where to start.

    Returns:
        The strokes, on the surface.

    Raises:
        PlanError: No line runs across the region.
    """
    mesh, stepover = request.mesh, request.stepover
    borders = border_curves(mesh)
    turns, ends = (_inside(request, borders, distance * stepover) for distance in (BORDER_TURN, ENDS))
    lines = parallel_lines(request)
    pieces = [
        p for number, row in enumerate(lines) for line in row for p in _cut(number, line, borders, ends, stepover)
    ]
    strokes = walk(pieces, ends, stepover, request.plan.start)
    runs = _with_turns(strokes, turns, stepover)
    return [finish_run(request.region.surface, run, stepover) for run in runs]


def _inside(request: PatternRequest, borders: Sequence[Curve], distance: float) -> list[Curve]:
    """Closed curves at a distance from all borders, the longest first."""
    mesh = request.mesh
    values = np.minimum(distance_to(mesh, np.arange(len(mesh.vertices)), borders, 3.0 * distance), 3.0 * distance)
    lines = [line for line in level_lines(mesh, values, distance) if line.closed]
    curves = [offset_curve(request.region.surface, borders, line, distance) for line in lines]
    return sorted(curves, key=lambda curve: -curve.length)


def _cut(number: int, line: Curve, borders: Sequence[Curve], ends: Sequence[Curve], stepover: float) -> list[LinePiece]:
    """The pieces of a line that keep away from the border."""
    s = np.linspace(0.0, line.length, max(int(line.length / (0.05 * stepover) + 1e-6), 8) + 1)
    points = line.at(s)[0]
    depth = nearest_of(borders, points).nearest.distances / stepover - ENDS
    # Where it comes only a little too near to the border it gives way.
    for i, j in _stretches(depth <= 0.0):
        if i > 0 and j + 1 < len(s) and depth[i : j + 1].min() > -GIVES_WAY and ends:
            points[i : j + 1] = nearest_of(ends, points[i : j + 1]).nearest.positions
            depth[i : j + 1] = 1e-9
    pieces = []
    for i, j in _stretches(depth > 0.0):
        kept = [points[i : j + 1]]
        if i > 0:
            kept.insert(0, _between(points[i - 1], points[i], depth[i - 1 : i + 1]))
        if j + 1 < len(s):
            kept.append(_between(points[j], points[j + 1], depth[j : j + 2]))
        positions = np.concatenate(kept)
        if arc_length(positions)[-1] > SHORTEST * stepover:
            pieces.append(LinePiece(number, positions))
    return pieces


def _stretches(wanted: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of every row of true values."""
    change = np.diff(np.concatenate([[0], wanted.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(change > 0).tolist(), (np.flatnonzero(change < 0) - 1).tolist(), strict=True))


def _between(first: Array, second: Array, depth: Array) -> Array:
    """The point between two at which the depth is zero, shape (1, 3)."""
    share = depth[0] / (depth[0] - depth[1])
    return np.asarray(first + share * (second - first))[None]


def _with_turns(strokes: Sequence[ZigZag], turns: Sequence[Curve], stepover: float) -> list[Run]:
    """Border turns joined to the strokes: one before a stroke's beginning, others where a stroke passes by."""
    waiting, runs = list(turns), []
    for stroke in strokes:
        positions = stroke.positions
        near = [k for k, turn in enumerate(waiting) if _away(turn, positions[0]) < REACH * stepover]
        if near:
            positions = _turn_first(waiting.pop(near[0]), positions, stepover)
        for place in stroke.passing:
            near = [k for k, turn in enumerate(waiting) if _away(turn, place) < ENDS * stepover]
            if near:
                positions = _turn_between(waiting.pop(near[0]), positions, place, stepover)
        runs.append(positions)
    runs += [turn.between(0.0, turn.length - min(GAP * stepover, SMALL * turn.length))[0] for turn in waiting]
    return [Run(positions, np.full(len(positions), number)) for number, positions in enumerate(runs)]


def _away(turn: Curve, point: Array) -> float:
    return float(turn.nearest(point[None]).distances[0])


def _turn_first(turn: Curve, positions: Array, stepover: float) -> Array:
    """Once round a turn, then over into a stroke in the direction it sets out."""
    foot = float(turn.nearest(positions[:1]).s[0])
    ahead = unit(positions[min(8, len(positions) - 1)] - positions[0])
    along = float(turn.tangents(np.array([foot]), 0.25 * stepover)[0] @ ahead)
    sign, lead = (1.0 if along >= 0.0 else -1.0), LEAD * abs(along) * stepover
    corner = foot - sign * lead
    first = corner + sign * (GAP + LATER * abs(along)) * stepover
    begin, end = sorted([first, corner + sign * (turn.length - GAP * stepover)])
    lap = turn.between(begin, end)[0][:: int(sign)]
    over = fillet(lap[-1], turn.at(np.array([corner]))[0][0], positions[0])
    return np.concatenate([lap, over, positions])


def _turn_between(turn: Curve, positions: Array, place: Array, stepover: float) -> Array:
    """Once round a turn that a stroke passes by: out through a gap, round the other way, and back."""
    along = arc_length(positions)
    at = along[int(np.linalg.norm(positions - place, axis=1).argmin())]
    leave, come = (
        np.searchsorted(along, at - 0.5 * GAP * stepover) - 1,
        np.searchsorted(along, at + 0.5 * GAP * stepover),
    )
    leave, come = max(int(leave), 0), min(int(come), len(along) - 1)
    out, back = turn.nearest(positions[[leave, come]]).s
    with_it = float(turn.tangents(np.array([out]), 0.25 * stepover)[0] @ (positions[come] - positions[leave])) > 0.0
    if with_it:
        lap = turn.between(float(back), float(back + np.mod(out - back, turn.length)))[0][::-1]
    else:
        lap = turn.between(float(out), float(out + np.mod(back - out, turn.length)))[0]
    return np.concatenate([positions[: leave + 1], lap, positions[come:]])
