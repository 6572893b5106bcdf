"""One continuous spiral: nested turns joined without a lift (turns -> runs; paper 1, section 1.3, fig. 6).

Turns are offset curves at multiples of the step-over from the border. The spiral goes from each to the next: within
a short band on the first turn, which follows the border, and over more and more of the way round further in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.curves.turns import Turn
from polish_sim.planning.patterns.joining import first_break, join_turns
from polish_sim.planning.patterns.leftover import finish_middle, middle_ends
from polish_sim.planning.patterns.nested import grown_turns
from polish_sim.planning.patterns.request import PatternRequest
from polish_sim.planning.patterns.run import Run, SurfaceRun, finish_run
from polish_sim.planning.patterns.seam import place_seams
from polish_sim.planning.quality.crossings import count_self_crossings

SHORTEST = 1.0
"""Turns shorter than this many step-overs are left to what finishes the middle."""


def spiral_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with spirals between its border and its middle, one where the region allows.

    Spirals are laid inwards, counter-clockwise seen from outside; then what is not done yet lies on the left.
    Walked backwards they lead outwards, and what is not done yet still lies on the left. To have it on the right
    (climb) they are laid clockwise.

    Args:
        request: What to cover and how; its plan says inward or outward, conventional or climb, and where to start.

    Returns:
        The spirals, on the surface.
    """
    plan, mesh, stepover = request.plan, request.mesh, request.stepover
    roots, pitch, to_border = grown_turns(request)
    outward = plan.order == "outward"
    waiting = [chain for chain in chains(roots, stepover) if chain[0].curve.length > SHORTEST * stepover]
    start, nowhere = np.reshape(plan.start, (-1, 3)), np.empty((0, 3))
    lines: list[Run] = []
    while waiting:
        chain = waiting.pop(0)
        curves = [turn.curve.backwards() if plan.direction == "climb" else turn.curve for turn in chain]
        ends = nowhere if chain[-1].children else middle_ends(mesh, chain[-1], stepover)
        # The path begins on the first line, or outwards at the end of the last.
        outer, inner = nowhere if outward or lines else start, start if outward and not waiting else nowhere
        seams = place_seams(curves, pitch, ends, outer, inner)
        count = first_break(curves, seams, pitch)
        if count < len(chain):
            waiting[:0] = [chain[:count], chain[count:]]
        else:
            lines.append(join_turns(curves, seams, to_border, pitch))
    runs = _finished(request, lines, finish_middle(mesh, lines, stepover))
    return [run.backwards() for run in runs[::-1]] if outward else runs


def _finished(request: PatternRequest, lines: Sequence[Run], longer: Sequence[Run]) -> list[SurfaceRun]:
    """Finished runs; what was added to the lines is taken back where it crosses something after all."""

    def finish(line: Run) -> SurfaceRun:
        return finish_run(request.region.surface, line, request.stepover)

    runs: list[SurfaceRun | None] = [finish(line) for line in longer]
    count = _crossings(runs)
    for k, line in reversed(list(enumerate(longer))):
        added = k >= len(lines) or len(line.positions) > len(lines[k].positions)
        if count == 0 or not added:
            continue
        trial = [*runs[:k], finish(lines[k]) if k < len(lines) else None, *runs[k + 1 :]]
        fewer = _crossings(trial)
        if fewer < count:
            runs, count = trial, fewer
    return [run for run in runs if run is not None]


def _crossings(runs: Sequence[SurfaceRun | None]) -> int:
    return count_self_crossings([Curve(run.positions, run.points.normals, False) for run in runs if run is not None])


def chains(roots: Sequence[Turn], stepover: float) -> list[list[Turn]]:
    """Split nested turns into chains that can be walked without a lift, the longest way inwards first."""

    def shortness(turn: Turn) -> float:
        """Rounded, so that turns of one length stay in order whatever the rounding of the coordinates."""
        return -round(turn.curve.length / stepover, 4)

    waiting = sorted(roots, key=shortness)
    out = []
    while waiting:
        chain = [waiting.pop(0)]
        while chain[-1].children:
            inner = sorted(chain[-1].children, key=shortness)
            waiting.extend(inner[1:])
            if inner[0].curve.length < SHORTEST * stepover:
                break
            chain.append(inner[0])
        out.append(chain)
    return out
