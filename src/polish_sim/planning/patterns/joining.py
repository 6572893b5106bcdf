"""Nested turns joined to one line that winds inwards without a lift (turns and seams -> run; paper 1, fig. 6)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.patterns.matching import Match, match_turns
from polish_sim.planning.patterns.pitch import Shares, spread_shares
from polish_sim.planning.patterns.run import Run
from polish_sim.planning.patterns.seam import HEAD, Seams

Array = NDArray[np.float64]

GAP = 0.5
"""The last turn ends where it comes this near to the turn before, in step-overs."""
ROOM = 0.3
"""A step inwards needs this many step-overs more than its length beside the next turn."""
SAME = 1e-5
"""Shares this little below nothing are nothing."""


def first_break(curves: Sequence[Curve], seams: Seams, stepover: float) -> int:
    """Number of turns that can be joined: up to the first whose step inwards would leave the next turn's side.

    Args:
        curves: Turns, outermost first.
        seams: Where they begin.
        stepover: Distance between them [m].

    Returns:
        How many; all of them if the line can go on to the last.
    """
    reach = 0.5 * seams.band + ROOM * stepover
    for i, match in enumerate(_matches(curves, seams, stepover)):
        on_step = np.zeros(len(match.beside), dtype=bool)
        for places in (match.outer, match.inner):
            on_step |= np.minimum(places, places[-1] - places) < reach
        if not match.beside[on_step].all():
            return i + 1
    return len(curves)


def join_turns(curves: Sequence[Curve], seams: Seams, to_border: bool, stepover: float) -> Run:
    """Wind from the outermost turn to the innermost.

    Args:
        curves: Closed turns one step-over apart, outermost first, inside on their left.
        seams: Where the turns begin.
        to_border: Whether the last turn follows a border too.
        stepover: That distance [m].

    Returns:
        The line; each round has its number.
    """
    matches = _matches(curves, seams, stepover)
    if not matches:
        return _number([curves[0].between(seams.s[0], seams.s[0] + curves[0].length - GAP * stepover)[0]])
    shares = spread_shares([curve.length for curve in curves], matches, seams.band, to_border, stepover)
    parts = [_round(curves, seams.s, matches, shares[i], i) for i in range(len(curves) - 1)]
    begin = seams.s[0] - (0.5 - HEAD) * seams.band
    parts[0] = np.concatenate([curves[0].between(begin, seams.s[0])[0][:-1], parts[0]])
    parts.append(_last_round(curves, seams.s, matches[-1], shares))
    return _number(parts)


def _matches(curves: Sequence[Curve], seams: Seams, stepover: float) -> list[Match]:
    pairs = zip(curves[:-1], curves[1:], seams.s[:-1], seams.s[1:], strict=True)
    return [match_turns(*pair, stepover) for pair in pairs]


def _number(parts: Sequence[Array]) -> Run:
    return Run(np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts]))


def _round(curves: Sequence[Curve], seams: Array, matches: Sequence[Match], share_of: Shares, i: int) -> Array:
    """Once round along a turn, drifting inwards."""
    ahead = matches[i]
    share = share_of.at(ahead.outer)
    if i == 0:  # nothing lies further out
        return _between(curves[0], curves[1], seams[:2], ahead, np.maximum(share, 0.0))
    inwards = share >= -SAME
    points = _between(curves[i], curves[i + 1], seams[i : i + 2], ahead, np.maximum(share, 0.0))[inwards]
    place = ahead.outer[inwards]
    behind = matches[i - 1]
    share = share_of.at(behind.inner)
    outwards = share < -SAME
    before = _between(curves[i - 1], curves[i], seams[i - 1 : i + 1], behind, 1.0 + share)[outwards]
    place = np.concatenate([behind.inner[outwards], place])
    order = np.argsort(place, kind="stable")
    return np.concatenate([before, points])[order]


def _last_round(curves: Sequence[Curve], seams: Array, behind: Match, shares: Sequence[Shares]) -> Array:
    """Drift to the last turn and follow it until it comes near the round before."""
    share = np.minimum(shares[-1].at(behind.inner), 0.0)
    share[-1] = 0.0
    before = shares[-2].at(behind.outer)
    near = np.flatnonzero((1.0 + share - before < GAP) & (behind.inner > 0.5 * behind.inner[-1]))
    end = near[0] if len(near) else len(share)
    return _between(curves[-2], curves[-1], seams[-2:], behind, 1.0 + share)[:end]


def _between(outer: Curve, inner: Curve, seams: Array, match: Match, share: Array) -> Array:
    """Points a share of the way from each place of the outer turn to that of the inner one, (n, 3).

    Places that do not lie beside each other stay on the turn the share is nearer to.
    """
    start = outer.at(seams[0] + match.outer)[0]
    share = np.where(match.beside, share, np.round(share))
    return np.asarray(start + share[:, None] * (inner.at(seams[1] + match.inner)[0] - start))
