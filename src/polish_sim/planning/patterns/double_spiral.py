"""Spirals around holes: in and out again in one stroke, evenly spaced (nested turns -> runs).

A spiral ends in the middle of what it covers. Where holes divide a region there are several such middles, and
a stroke can begin in one and end in another; to pass through a third it has to wind out again beside its way
in. So the turns are joined as in a connected Fermat spiral.

Where turns of different borders meet, the gap between them is any share of a step-over. It is spread over the
strands
around: each point moves towards the wider of the gaps on its two sides, and towards what is not covered.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, dots, norms, unit
from polish_sim.geometry import Surface
from polish_sim.planning.curve import Curve
from polish_sim.planning.ground import Triangulation
from polish_sim.planning.patterns.fermat import connect
from polish_sim.planning.patterns.leftover import finish_middle
from polish_sim.planning.patterns.nested import all_turns, with_loops
from polish_sim.planning.patterns.run import PatternRequest, Run, averaged_twice, dense
from polish_sim.planning.quality.located import RunSamples, Strands
from polish_sim.planning.quality.spacing import along, neighbours_beside
from polish_sim.planning.toolpath import arc_length
from polish_sim.planning.turns import Turn, border_curves

#: A place whose middle is this far from the turns [step-overs] gets a loop; others are closed evenly
SHALLOWEST = 1.0
ROUNDS, AFTERWARDS = 40, 20  #: Rounds of moving strands, and once more after the last places have got strokes
MOST_STROKES = 2  #: Places that no strand can be moved to, for which the tool is lifted, at most
SPACING = 1.0 / 8.0  #: Spacing of the points that move, in step-overs
WINDOW = 5  #: Points over which moves are averaged, twice
AT_BORDER = 0.52  #: Strands this near the border follow it, in step-overs: they stay
WIDEST = 1.1  #: Largest value a gap counts as [step-overs]: corners of neighbouring turns lie further apart
ALONGSIDE = 0.7  #: Cosine up to which a neighbour runs alongside; others count as a step-over away, or nearer
RATE = 0.125  #: Share of the difference of both gaps a point moves in one round
UNCOVERED = 0.53  #: Points farther than this from the path [step-overs] attract the nearest strand
DRAWN, DRAWN_MORE = 0.5, 0.05  #: By this share of the excess distance, and this much more [step-overs]
MOST = 0.1  #: Longest move in one round, in step-overs: strands must not get past each other
FEW = 0.2  #: Fewer places per point than this draw less


def double_spirals(request: PatternRequest, roots: list[Turn]) -> list[Run]:
    """Join nested turns to one line that winds in and out around all holes, or to few; none without turns."""
    mesh, stepover = request.mesh, request.stepover
    turns = list(all_turns(with_loops(request, roots, SHALLOWEST).roots))
    if not turns:
        return []
    joined = connect([turn.curve for turn in turns], stepover, request.plan.start)
    lines = even_spacing(request, joined, ROUNDS)
    finished = finish_middle(mesh, lines, stepover)
    strokes = sorted(finished[len(lines) :], key=lambda run: -len(dense(run.positions, SPACING * stepover)))
    return even_spacing(request, finished[: len(lines)] + strokes[:MOST_STROKES], AFTERWARDS)


def even_spacing(request: PatternRequest, runs: Sequence[Run], rounds: int) -> list[Run]:
    """Spread the gaps between strands evenly in a number of ``rounds``; strands that follow a border stay."""
    surface, mesh, stepover = request.region.surface, request.mesh, request.stepover
    lines = [run.positions for run in runs]
    rings = [np.concatenate([curve.positions, curve.positions[:1]]) for curve in border_curves(mesh)]
    border = cKDTree(np.concatenate([dense(ring, 0.1 * stepover) for ring in rings]))
    for _ in range(rounds):
        path = _sampled(surface, lines, stepover)
        near = AT_BORDER * stepover
        free = border.query(path.points, distance_upper_bound=near)[0] > near
        lines = _moved(mesh, path, free, stepover)
    return [Run(line, _passes(run, line)) for run, line in zip(runs, lines, strict=True)]


def _sampled(surface: Surface, lines: Sequence[Array], stepover: float) -> RunSamples:
    """Evenly spaced points of all lines with the normals of the surface below."""
    lines = [dense(line, SPACING * stepover) for line in lines]
    ends = np.cumsum([len(line) for line in lines])[:-1]
    on = surface.closest(np.concatenate(lines))
    pairs = zip(np.split(on.positions, ends), np.split(on.normals, ends), strict=True)
    return Strands([Curve(positions, normals, False) for positions, normals in pairs]).sample(
        SPACING * stepover
    )


def _moved(mesh: Triangulation, path: RunSamples, free: Bools, stepover: float) -> list[Array]:
    """The lines after one round."""
    tangents = unit(along(path))
    sides = np.cross(path.normals, tangents)
    left, right = (
        _gaps(path, tangents, beside, stepover) for beside in neighbours_beside(path, sides, stepover)
    )
    balance = RATE * (left - right)
    drawn, places = _drawn(mesh, path, sides, stepover)
    out = []
    for first, last in zip(path.first[:-1], path.first[1:], strict=True):
        rows = slice(first, last)
        shift, pull, count = (
            averaged_twice(part[rows], WINDOW, "nearest") for part in (balance, drawn, places)
        )
        move = shift + DRAWN * pull / np.maximum(count, FEW)
        move = np.where(free[rows], np.clip(move, -MOST * stepover, MOST * stepover), 0.0)
        out.append(path.points[rows] + move[:, None] * sides[rows])
    return out


def _gaps(path: RunSamples, tangents: Array, beside: Indices, stepover: float) -> Array:
    """Distance to the neighbour on one side as far as it counts; a step-over where there is none [m], shape
    (n,)."""
    gap = norms(path.points[beside] - path.points)
    alongside = np.abs(dots(tangents[beside], tangents)) > ALONGSIDE
    gap = np.where(alongside, np.minimum(gap, WIDEST * stepover), np.minimum(gap, stepover))
    return np.where(beside >= 0, gap, stepover)


def _drawn(mesh: Triangulation, path: RunSamples, sides: Array, stepover: float) -> tuple[Array, Array]:
    """How far what is not covered lies off to the left of each point, summed [m], and how many places that
    are."""
    tree, covered = cKDTree(path.points), UNCOVERED * stepover
    # The search is quicker with a bound, which few places are beyond, and from each place to one near it.
    order = mesh.tree.indices
    far = np.sort(order[tree.query(mesh.vertices[order], distance_upper_bound=covered)[0] > covered])
    distance, at = tree.query(mesh.vertices[far])
    same_side = dots(path.normals[at], mesh.normals[far]) > 0.0
    far, at, distance = far[same_side], at[same_side], distance[same_side]
    offset = dots(mesh.vertices[far] - path.points[at], sides[at]) / distance
    weights = offset * (distance - (UNCOVERED - DRAWN_MORE) * stepover)
    count = len(path.points)
    return (
        np.bincount(at, weights, count).astype(np.float64),
        np.bincount(at, minlength=count).astype(np.float64),
    )


def _passes(run: Run, line: Array) -> Indices:
    """Pass of each point of a moved line: the one as far along it."""
    before, after = arc_length(run.positions), arc_length(line)
    index = np.searchsorted(before, after * (before[-1] / after[-1]), side="right") - 1
    return run.pass_index[np.clip(index, 0, len(before) - 1)]
