"""Which piece of a line follows which in a zig-zag, and the rounded ways between them (pieces -> strokes)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, unit
from polish_sim.planning.curve import Curve, CurveSet
from polish_sim.planning.toolpath import arc_length, interpolate

ENDS = 1.05  #: Distance of the lines' ends from the border, in step-overs
LINK = 8.0  #: Longest way along the border from line to line, in step-overs
CLEAR = 0.3  #: Step-overs from lines to the middle of such a way; one that bends round a border may be in it
RADIUS = 0.5  #: Radius of a U-turn between neighbouring lines, in step-overs


class LinePiece(NamedTuple):
    """A piece of a line away from the border."""

    line: int  #: Number of the line, counted across the region
    positions: Array  #: Points [m], shape (n, 3)


class ZigZag(NamedTuple):
    """Pieces walked one after the other."""

    positions: Array  #: Points [m], shape (n, 3)
    passing: Array  #: Middles of the ways between the pieces [m], shape (k, 3)


@dataclass(frozen=True, eq=False)
class _Ends:
    """Ends of the pieces on the curves along the border: piece k begins at end 2 k and stops at end 2 k +
    1."""

    curves: Sequence[Curve]
    curve: Indices  #: Which curve each end lies on, shape (n,)
    s: Array  #: Arc length there [m], shape (n,)
    tree: cKDTree  #: Search tree over the points of all pieces

    def beside(self, end: int) -> list[tuple[int, Array]]:
        """The next end either way round, and the points of the way there."""
        mates = np.flatnonzero(self.curve == self.curve[end])
        mates, curve = mates[mates != end], self.curves[self.curve[end]]
        if len(mates) == 0:
            return []
        found = []
        for sign in (1.0, -1.0):
            ways = np.mod(sign * (self.s[mates] - self.s[end]), curve.length)
            way = curve.along(self.s[end], sign * ways.min())
            found.append((mates[ways.argmin()], way))
        return found


def walk(
    pieces: Sequence[LinePiece], curves: Sequence[Curve], stepover: float, start: Sequence[float]
) -> list[ZigZag]:
    """Walk the pieces of lines, by the number of their line, turning round along the border curves on which
    they end.

    The walk begins near ``start`` (3,) [m]; empty = at the first line. Each stroke ends where no piece of a
    neighbouring line begins nearby.
    """
    if not pieces:
        return []
    tips = np.concatenate([piece.positions[[0, -1]] for piece in pieces])
    feet = CurveSet(curves).nearest(tips)
    ends = _Ends(curves, feet.curve, feet.s, cKDTree(np.concatenate([piece.positions for piece in pieces])))
    waiting = set(range(len(pieces)))
    begin, heading = _first_end(pieces, tips, start)
    strokes = []
    while waiting:
        strokes.append(_stroke(pieces, ends, waiting, begin, heading, stepover))
        if waiting:
            lowest = min(waiting, key=lambda k: (heading * pieces[k].line, k))
            begin = min(
                (2 * lowest, 2 * lowest + 1),
                key=lambda end: len(_onwards(pieces, ends, waiting, end, stepover)),
            )
    return strokes


def _first_end(pieces: Sequence[LinePiece], tips: Array, start: Sequence[float]) -> tuple[int, int]:
    """End to begin at, and whether lines are walked up or down."""
    low, high = min(piece.line for piece in pieces), max(piece.line for piece in pieces)
    if not len(start):
        return 0, 1
    outer = [end for end in range(len(tips)) if pieces[end // 2].line in (low, high)]
    begin = min(outer, key=lambda end: np.linalg.norm(tips[end] - np.array(start)))
    return begin, 1 if pieces[begin // 2].line == low else -1


def _onwards(
    pieces: Sequence[LinePiece], ends: _Ends, waiting: set[int], end: int, stepover: float
) -> list[tuple[int, Array]]:
    """Ends of waiting pieces of the same or a neighbouring line that may follow, and the ways there."""
    line = pieces[end // 2].line
    return [
        (other, way)
        for other, way in ends.beside(end)
        if other // 2 in waiting
        and other // 2 != end // 2
        and abs(pieces[other // 2].line - line) <= 1
        and arc_length(way)[-1] < LINK * stepover
        and ends.tree.query(way[len(way) // 2])[0] > CLEAR * stepover
    ]


def _stroke(
    pieces: Sequence[LinePiece], ends: _Ends, waiting: set[int], begin: int, heading: int, stepover: float
) -> ZigZag:
    """Walk on from an end as far as there is a way."""
    rows, ways = [begin], []
    waiting.discard(begin // 2)
    while True:
        options = _onwards(pieces, ends, waiting, rows[-1] ^ 1, stepover)
        if not options:
            break
        line = pieces[rows[-1] // 2].line
        other, way = max(options, key=lambda option: heading * (pieces[option[0] // 2].line - line))
        heading = pieces[other // 2].line - line or heading
        waiting.discard(other // 2)
        rows.append(other)
        ways.append(way)
    lines = [pieces[end // 2].positions[:: -1 if end % 2 else 1] for end in rows]
    parts = [lines[0]]
    for way, line_points in zip(ways, lines[1:], strict=True):
        parts[-1], turn, rest = _rounded(parts[-1], way, line_points, RADIUS * stepover)
        parts += [turn, rest]
    middles = [way[len(way) // 2] for way in ways]
    return ZigZag(np.concatenate(parts), np.array(middles).reshape(-1, 3))


def _rounded(before: Array, way: Array, after: Array, radius: float) -> tuple[Array, Array, Array]:
    """Round both corners of a way from line to line; what is left of the line before, the way, and the line
    after."""
    length = arc_length(way)[-1]
    arm = min(radius, 0.5 * length, 0.45 * arc_length(before)[-1], 0.45 * arc_length(after)[-1])
    before, after = _without_end(before, arm), _without_end(after[::-1], arm)[::-1]
    middle = _without_end(_without_end(way, arm)[::-1], arm)[::-1]
    turn = np.concatenate(
        [fillet(before[-1], way[0], middle[0]), middle, fillet(middle[-1], way[-1], after[0])]
    )
    return before, turn, after


def _without_end(line: Array, length: float) -> Array:
    """A line without its last stretch."""
    s = arc_length(line)
    end = max(s[-1] - length, 0.0)
    kept = line[s < end - 1e-12]
    return np.concatenate([kept, interpolate(np.array([end]), s, line)])


def fillet(start: Array, corner: Array, end: Array) -> Array:
    """Points of the arc that rounds a corner between two points as far from it, without its ends (n, 3)."""
    arms = unit(np.stack([start, end]) - corner)
    weight = np.sqrt(max(0.5 * (1.0 - (arms[0] @ arms[1])), 1e-6))
    t = np.linspace(0.0, 1.0, 18)[1:-1, None]
    a, b, c = (1.0 - t) ** 2, 2.0 * weight * t * (1.0 - t), t**2
    return (a * start + b * corner + c * end) / (a + b + c)
