"""One continuous spiral: nested turns joined without a lift (turns -> runs; paper 1, section 1.3, fig. 6).

A turn is followed once round, then blended into the next one inside a narrow band. The bands lie one behind the
other along a line across all turns, so that neighbouring turns move inwards side by side and keep their distance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry import Region
from polish_sim.planning.curve import Curve
from polish_sim.planning.leftover import finish_middle, middle_ends
from polish_sim.planning.request import PatternRequest
from polish_sim.planning.run import Run, SurfaceRun, finish_run
from polish_sim.planning.seam import SHARE_OF_TURN, place_seams
from polish_sim.planning.triangulation import Triangulation
from polish_sim.planning.turns import Turn, border_curves, grow_turns, ring_margin

Array = NDArray[np.float64]

HEAD = 0.4
"""Where in the first blend the path begins, so that it does not touch itself when it comes round."""
TAIL = 1.0 - HEAD
"""Where in its last blend band the last turn ends, for the same reason."""


def plan_spiral(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with spirals from its border inwards, one where the region allows.

    Args:
        request: What to cover and how.

    Returns:
        The spirals, on the surface.
    """
    region, mesh, stepover, report = request.region, request.mesh, request.stepover, request.report
    roots = _nested_turns(region, mesh, stepover, report)
    lines = []
    for chain in chains(roots):
        goals = middle_ends(mesh, chain[-1], stepover)
        lines.append(spiral([turn.curve for turn in chain], stepover, goals))
    return [finish_run(region.surface, line, stepover) for line in finish_middle(mesh, lines, stepover)]


def _nested_turns(region: Region, mesh: Triangulation, stepover: float, report: Callable[[float], None]) -> list[Turn]:
    """Turns of the region; on a ring of even width from the outer border to the inner one."""
    borders = border_curves(mesh)
    if len(borders) == 2:
        first = ring_margin(region.surface, mesh, borders, stepover)
        if first is not None:
            return grow_turns(region.surface, mesh, borders[:1], first, stepover, report)
    return grow_turns(region.surface, mesh, borders, 0.5 * stepover, stepover, report)


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


def spiral(curves: Sequence[Curve], stepover: float, goals: Array) -> Run:
    """Join nested closed curves, outermost first, to one open line.

    Args:
        curves: Turns one step-over apart, inside on their left.
        stepover: That distance [m].
        goals: Places near which the innermost turn had better end [m], shape (g, 3); none is fine.

    Returns:
        The line, from the outermost turn to the end of the innermost.
    """
    seams = place_seams(curves, stepover, goals)
    parts = []
    for i, curve in enumerate(curves):
        begin, band = seams.s[i], seams.bands[i]
        leave = begin + curve.length - band
        if i == len(curves) - 1:
            parts.append(curve.between(begin, leave + TAIL * band)[0])
            continue
        if i == 0:
            begin -= (1.0 - HEAD) * band
        blend = _blend(curve, leave, band, curves[i + 1], seams.s[i + 1])
        parts.append(np.concatenate([curve.between(begin, leave)[0], blend]))
    index = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return Run(np.concatenate(parts), index)


def _blend(outer: Curve, leave: float, band: float, inner: Curve, arrive: float) -> Array:
    """Slide from one turn to the next over a band, without a kink at its ends."""
    foot = inner.nearest(outer.at(np.array([leave]))[0]).s[0]
    inner_band = float(np.mod(arrive - foot, inner.length))
    if not 0.3 * band < inner_band < 2.0 * band:
        inner_band = min(band, SHARE_OF_TURN * inner.length)
    u = np.linspace(0.0, 1.0, 64)[1:-1]
    share = (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, None]
    from_outer = outer.at(leave + u * band)[0]
    from_inner = inner.at(arrive - (1.0 - u) * inner_band)[0]
    return (1.0 - share) * from_outer + share * from_inner
