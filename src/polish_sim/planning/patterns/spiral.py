"""One continuous spiral: nested turns joined without a lift (turns -> runs; paper 1, section 1.3, fig. 6).

Turns are offset curves at multiples of the step-over from the border. The spiral goes from each to the next:
within a short band on the first turn, which follows the border, and over more and more of the way round
further in.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, dots, norms
from polish_sim.planning.curve import Curve
from polish_sim.planning.patterns.double_spiral import double_spirals
from polish_sim.planning.patterns.leftover import finish_middle, middle_ends
from polish_sim.planning.patterns.nested import CANDIDATES, chains, grown_turns, lines_across
from polish_sim.planning.patterns.pitch import Match, Shares, beside, match_turns, spread_shares
from polish_sim.planning.patterns.run import PatternRequest, Run, SurfaceRun, numbered
from polish_sim.planning.quality.crossings import find_crossings
from polish_sim.planning.turns import border_curves

# Where a spiral steps from turn to turn: a line across all turns that keeps away from corners (turns ->
# seams).

LONGEST, SHORTEST = 8.0, 2.5  #: Limits of the length of the first step inwards, in step-overs
SHARE_OF_PATH = 0.03  #: The step takes this share of the whole path, within the limits
SHARE_OF_TURN = 0.25  #: And at most this share of the first turn
ROOM = 0.5  #: Step-overs kept between a step and a corner
GOAL_PRICE = 1.0  #: Price of ending a step-over away from the wanted place, in steps over corners
START_PRICE = 30.0  #: Price of beginning a step-over away from the start asked for
ODD, OVER_CORNER = 0.1, 0.5
"""A line across turns costs where its steps differ from a step-over by more than the first; where the path
shall begin somewhere they may go over corners, where they are longer."""
#: Where beside its first step inwards the line begins, as a share of the step: it must not touch itself
HEAD = 0.3
CORNER = np.radians(30.0)  #: Turning within half a step-over that counts as a corner [rad]
SAME = 1e-6  #: Prices this close are equal; the first place along the turn wins


class Seams(NamedTuple):
    """Where the turns of a spiral begin and how long the first step to the next turn is."""

    s: Array  #: Arc length of each turn's beginning on its curve [m], shape (k,)
    band: float  #: Length of the step inwards, half of it on either side of the first seam [m]


def place_seams(curves: Sequence[Curve], stepover: float, goals: Array, outer: Array, inner: Array) -> Seams:
    """Find a line across all nested turns, outermost first, along which their steps inwards avoid corners.

    Lines are traced outwards from points of the innermost turn, nearest point to nearest point; outwards they
    never run into a corner. The one furthest from corners wins. The innermost turn should end near one of
    ``goals`` (g, 3) [m]; ``outer`` and ``inner``, (1, 3) or (0, 3) [m], are where the outermost turn shall
    begin and the innermost end.

    Returns beginnings and the length of the first step.
    """
    total = sum(curve.length for curve in curves)
    longest = np.clip(SHARE_OF_PATH * total, SHORTEST * stepover, LONGEST * stepover)
    count = min(CANDIDATES, max(int(curves[-1].length / (0.25 * stepover)), 8))
    lines = lines_across(curves, count, outer, stepover)
    places = [curve.points(s) for curve, s in zip(curves, lines, strict=True)]
    price = (GOAL_PRICE * _away(places[-1], goals) + START_PRICE * _away(places[-1], inner)) / stepover
    for before, after in pairwise(places):
        gap = norms(after - before) / stepover
        price += 10.0 * np.maximum(np.abs(gap - 1.0) - (OVER_CORNER if len(outer) else ODD), 0.0)
    rooms = []
    for curve, s, single in zip(curves, lines, _alone(curves, stepover), strict=True):
        rooms.append(_room(curve, s, np.concatenate([_corners(curve, stepover), single])))
        wanted = 0.5 * min(longest, SHARE_OF_TURN * curve.length) + ROOM * stepover
        price += np.maximum(1.0 - rooms[-1] / wanted, 0.0) - 0.02 * rooms[-1] / curve.length
    # Inner turns have corners everywhere; there little is left of the step.
    room = np.percentile(rooms, 25.0, axis=0)
    bands = np.clip(2.0 * (room - ROOM * stepover), SHORTEST * stepover, longest)
    bands = np.minimum(bands, SHARE_OF_TURN * curves[0].length)
    begins = curves[0].points(lines[0] - (0.5 - HEAD) * bands)
    price += START_PRICE * _away(begins, outer) / stepover
    best = np.argmax(price <= price.min() + SAME)
    return Seams(lines[:, best], bands[best])


def _away(points: Array, goals: Array) -> Array:
    """Distance of points (n, 3) to the nearest goal (g, 3) [m]; 0 without goals."""
    if len(goals) == 0:
        return np.zeros(len(points))
    return norms(points[:, None] - goals).min(axis=1)


def _alone(curves: Sequence[Curve], stepover: float) -> list[Array]:
    """Arc lengths of each turn's points that do not lie beside the next or the last turn [m]."""
    out = [np.empty(0) for _ in curves]
    for i in range(len(curves) - 1):
        on_outer, on_inner = beside(curves[i], curves[i + 1], stepover)
        out[i] = np.concatenate([out[i], curves[i].knots[:-1][~on_outer]])
        out[i + 1] = curves[i + 1].knots[:-1][~on_inner]
    return out


def _room(curve: Curve, s: Array, corners: Array) -> Array:
    """How far places are from the nearest of the corners of a closed curve; half its length if it has none
    [m]."""
    if len(corners) == 0:
        return np.full(len(s), 0.5 * curve.length)
    ordered = np.sort(np.mod(corners, curve.length))
    after = np.searchsorted(ordered, s) % len(ordered)
    ahead, behind = np.mod(ordered[after] - s, curve.length), np.mod(s - ordered[after - 1], curve.length)
    return np.minimum(behind, ahead)


