"""Connected Fermat spirals: one continuous stroke over a region with any number of holes (pattern; Region ->
runs).

Turns grow from all borders; a tree of neighbouring turns is cut into pockets, each an in-and-out double
spiral, and each pocket hangs in a gap of the turn beside it, so that the whole tree is one line (Zhao et al.
2016, Connected Fermat Spirals for Layered Fabrication; here on a curved surface and with the seam of each
pocket kept straight).

Seen from the seam the turns are parallel levels 0, 1, 2 ...; each is cut. Its left end at level k goes over
to the right end at level k + 2, so that two spirals run inwards one inside the other. The innermost two left
ends are joined by a U-turn: there the way in becomes the way out. The outermost two right ends are joined by
another U-turn where the pocket is joined to a turn of another one; otherwise the whole path begins and ends
there.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.planning.curve import Curve
from polish_sim.planning.patterns.fermat_pocket import Layout, Pocket, find_contacts, grow_tree, split_pockets
from polish_sim.planning.patterns.leftover import finish_middle
from polish_sim.planning.patterns.nested import all_turns, nested_turns
from polish_sim.planning.patterns.run import PatternRequest, Run, SurfaceRun, numbered
from polish_sim.planning.quality.crossings import find_crossings
from polish_sim.planning.toolpath import arc_length

#: Width of a U-turn beside a line that crosses, and its distance from that line, in levels
TIP, CLEAR = 0.4, 0.45
FREE = 0.4  #: Levels a crossing line has sunk where the path begins or ends beside it
TIPS_APART = 0.4  #: Distance of two U-turns' tips that face each other, in step-overs
LINE_POINTS, TURN_POINTS = 64, 24


class End(NamedTuple):
    """One end of a turn at a cut."""

    turn: int
    s: float  #: Arc length on the turn [m]
    onwards: bool  #: Whether the turn continues from here with growing arc length, not against it


class JoinedEnds(NamedTuple):
    """Two ends joined."""

    first: End
    second: End
    line: Array  #: Points between them, from the first to the second [m], shape (n, 3)


class Levels(NamedTuple):
    """The turns of a pocket seen from its seam."""

    curves: tuple[Curve, ...]
    turns: tuple[int, ...]
    s: tuple[float, ...]  #: Arc length at the middle of the seam [m]
    signs: tuple[float, ...]  #: 1, or -1 where a turn's arc length grows to the left
    bands: tuple[float, ...]  #: Length of the seam on each turn [m]

    def at(self, level: int, x: Array | float) -> Array:
        """Points of a turn at distances to the right of the seam's middle [m], shape (n, 3)."""
        return self.curves[level].points(self.s[level] + self.signs[level] * np.atleast_1d(x))

    def end(self, level: int, x: float, right: bool) -> End:
        """The end of a turn on one side of its cut."""
        return End(
            self.turns[level], self.s[level] + self.signs[level] * x, right == (self.signs[level] > 0.0)
        )


def build_seam(
    curves: Sequence[Curve], pocket: Pocket, stepover: float
) -> tuple[list[JoinedEnds], Sequence[End]]:
    """Join the turns of a pocket to a double spiral: the links, and the ends left free, where the whole path
    begins and ends: two, or none."""
    levels = _levels(curves, pocket, stepover)
    last = len(levels.turns) - 1
    if last == 0:
        half = 0.5 * TIPS_APART * stepover
        return [], (levels.end(0, half, True), levels.end(0, -half, False))
    links = [_crossing(levels, level) for level in range(last - 1)]
    bow = _round(levels, stepover) if last == 1 else _hook(levels.bands[last], stepover)
    links.append(_u_turn(levels, last, last - 1, bow))
    if pocket.parent < 0:
        # The path begins and ends beside the line that crosses the outermost level inwards.
        places = 2 * [TIPS_APART * stepover]
        if last > 1:
            places = [(0.5 * (FREE + level) - 0.5) * levels.bands[level] for level in (0, 1)]
        return links, [levels.end(level, x, True) for level, x in enumerate(places)]
    bow = bow if last == 1 else _hook(levels.bands[0], stepover)
    links.append(_u_turn(levels, 0, 1, bow))
    return links, ()


