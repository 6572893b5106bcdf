"""Connected Fermat spirals: one continuous stroke over a region with any number of holes (pattern; Region -> runs).

Turns grow from all borders; a tree of neighbouring turns is cut into pockets, each an in-and-out double spiral, and
each pocket hangs in a gap of the turn beside it, so that the whole tree is one line (Zhao et al. 2016, Connected
Fermat Spirals for Layered Fabrication; here on a curved surface and with the seam of each pocket kept straight).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polish_sim.arrays import Array
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.patterns.fermat_pocket import Layout, find_contacts, grow_tree, split_pockets
from polish_sim.planning.patterns.fermat_seam import End, Link, build_seam
from polish_sim.planning.patterns.nested import all_turns, nested_turns
from polish_sim.planning.patterns.run import PatternRequest, Run, SurfaceRun, finish_run
from polish_sim.planning.quality.crossings import find_crossings

TRIES = 4
"""How often loops beside crossings are left out before the path is taken as it is."""
CROWDED = 1.0
"""A loop is beside a crossing if it passes it within this many step-overs."""


def fermat_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with one connected Fermat spiral.

    Args:
        request: What to cover and how.

    Returns:
        One run; more only where a part of the region lies apart from all turns of the rest.
    """
    surface, stepover = request.region.surface, request.stepover
    nested = nested_turns(request)
    turns = list(all_turns(nested.roots))
    if not turns:
        return []
    loops = set(map(id, nested.loops))
    for _ in range(TRIES):
        lines = connect([turn.curve for turn in turns], stepover, request.plan.start)
        runs = [finish_run(surface, line, stepover) for line in lines]
        where = find_crossings([Curve(run.positions, run.points.normals, False) for run in runs]).places
        if len(where) == 0:
            break
        # Only loops that close gaps may be left out: those beside a crossing.
        crowded = {id(turn) for turn in turns if id(turn) in loops and _is_near(turn.curve, where, CROWDED * stepover)}
        if not crowded:
            break
        turns = [turn for turn in turns if id(turn) not in crowded]
    return runs


def _is_near(curve: Curve, points: Array, distance: float) -> bool:
    return bool(np.isfinite(curve.nearest(points, distance).distances).any())


def connect(curves: Sequence[Curve], stepover: float, start: Sequence[float] = ()) -> list[Run]:
    """Join closed turns to as few lines as may be.

    Args:
        curves: The turns, an outermost one first.
        stepover: Distance between neighbours [m].
        start: Where to begin, about [m]; empty = anywhere.

    Returns:
        Open lines.
    """
    contacts = find_contacts(curves, stepover)
    layout = Layout(curves, stepover, np.array(start, dtype=float))
    waiting = sorted(range(len(curves)), key=lambda turn: -curves[turn].length)
    runs = []
    while waiting:
        tree = grow_tree(curves, contacts, waiting[0])
        waiting = [turn for turn in waiting if turn not in tree.reached]
        seams = [build_seam(curves, pocket, stepover) for pocket in split_pockets(layout, tree)]
        links = [link for seam in seams for link in seam.links]
        runs += [_walk(curves, links, *seam.free) for seam in seams if seam.free]
    return runs


def _walk(curves: Sequence[Curve], links: Sequence[Link], begin: End, end: End) -> Run:
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
    index = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return Run(np.concatenate(parts), index)


def _along(curve: Curve, here: End, ends: Sequence[End]) -> tuple[End, Array]:
    """From an end along its turn to the next end that faces it, and the points on the way."""
    sign = 1.0 if here.onwards else -1.0
    facing = [end for end in ends if end.onwards != here.onwards]
    ways = [float(np.mod(sign * (end.s - here.s), curve.length)) for end in facing]
    nearest = int(np.argmin(ways))
    if here.onwards:
        points = curve.between(here.s, here.s + ways[nearest])[0]
    else:
        points = curve.between(here.s - ways[nearest], here.s)[0][::-1]
    return facing[nearest], points
