"""One continuous spiral: nested turns joined without a lift (turns -> runs; paper 1, section 1.3, fig. 6).

Turns are offset curves at multiples of the step-over from the border. The spiral goes from each to the next: within
a short band on the first turn, which follows the border, and over more and more of the way round further in.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from polish_sim.planning.joining import join_turns
from polish_sim.planning.leftover import finish_middle, middle_ends
from polish_sim.planning.request import PatternRequest
from polish_sim.planning.run import SurfaceRun, finish_run
from polish_sim.planning.seam import place_seams
from polish_sim.planning.turns import Turn, border_curves, grow_turns, ring_margin


def plan_spiral(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with spirals from its border inwards, one where the region allows.

    Args:
        request: What to cover and how.

    Returns:
        The spirals, on the surface.
    """
    region, mesh, stepover, report = request.region, request.mesh, request.stepover, request.report
    borders = border_curves(mesh)
    margin = ring_margin(region.surface, mesh, borders, stepover) if len(borders) == 2 else None
    if margin is None:
        roots = grow_turns(region.surface, mesh, borders, 0.5 * stepover, stepover, report)
    else:
        roots = grow_turns(region.surface, mesh, borders[:1], margin, stepover, report)
    start = np.reshape(request.plan.start, (-1, 3))
    lines = []
    for chain in chains(roots):
        goals = middle_ends(mesh, chain[-1], stepover)
        curves = [turn.curve for turn in chain]
        seams = place_seams(curves, stepover, goals, start)
        lines.append(join_turns(curves, seams, margin is not None, stepover))
    return [finish_run(region.surface, line, stepover) for line in finish_middle(mesh, lines, stepover)]


def chains(roots: Sequence[Turn]) -> list[list[Turn]]:
    """Split nested turns into chains that can be walked without a lift, the longest way inwards first."""
    waiting = sorted(roots, key=lambda turn: -turn.curve.length)
    out = []
    while waiting:
        chain = [waiting.pop(0)]
        while chain[-1].children:
            inner = sorted(chain[-1].children, key=lambda turn: -turn.curve.length)
            chain.append(inner[0])
            waiting.extend(inner[1:])
        out.append(chain)
    return out