def _levels(curves: Sequence[Curve], pocket: Pocket, stepover: float) -> Levels:
    """The turns in order, each with the side of its seam on which its arc length grows."""
    row = tuple(curves[turn] for turn in pocket.turns)
    signs = [1.0]
    headings = [
        curve.tangents(np.array([s]), 0.25 * stepover)[0] for curve, s in zip(row, pocket.s, strict=True)
    ]
    for before, here in pairwise(headings):
        signs.append(signs[-1] if before @ here > 0.0 else -signs[-1])
    return Levels(row, pocket.turns, pocket.s, tuple(signs), pocket.bands)


def _crossing(levels: Levels, level: int) -> JoinedEnds:
    """From the left end at a level straight down to the right end two levels further in."""
    u = np.linspace(0.0, 1.0, LINE_POINTS)
    outer, middle, inner = (levels.at(level + k, (u - 0.5) * levels.bands[level + k]) for k in range(3))
    depth = (2.0 * u)[:, None]
    line = 0.5 * (depth - 1.0) * (depth - 2.0) * outer + depth * (2.0 - depth) * middle
    line += 0.5 * depth * (depth - 1.0) * inner
    left = levels.end(level, -0.5 * levels.bands[level], False)
    return JoinedEnds(left, levels.end(level + 2, 0.5 * levels.bands[level + 2], True), line[1:-1])


class _Bow(NamedTuple):
    """A U-turn from one level, straight on to its tip and back to the next."""

    u: Array  #: Places along the seam, 0 at its left and 1 at its right end, shape (n,)
    depth: Array  #: From 0 at the level it begins on to 1 at the next, shape (n,)


def _round(levels: Levels, stepover: float) -> _Bow:
    """Half a circle between two levels that no line crosses."""
    band = levels.bands[0]
    reach = 0.5 * float(np.linalg.norm(levels.at(0, 0.0) - levels.at(1, 0.0))) / band
    tip = 0.5 + min(0.5 * TIPS_APART * stepover / band, 0.2)
    return _bow(tip, 1.0, reach, tip + reach)


def _hook(band: float, stepover: float) -> _Bow:
    """Beside a line that crosses from (0, 0) to (1, 2): narrow at its tip, so that it reaches far into the
    wedge."""
    return _bow(0.5 * (TIP + CLEAR), TIP, 0.5 * TIP * stepover / band, 0.5 * (1.0 + CLEAR))


def _bow(tip: float, width: float, reach: float, begin: float) -> _Bow:
    """Half an ellipse of a width [levels] around a tip, then straight to where the next level begins."""
    angle = np.linspace(0.0, np.pi, TURN_POINTS)
    u, depth = tip + reach * (1.0 - np.sin(angle)), 0.5 * width * (1.0 - np.cos(angle))
    on = depth < 1.0
    return _Bow(np.append(u[on], begin), np.append(depth[on], 1.0))


def _u_turn(levels: Levels, straight: int, bent: int, bow: _Bow) -> JoinedEnds:
    """A U-turn between two levels; on the left of the seam's middle it is turned by half a turn."""
    right = straight < bent
    u = bow.u if right else 1.0 - bow.u
    first, second = ((u - 0.5) * levels.bands[level] for level in (straight, bent))
    depth = bow.depth[:, None]
    line = (1.0 - depth) * levels.at(straight, first) + depth * levels.at(bent, second)
    ends = levels.end(straight, first[0], right), levels.end(bent, second[-1], right)
    return JoinedEnds(*ends, line[1:-1])


TRIES = 4  #: How often loops beside crossings are left out before the path is taken as it is
WORTH_A_STROKE = 5.0  #: Shortest place the tool is lifted for [step-overs]
CROWDED = 1.0  #: A loop is beside a crossing if it passes it within this many step-overs


