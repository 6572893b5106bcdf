"""The turns that cover a region, from its border inwards, and how they nest (Region -> tree of offset
curves)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, dots, in_groups
from polish_sim.geometry import Surface
from polish_sim.planning.curve import Curve, CurveSet
from polish_sim.planning.ground import Triangulation
from polish_sim.planning.offset_curve import ROUNDING, LevelLine, level_lines, offset_curve

# What is left of a region and how far it lies from the turns so far (Triangulation -> Front).
#
# A vertex is looked at only when the turns come near it: until then a lower bound of its distance is kept,
# which falls by a step with each turn. So all turns together cost little more than a few looks per vertex.

#: Vertices less than this many step-overs beyond the next turn are looked at; edges are a third of one long
BEYOND = 0.6
FAR = 6.0  #: Distance assumed for vertices that only see turns on the other side of the part [step-overs]


class Front(NamedTuple):
    """Distances of the vertices not covered yet, from turn to turn."""

    mesh: Triangulation
    stepover: float  #: [m]
    #: Distances to the last turns [m], exact near them, less than they are elsewhere; 0 where covered, (n,)
    values: Array

    def triangles_around(self, rows: Indices) -> Indices:
        """Triangles with a corner among vertices, each once."""
        starts, members = self.mesh.around
        row, place = in_groups(starts[rows + 1] - starts[rows])
        found = np.zeros(len(self.mesh.triangles), dtype=bool)
        found[members[starts[rows][row] + place]] = True
        return np.flatnonzero(found)  # in their own order, on which it depends where closed lines begin


#: What is left inside a turn needs another one if its middle is further away than this many step-overs
THIN = 1.1
EVEN = 0.5  #: A ring's width may vary by this many step-overs for turns to run from border to border
#: Turns of a ring may be further apart by this share of the step-over for one less of them to do
STRETCH = 0.03
Report = Callable[[float], None]  #: Called with the share of the work done, 0 to 1


@dataclass(eq=False)
class Turn:
    """One offset curve and the turns directly inside it."""

    curve: Curve
    inside: Indices = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    """Vertices of the triangulation in the piece it bounds, if no turn lies inside it, shape (k,)."""
    children: list[Turn] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class OpenPiece:
    """A connected part of the region not yet covered, and the turns around it."""

    turns: tuple[Turn, ...]
    rows: Indices  #: Its vertices, shape (k,)


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


def distance_to(mesh: Triangulation, rows: Indices, curves: Sequence[Curve], limit: float) -> Array:
    """Distance (k,) [m] of vertices ``rows`` to the nearest curve on the same side of the part, at most the
    limit."""
    feet = CurveSet(curves).nearest(mesh.vertices[rows], limit)
    same_side = dots(feet.normals, mesh.normals[rows]) > 0.0
    return np.where(same_side, np.minimum(feet.distances, limit), limit)


def grow_turns(
    surface: Surface,
    mesh: Triangulation,
    borders: Sequence[Curve],
    stepover: float,
    report: Report,
) -> list[Turn]:
    """Offset the borders inwards, turn after turn, until nothing is left; the outermost turns, the others
    below them.

    They run a step-over [m] apart, the first half of one from the border; ``report`` is called with the share
    of the area done.
    """
    roots = [Turn(curve) for curve in borders]
    front = Front(mesh, stepover, np.zeros(len(mesh.vertices)))
    pieces = [OpenPiece(tuple(roots), np.arange(len(mesh.vertices)))]
    step = 0.5 * stepover
    area = total = mesh.areas.sum()
    while pieces:
        inner, covered = zip(*[_shrink(surface, front, piece, step) for piece in pieces], strict=True)
        pieces = [new for found in inner for new in found]
        step = stepover
        area -= sum(mesh.vertex_areas[rows].sum() for rows in covered)
        report(1.0 - (area if pieces else 0.0) / total)
    return [turn for root in roots for turn in root.children]


def ring_turns(
    surface: Surface, mesh: Triangulation, borders: Sequence[Curve], stepover: float
) -> float | None:
    """How far turns are apart that fill a ring of even width from its outer to its inner border, half as far
    inside both [m].

    For a whole number of turns to fit that is a little more than a step-over, or less. None if the ring's
    width varies by more than half a step-over.
    """
    outer, inner = borders
    if np.ptp(outer.nearest(inner.positions).distances) > EVEN * stepover:
        return None
    turns = grow_turns(surface, mesh, [outer], stepover, lambda share: None)
    count = 0
    while len(turns) == 1:
        count, last, turns = count + 1, turns[0].curve, turns[0].children
    if turns or count == 0:
        return None
    width = (count - 0.5) * stepover + last.nearest(inner.positions).distances.mean()
    return width / np.ceil(width / ((1.0 + STRETCH) * stepover))


def _shrink(surface: Surface, front: Front, piece: OpenPiece, step: float) -> tuple[list[OpenPiece], Indices]:
    """One step inwards [m]: the pieces left, their new turns hung below those they come from; and the
    vertices covered."""
    rows, values = piece.rows, front.values
    near = rows[values[rows] < step + BEYOND * front.stepover]
    around = [turn.curve for turn in piece.turns]
    values[near] = distance_to(front.mesh, near, around, FAR * front.stepover)
    lines = level_lines(front.mesh, values, step, front.triangles_around(near))
    reached = values[rows] <= step * (1.0 + ROUNDING)
    covered, left = rows[reached], rows[~reached]
    values[covered] = 0.0
    pieces = []
    for own, rest in _parts(front, lines, left):
        if values[rest].max(initial=0.0) <= THIN * step * (1.0 + ROUNDING):
            continue
        turns = tuple(_new_turn(surface, front.mesh, piece, line, step) for line in own if line.closed)
        if turns:
            pieces.append(OpenPiece(turns, rest))
    for turn in piece.turns:
        if not turn.children:
            turn.inside = piece.rows
    values[left] -= step
    return pieces, covered


def _parts(
    front: Front, lines: Sequence[LevelLine], left: Indices
) -> Iterator[tuple[Sequence[LevelLine], Indices]]:
    """What is left of a piece part by part: the lines around each, and its vertices."""
    if len(lines) <= 1:
        yield lines, left
        return
    inner = np.zeros(len(front.values), dtype=bool)
    inner[left] = True
    count, labels = front.mesh.components(inner)
    for label in range(count):
        own = [line for line in lines if labels[line.vertices[0]] == label]
        if own:
            yield own, left[labels[left] == label]


def _new_turn(surface: Surface, mesh: Triangulation, piece: OpenPiece, line: LevelLine, step: float) -> Turn:
    curves = [turn.curve for turn in piece.turns]
    turn = Turn(offset_curve(surface, curves, line, step))
    nearest = CurveSet(curves).nearest(mesh.vertices[line.vertices]).curve
    piece.turns[np.bincount(nearest).argmax()].children.append(turn)
    return turn
