"""The turns that cover a region, from its border inwards, and how they nest (Region -> tree of offset curves)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.curves.level_set import ROUNDING, LevelLine, level_lines
from polish_sim.planning.curves.offset_curve import nearest_of, offset_curve
from polish_sim.planning.curves.stepping import SurfaceQuery
from polish_sim.planning.ground.triangulation import Triangulation

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

THIN = 1.1
"""What is left inside a turn needs another one if its middle is further away than this many step-overs."""

NEAR, FAR = 1.6, 6.0
"""Distances are looked up for vertices that may be nearer than the first, as far as the second, in steps."""
SAME = 1e-8
"""Distances that exceed a limit by this share only because of rounding do not exceed it."""
EVEN = 0.5
"""A ring's width may vary by this many step-overs for turns to run from border to border."""

Report = Callable[[float], None]


@dataclass(eq=False)
class Turn:
    """One offset curve and the turns directly inside it."""

    curve: Curve
    inside: Mask
    """Vertices of the triangulation in the piece this turn bounds, shape (n,)."""
    children: list[Turn] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Piece:
    """A connected part of the region not yet covered, and the turns around it."""

    turns: tuple[Turn, ...]
    inside: Mask
    at_least: Array
    """The vertices are at least this far from the turns [m], shape (n,); saves asking again each time."""


def border_curves(mesh: Triangulation) -> tuple[Curve, ...]:
    """Border of the triangulation as closed curves with the inside on their left, the longest first."""
    follower = dict(mesh.border.tolist())
    curves = []
    while follower:
        here = next(iter(follower))
        loop = []
        while here in follower:
            loop.append(here)
            here = follower.pop(here)
        if len(loop) >= 3:
            curves.append(Curve(mesh.vertices[loop], mesh.normals[loop], True))
    return tuple(sorted(curves, key=lambda curve: -curve.length))


def distance_to(mesh: Triangulation, rows: Ints, curves: Sequence[Curve], limit: float) -> Array:
    """Distance from vertices to the nearest curve on the same side of the part.

    Args:
        mesh: The triangulation.
        rows: Vertices to look at, shape (k,).
        curves: The curves.
        limit: Distances beyond it are inf [m].

    Returns:
        Distances [m], shape (k,).
    """
    feet = nearest_of(curves, mesh.vertices[rows], limit).nearest
    same_side = (feet.normals * mesh.normals[rows]).sum(axis=1) > 0.0
    return np.where(same_side, feet.distances, np.inf)


def grow_turns(
    surface: SurfaceQuery, mesh: Triangulation, borders: Sequence[Curve], first: float, stepover: float, report: Report
) -> list[Turn]:
    """Offset the borders inwards, turn after turn, until nothing is left.

    Args:
        surface: The region's surface.
        mesh: Its fine triangulation.
        borders: Closed curves to start from.
        first: Distance of the first turn from the border [m].
        stepover: Distance from turn to turn [m].
        report: Called with the share of the area done.

    Returns:
        The outermost turns; the others hang below them.
    """
    everything = np.ones(len(mesh.vertices), dtype=bool)
    roots = [Turn(curve, everything) for curve in borders]
    pieces = [Piece(tuple(roots), everything, np.zeros(len(mesh.vertices)))]
    step = first
    while pieces:
        pieces = [inner for piece in pieces for inner in _shrink(surface, mesh, piece, step)]
        step = stepover
        report(1.0 - sum(float(mesh.vertex_areas[p.inside].sum()) for p in pieces) / float(mesh.areas.sum()))
    return [turn for root in roots for turn in root.children]


def ring_margin(surface: SurfaceQuery, mesh: Triangulation, borders: Sequence[Curve], stepover: float) -> float | None:
    """Distance of the first turn from the outer border so that turns fill a ring evenly up to its inner border.

    Args:
        surface: The region's surface.
        mesh: Its fine triangulation.
        borders: Outer and inner border.
        stepover: Distance from turn to turn [m].

    Returns:
        The distance [m], at most 0.55 step-overs; None if the ring's width varies by more than half a step-over.
    """
    outer, inner = borders
    if np.ptp(outer.nearest(inner.positions).distances) > 2.0 * EVEN * stepover:
        return None
    turns = grow_turns(surface, mesh, [outer], 0.5 * stepover, stepover, lambda share: None)
    count = 0
    while len(turns) == 1:
        count, last, turns = count + 1, turns[0].curve, turns[0].children
    if turns or count == 0:
        return None
    gap = last.nearest(inner.positions).distances
    if np.ptp(gap) > EVEN * stepover or gap.max() > 2.0 * stepover:
        return None
    width = (count - 0.5) * stepover + float(gap.mean())
    needed = int(np.ceil(width / stepover - 0.1))
    return 0.5 * (width - (needed - 1) * stepover)


def _shrink(surface: SurfaceQuery, mesh: Triangulation, piece: Piece, step: float) -> list[Piece]:
    """One step inwards: the pieces left, each with its new turns, hung below the turns they come from."""
    curves = [turn.curve for turn in piece.turns]
    values = np.where(piece.inside, piece.at_least, 0.0)
    near = np.flatnonzero(piece.inside & (values < NEAR * step))
    found = distance_to(mesh, near, curves, FAR * step)
    values[near] = np.minimum(found, FAR * step)
    inner = values > step * (1.0 + ROUNDING)
    if not inner.any():
        return []
    lines = level_lines(mesh, np.minimum(values, NEAR * step), step)
    count, labels = mesh.components(inner) if len(lines) > 1 else (1, np.where(inner, 0, -1))
    # The next turns are one step away from these, so nothing comes nearer than that to them.
    at_least = np.maximum(values - step, 0.0)
    pieces = []
    for label in range(count):
        inside = labels == label
        if values[inside].max() <= THIN * step * (1.0 + ROUNDING):
            continue
        own = [line for line in lines if line.closed and labels[line.vertices[0]] == label]
        turns = tuple(_new_turn(surface, piece, curves, line, step, inside) for line in own)
        if turns:
            pieces.append(Piece(turns, inside, at_least))
    return pieces


def _new_turn(
    surface: SurfaceQuery, piece: Piece, curves: Sequence[Curve], line: LevelLine, step: float, inside: Mask
) -> Turn:
    curve = offset_curve(surface, curves, line, step)
    turn = Turn(curve, inside)
    parent = np.bincount(nearest_of(curves, curve.positions).curve).argmax()
    piece.turns[int(parent)].children.append(turn)
    return turn