def fermat_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with one connected Fermat spiral.

    More runs only where a part of the region lies apart from all turns of the rest.
    """
    nested = nested_turns(request)
    turns = list(all_turns(nested.roots))
    if not turns:
        return []
    loops = set(map(id, nested.loops))
    for _ in range(TRIES):
        lines = connect([turn.curve for turn in turns], request.stepover, request.plan.start)
        runs = request.finished(lines)
        where = find_crossings([run.curve for run in runs]).places
        if len(where) == 0:
            break
        # Only loops that close gaps may be left out: those beside a crossing.
        turns = [
            turn
            for turn in turns
            if id(turn) not in loops
            or np.isinf(turn.curve.nearest(where, CROWDED * request.stepover).distances).all()
        ]
    return runs + _strokes_between(request, lines, runs)


def _strokes_between(
    request: PatternRequest, lines: Sequence[Run], runs: Sequence[SurfaceRun]
) -> list[SurfaceRun]:
    """Strokes of their own through long places left between turns of different borders, where they cross
    nothing."""
    longer, added = finish_middle(request.mesh, lines, request.stepover), list[SurfaceRun]()
    for k, line in enumerate(longer):
        fresh = line.positions[len(lines[k].positions) if k < len(lines) else 0 :]
        if len(fresh) < 2 or arc_length(fresh)[-1] < WORTH_A_STROKE * request.stepover:
            continue
        (stroke,) = request.finished([Run(fresh, np.zeros(len(fresh), dtype=np.int64))])
        if not len(find_crossings([run.curve for run in (*runs, *added, stroke)]).places):
            added.append(stroke)
    return added


def connect(curves: Sequence[Curve], stepover: float, start: Sequence[float] = ()) -> list[Run]:
    """Join closed turns, an outermost one first and a step-over [m] apart, to as few open lines as may be.

    They begin near ``start`` [m]; empty = anywhere.
    """
    contacts = find_contacts(curves, stepover)
    layout = Layout(curves, stepover, np.array(start, dtype=float))
    waiting = sorted(range(len(curves)), key=lambda turn: -curves[turn].length)
    runs = []
    while waiting:
        tree = grow_tree(curves, contacts, waiting[0])
        waiting = [turn for turn in waiting if turn not in tree.reached]
        seams = [build_seam(curves, pocket, stepover) for pocket in split_pockets(layout, tree)]
        links = [link for joined, _ in seams for link in joined]
        runs += [_walk(curves, links, *free) for _, free in seams if free]
    return runs


def _walk(curves: Sequence[Curve], links: Sequence[JoinedEnds], begin: End, end: End) -> Run:
    """Follow turns and links from one free end to the other."""
    partner: dict[End, tuple[End, Array]] = {}
    ends: dict[int, list[End]] = {}
    for link in links:
        partner[link.first] = (link.second, link.line)
        partner[link.second] = (link.first, link.line[::-1])
    for here in (*partner, begin, end):
        ends.setdefault(here.turn, []).append(here)
    parts, here = [], begin
    # No end is passed twice, so that the walk ends for any links.
    passed: set[End] = set()
    while here not in passed:
        there, points = _along(curves[here.turn], here, ends[here.turn])
        parts.append(points)
        passed |= {here, there}
        if there not in partner:
            break
        here, line = partner[there]
        parts[-1] = np.concatenate([points, line])
    return numbered(parts)


def _along(curve: Curve, here: End, ends: Sequence[End]) -> tuple[End, Array]:
    """From an end along its turn to the next end that faces it, and the points on the way."""
    sign = 1.0 if here.onwards else -1.0
    facing = [end for end in ends if end.onwards != here.onwards]
    ways = [np.mod(sign * (end.s - here.s), curve.length) for end in facing]
    nearest = np.argmin(ways)
    return facing[nearest], curve.along(here.s, sign * ways[nearest])
