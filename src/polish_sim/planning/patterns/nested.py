"""All closed turns that cover a region, small loops in its middle included (request -> nested turns)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array
from polish_sim.geometry.surface import enclosed
from polish_sim.planning.curve import Curve, CurveSet
from polish_sim.planning.ground import Triangulation
from polish_sim.planning.offset_curve import LevelLine, level_lines
from polish_sim.planning.patterns.run import PatternRequest
from polish_sim.planning.quality.coverage import STRICT
from polish_sim.planning.turns import (
    Turn,
    border_curves,
    distance_to,
    grow_turns,
    ring_turns,
)

WORTH_A_LOOP = 0.15  #: Smallest uncovered area that gets a loop, in squared step-overs
EDGE, DEEP_EDGE = 0.53, 0.68
"""Such a place begins this many step-overs from the turns, just more than the middle between two of them;
where it is deep the loop lies further in, so that it also covers the middle, but no further than the
second."""
INNER = 0.5  #: A loop leaves no more than this many step-overs to the middle of its place
PASSES = 2  #: Searches for places: what the first loops leave may be a place of its own
#: Distance its loop keeps outside it [step-overs]: it must not run back on itself where it is thin
WIDER = 0.12
TAIL = 0.3  #: Where a turn runs back along itself nearer than this many step-overs, a loop replaces its tail
SLIVER = 0.1  #: A turn is a sliver if its mean width, area by length, is below this [step-overs]
SHORTEST = 1.0  #: A loop is no shorter than this many step-overs
FURTHEST = 3.0  #: Distances are measured up to this many step-overs


class Nested(NamedTuple):
    """Turns that cover a region."""

    roots: list[Turn]  #: The outermost turns; the others hang below them
    loops: list[Turn]  #: Those of them that only close gaps in the middle


def nested_turns(request: PatternRequest) -> Nested:
    """Turns from all borders inwards; on a ring of even width from the outer border to the inner one.

    What the turns leave uncovered in the middle gets a loop of its own, closer to them than a step-over.
    """
    return with_loops(request, grown_turns(request).roots)


def with_loops(request: PatternRequest, roots: list[Turn], shallowest: float = 0.0) -> Nested:
    """Turns without slivers, unless all are, and loops in the gaps whose middle is at least that many
    step-overs away."""
    kept = _without_slivers(roots, request.stepover) or roots
    loops: list[Turn] = []
    for _ in range(PASSES):
        loops += _close_gaps(request.mesh, list(all_turns(kept)), request.stepover, shallowest)
    return Nested(kept, loops)


class Grown(NamedTuple):
    """Turns from the borders inwards."""

    roots: list[Turn]  #: The outermost turns; the others hang below them
    pitch: float  #: Distance from turn to turn, on rings a little more or less than the step-over [m]
    to_border: bool  #: Whether the innermost turn follows a border too, as on a ring of even width


def grown_turns(request: PatternRequest) -> Grown:
    """Turns from all borders inwards, their tails cut off; on a ring of even width from the outer border
    only."""
    surface, mesh, stepover = request.region.surface, request.mesh, request.stepover
    borders = border_curves(mesh)
    ring = ring_turns(surface, mesh, borders, stepover) if len(borders) == 2 else None
    pitch = ring or stepover
    roots = grow_turns(surface, mesh, borders[:1] if ring else borders, pitch, request.report)
    for turn in all_turns(roots):
        cut = without_tails(turn.curve, TAIL * stepover)
        # Of a strip the whole turn runs back along itself.
        if enclosed(cut.positions) > 0.5 * enclosed(turn.curve.positions):
            turn.curve = cut
    return Grown(roots, pitch, ring is not None)


def all_turns(roots: Sequence[Turn]) -> Iterator[Turn]:
    """Every turn, each before those inside it."""
    waiting = list(reversed(roots))
    while waiting:
        turn = waiting.pop()
        yield turn
        waiting.extend(reversed(turn.children))


def chains(roots: Sequence[Turn], stepover: float) -> list[list[Turn]]:
    """Split nested turns into chains that can be walked without a lift, the longest way inwards first."""

    def shortness(turn: Turn) -> float:
        """Rounded, so that turns of one length keep their order."""
        return -round(turn.curve.length / stepover, 4)

    waiting = sorted(roots, key=shortness)
    out = []
    while waiting:
        chain = [waiting.pop(0)]
        while chain[-1].children:
            inner = sorted(chain[-1].children, key=shortness)
            waiting.extend(inner[1:])
            chain.append(inner[0])
        out.append(chain)
    return out


CANDIDATES = 96  #: Lines across the turns that are tried
#: Step-overs along a turn from the start asked for within which a path may begin, to avoid corners
NEAR_START = 4


def lines_across(
    turns: Sequence[Curve],
    count: int,
    start: Array,
    stepover: float,
    slant: Callable[[Curve, Curve], float] = lambda inner, outer: 0.0,
) -> Array:
    """Lines across nested turns, outermost first, nearest point to nearest point; arc lengths (k, n) [m].

    They begin at ``count`` places all round the innermost turn, from where they never run into corners, and
    at places of the outermost one near ``start`` (1, 3) [m], if there is one. ``slant`` is how much further
    along the ``outer`` turn they pass each time [m].
    """
    lines = [np.linspace(0.0, turns[-1].length, count, endpoint=False)]
    for inner, outer in pairwise(reversed(turns)):
        lines.append(outer.wrap(outer.nearest(inner.points(lines[-1])).s + slant(inner, outer)))
    lines.reverse()
    if not len(start):
        return np.array(lines)
    near = stepover * np.linspace(-NEAR_START, NEAR_START, 4 * NEAR_START + 1)
    more = [turns[0].wrap(turns[0].nearest(start).s + near)]
    for outer, inner in pairwise(turns):
        more.append(inner.nearest(outer.points(more[-1] - slant(inner, outer))).s)
    return np.concatenate([lines, more], axis=1)


def without_tails(curve: Curve, width: float) -> Curve:
    """A closed curve without the parts that run out and back along themselves, both sides nearer than
    ``width`` [m]."""
    while len(curve.positions) > 8:
        pairs = cKDTree(curve.positions).query_pairs(width, output_type="ndarray")
        along = np.abs(np.diff(curve.knots[pairs], axis=1)[:, 0])
        length = np.minimum(along, curve.length - along)
        tails = np.flatnonzero(length > 4.0 * width)
        for k in tails[np.argsort(-length[tails], kind="stable")]:
            first, last = np.sort(pairs[k])
            inner = np.arange(first, last + 1)
            if along[k] > 0.5 * curve.length:
                inner = np.concatenate([np.arange(last, len(curve.positions)), np.arange(first + 1)])
            if enclosed(curve.positions[inner]) < 0.5 * width * length[k]:
                kept = np.ones(len(curve.positions), dtype=bool)
                kept[inner[1:-1]] = False
                curve = Curve(curve.positions[kept], curve.normals[kept], True)
                break
        else:
            return curve
    return curve


def _without_slivers(roots: Sequence[Turn], stepover: float) -> list[Turn]:
    """The turns without those too thin to go round; gaps they leave are closed like any other."""

    def kept(turns: Sequence[Turn]) -> list[Turn]:
        return [
            t for t in turns if t.children or enclosed(t.curve.positions) > SLIVER * stepover * t.curve.length
        ]

    for turn in reversed(list(all_turns(roots))):
        turn.children = kept(turn.children)
    return kept(roots)


def _close_gaps(mesh: Triangulation, turns: Sequence[Turn], stepover: float, shallowest: float) -> list[Turn]:
    """Hang a loop round every uncovered place below the turn it lies nearest to; returns the loops."""
    if not turns:
        return []
    curves = [turn.curve for turn in turns]
    everything = np.arange(len(mesh.vertices))
    distance = distance_to(mesh, everything, curves, FURTHEST * stepover)
    count, labels = mesh.components(distance > EDGE * stepover)
    loops = []
    for label in range(count):
        place = labels == label
        open_area = mesh.vertex_areas[place & (distance > STRICT * stepover)].sum()
        deepest = distance[place].max()
        if (
            open_area < WORTH_A_LOOP * stepover**2
            or place[mesh.border].any()
            or deepest < shallowest * stepover
        ):
            continue
        edge = np.clip(deepest - (INNER - WIDER) * stepover, EDGE * stepover, DEEP_EDGE * stepover)
        for line in level_lines(mesh, np.where(place, distance, 0.0), edge):
            curve = _loop(line, stepover) if line.closed else None
            if curve is not None and curve.length > SHORTEST * stepover:
                nearest = np.bincount(CurveSet(curves).nearest(curve.positions).curve).argmax()
                loops.append(Turn(curve, np.flatnonzero(place)))
                turns[int(nearest)].children.append(loops[-1])
    return loops


def _loop(line: LevelLine, stepover: float) -> Curve:
    """A level line, a little wider, as a curve with evenly spaced points."""
    rough = line.curve
    outwards = np.cross(rough.tangents(rough.knots[:-1], 0.2 * stepover), rough.normals)
    rough = Curve(rough.positions + WIDER * stepover * outwards, rough.normals, True)
    s = np.linspace(0.0, rough.length, max(int(np.ceil(8.0 * rough.length / stepover)), 12), endpoint=False)
    positions, normals = rough.at(s)
    return Curve(positions, normals, True)