def _corners(curve: Curve, stepover: float) -> Array:
    """Arc lengths of the points at which a closed curve turns sharply [m]."""
    reach = 0.25 * stepover
    s = curve.even(0.25 * reach, 8)
    ahead, behind = curve.tangents(s + 0.5 * reach, 0.5 * reach), curve.tangents(s - 0.5 * reach, 0.5 * reach)
    return s[dots(ahead, behind) < np.cos(CORNER)]


# Nested turns joined to one line that winds inwards without a lift (turns and seams -> run; paper 1, fig. 6).

GAP = 0.5  #: The last turn ends where it comes this near to the turn before, in step-overs
JOINING_ROOM = 0.3  #: A step inwards needs this many step-overs more than its length beside the next turn
JOINING_SAME = 1e-5  #: Shares this little below nothing are nothing


def _first_break(matches: Sequence[Match], band: float, stepover: float) -> int:
    """Number of turns that can be joined: up to the first whose step inwards would leave the next turn's
    side."""
    reach = 0.5 * band + JOINING_ROOM * stepover
    for i, match in enumerate(matches):
        on_step = np.zeros(len(match.beside), dtype=bool)
        for places in (match.outer, match.inner):
            on_step |= np.minimum(places, places[-1] - places) < reach
        if not match.beside[on_step].all():
            return i + 1
    return len(matches) + 1


def _join_turns(
    curves: Sequence[Curve], seams: Seams, matches: Sequence[Match], to_border: bool, stepover: float
) -> Run:
    """Wind from the outermost of closed turns to the innermost; to_border: whether that one follows a
    border."""
    if not matches:
        return numbered([curves[0].between(seams.s[0], seams.s[0] + curves[0].length - GAP * stepover)])
    shares = spread_shares([curve.length for curve in curves], matches, seams.band, to_border, stepover)
    parts = [_round(curves, seams.s, matches, shares[i], i) for i in range(len(curves) - 1)]
    begin = seams.s[0] - (0.5 - HEAD) * seams.band
    parts[0] = np.concatenate([curves[0].between(begin, seams.s[0])[:-1], parts[0]])
    parts.append(_last_round(curves, seams.s, matches[-1], shares))
    return numbered(parts)


def _round(
    curves: Sequence[Curve], seams: Array, matches: Sequence[Match], share_of: Shares, i: int
) -> Array:
    """Once round along a turn, drifting inwards."""
    ahead = matches[i]
    share = share_of.at(ahead.outer)
    if i == 0:  # nothing lies further out
        return _between(curves[0], curves[1], seams[:2], ahead, np.maximum(share, 0.0))
    inwards = share >= -JOINING_SAME
    points = _between(curves[i], curves[i + 1], seams[i : i + 2], ahead, np.maximum(share, 0.0))[inwards]
    place = ahead.outer[inwards]
    behind = matches[i - 1]
    share = share_of.at(behind.inner)
    outwards = share < -JOINING_SAME
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
    start = outer.points(seams[0] + match.outer)
    share = np.where(match.beside, share, np.round(share))
    return start + share[:, None] * (inner.points(seams[1] + match.inner) - start)


SPIRAL_SHORTEST = 1.0  #: Turns shorter than this many step-overs are left to what finishes the middle


def spiral_runs(request: PatternRequest) -> list[SurfaceRun]:
    """Cover a region with spirals between its border and its middle, one where the region allows.

    Spirals are laid inwards, counter-clockwise seen from outside; then what is not done yet lies on the left.
    Walked backwards they lead outwards, and what is not done yet still lies on the left. To have it on the
    right (climb) they are laid clockwise. Around holes they wind in and out in one stroke, except with climb:
    of the two ways one would have it on the wrong side.
    """
    plan, mesh, stepover = request.plan, request.mesh, request.stepover
    roots, pitch, to_border = grown_turns(request)
    outward = plan.order == "outward"
    shortest = SPIRAL_SHORTEST * stepover
    waiting = [chain for chain in chains(roots, stepover) if chain[0].curve.length > shortest]
    start, nowhere = np.reshape(plan.start, (-1, 3)), np.empty((0, 3))
    lines: list[Run] = []
    if len(waiting) > 1 and len(border_curves(mesh)) > 1 and plan.direction != "climb":
        doubled = request.finished(double_spirals(request, roots))
        # on narrow or folded ground strands may be moved past each other
        if doubled and not len(find_crossings([run.curve for run in doubled]).places):
            return _in_order(doubled, outward)
    while waiting:
        chain = waiting.pop(0)
        curves = [turn.curve.backwards() if plan.direction == "climb" else turn.curve for turn in chain]
        ends = nowhere if chain[-1].children else middle_ends(mesh, chain[-1], stepover)
        # The path begins on the first line, or outwards at the end of the last.
        outer, inner = nowhere if outward or lines else start, start if outward and not waiting else nowhere
        seams = place_seams(curves, pitch, ends, outer, inner)
        pairs = zip(curves[:-1], curves[1:], seams.s[:-1], seams.s[1:], strict=True)
        matches = [match_turns(*pair, pitch) for pair in pairs]
        count = _first_break(matches, seams.band, pitch)
        if count < len(chain):
            waiting[:0] = [chain[:count], chain[count:]]
        else:
            lines.append(_join_turns(curves, seams, matches, to_border, pitch))
    return _in_order(request.finished(finish_middle(mesh, lines, stepover)), outward)


def _in_order(runs: list[SurfaceRun], outward: bool) -> list[SurfaceRun]:
    return [run.backwards() for run in runs[::-1]] if outward else runs
