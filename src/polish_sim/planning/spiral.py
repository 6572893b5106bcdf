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
from polish_sim.planning.run import Run, SurfaceRun, finish_run
from polish_sim.planning.seam import BAND_SHARE, band_length, place_seams
from polish_sim.planning.triangulation import Triangulation
from polish_sim.planning.turns import Turn, border_curves, grow_turns

Array = NDArray[np.float64]

HEAD = 0.3
"""Where in the first blend the path begins, so that it does not touch itself when it comes round."""
TAIL = 0.5
"""Where in its last blend band the last turn ends."""


def plan_spiral(
    region: Region, mesh: Triangulation, stepover: float, report: Callable[[float], None]
) -> list[SurfaceRun]:
    """Cover a region with spirals from its border inwards, one where the region allows.

    Args:
        region: What to cover.
        mesh: Its fine triangulation.
        stepover: Distance between neighbouring turns [m].
        report: Called with the share done.

    Returns:
        The spirals, on the surface.
    """
    roots = grow_turns(region.surface, mesh, border_curves(mesh), 0.5 * stepover, stepover, report)
    lines = [spiral([turn.curve for turn in chain], stepover) for chain in chains(roots)]
    return [finish_run(region.surface, line, stepover) for line in lines]


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


def spiral(curves: Sequence[Curve], stepover: float) -> Run:
    """Join nested closed curves, outermost first, to one open line.

    Args:
        curves: Turns one step-over apart, inside on their left.
        stepover: That distance [m].

    Returns:
        The line, from the outermost turn to the end of the innermost.
    """
    seams = place_seams(curves, stepover)
    bands = [band_length(curve, stepover) for curve in curves]
    parts = []
    for i, curve in enumerate(curves):
        last = i == len(curves) - 1
        begin = seams[i] - (1.0 - HEAD) * bands[i] if i == 0 and not last else seams[i]
        leave = seams[i] + curve.length - bands[i]
        line = curve.between(begin, leave + TAIL * bands[i] if last else leave)[0]
        if not last:
            line = np.concatenate([line, _blend(curve, leave, bands[i], curves[i + 1], seams[i + 1])])
        parts.append(line)
    index = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return Run(np.concatenate(parts), index)


def _blend(outer: Curve, leave: float, band: float, inner: Curve, arrive: float) -> Array:
    """Slide from one turn to the next over a band, without a kink at its ends."""
    foot = inner.nearest(outer.at(np.array([leave]))[0]).s[0]
    inner_band = float(np.mod(arrive - foot, inner.length))
    if not 0.3 * band < inner_band < 2.0 * band:
        inner_band = min(band, BAND_SHARE * inner.length)
    u = np.linspace(0.0, 1.0, 64)[1:-1]
    share = (u**3 * (10.0 - 15.0 * u + 6.0 * u**2))[:, None]
    from_outer = outer.at(leave + u * band)[0]
    from_inner = inner.at(arrive - (1.0 - u) * inner_band)[0]
    return (1.0 - share) * from_outer + share * from_inner
