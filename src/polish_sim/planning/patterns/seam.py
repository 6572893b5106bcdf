"""Where a spiral steps from turn to turn: a line across all turns that keeps away from corners (turns -> seams)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.patterns.matching import beside

Array = NDArray[np.float64]

LONGEST, SHORTEST = 8.0, 2.5
"""Limits of the length of the first step inwards, in step-overs."""
SHARE_OF_PATH = 0.03
"""The step takes this share of the whole path, within the limits."""
SHARE_OF_TURN = 0.25
"""And at most this share of the first turn."""
ROOM = 0.5
"""Step-overs kept between a step and a corner."""
GOAL_PRICE = 1.0
"""What a step-over away from where the spiral had better end is worth, in steps over corners."""
START_PRICE = 30.0
"""What a step-over away from where the path shall begin is worth."""
ODD, OVER_CORNER = 0.1, 0.5
"""A line across turns costs where its steps differ from a step-over by more than the first; where the path shall begin
somewhere they may go over corners, where they are longer."""
HEAD = 0.3
"""Where beside its own first step inwards the line begins, as a share of the step, so that it does not touch itself."""
NEAR_START = 4
"""A path may begin as many step-overs along the turn from where it is asked to, in corners the turns do not step in."""
CORNER = np.radians(30.0)
"""Turning within half a step-over that counts as a corner [rad]."""
CANDIDATES = 96
SAME = 1e-6
"""Prices this close are equal; the first place along the turn wins."""


class Seams(NamedTuple):
    """Where the turns of a spiral begin and how long the first step to the next turn is."""

    s: Array
    """Arc length of each turn's beginning on its curve [m], shape (k,)."""
    band: float
    """Length of the step inwards, half of it on either side of the first seam [m]."""


def place_seams(curves: Sequence[Curve], stepover: float, goals: Array, outer: Array, inner: Array) -> Seams:
    """Find a line across all turns along which their steps inwards avoid corners.

    Lines are traced outwards from points of the innermost turn, nearest point to nearest point; outwards they
    never run into a corner. The one furthest from corners wins.

    Args:
        curves: Nested turns, outermost first.
        stepover: Distance between them [m].
        goals: Places near which the innermost turn had better end [m], shape (g, 3); none is fine.
        outer: Place near which the outermost turn shall begin [m], shape (1, 3) or (0, 3).
        inner: Place near which the innermost turn shall end, likewise.

    Returns:
        Beginnings and the length of the first step.
    """
    total = sum(curve.length for curve in curves)
    longest = float(np.clip(SHARE_OF_PATH * total, SHORTEST * stepover, LONGEST * stepover))
    lines = _outwards(curves, stepover)
    if len(outer):
        lines = np.concatenate([lines, _inwards(curves, outer, stepover)], axis=1)
    places = [curve.at(s)[0] for curve, s in zip(curves, lines, strict=True)]
    price = (GOAL_PRICE * _away(places[-1], goals) + START_PRICE * _away(places[-1], inner)) / stepover
    for before, after in pairwise(places):
        gap = np.linalg.norm(after - before, axis=1) / stepover
        price += 10.0 * np.maximum(np.abs(gap - 1.0) - (OVER_CORNER if len(outer) else ODD), 0.0)
    rooms = []
    for curve, s, single in zip(curves, lines, _alone(curves, stepover), strict=True):
        rooms.append(_room(curve, s, np.concatenate([_corners(curve, stepover), single])))
        wanted = 0.5 * min(longest, SHARE_OF_TURN * curve.length) + ROOM * stepover
        price += np.maximum(1.0 - rooms[-1] / wanted, 0.0) - 0.02 * rooms[-1] / curve.length
    bands = np.minimum(_bands(rooms, longest, stepover), SHARE_OF_TURN * curves[0].length)
    begins = curves[0].at(lines[0] - (0.5 - HEAD) * bands)[0]
    price += START_PRICE * _away(begins, outer) / stepover
    best = int(np.argmax(price <= price.min() + SAME))
    return Seams(lines[:, best], float(bands[best]))


def _bands(rooms: Sequence[Array], longest: float, stepover: float) -> Array:
    """Length of the first step on each line, as much as there is room for [m], shape (n,)."""
    # Inner turns have corners everywhere; there little is left of the step.
    room = np.percentile(rooms, 25.0, axis=0)
    return np.clip(2.0 * (room - ROOM * stepover), SHORTEST * stepover, longest)


def _outwards(curves: Sequence[Curve], stepover: float) -> Array:
    """Lines from places all round the innermost turn, nearest point to nearest point; arc lengths (k, n) [m]."""
    count = min(CANDIDATES, max(int(curves[-1].length / (0.25 * stepover)), 8))
    lines = [np.linspace(0.0, curves[-1].length, count, endpoint=False)]
    for inner, outer in pairwise(reversed(curves)):
        lines.append(outer.nearest(inner.at(lines[-1])[0]).s)
    return np.array(lines[::-1])


def _inwards(curves: Sequence[Curve], start: Array, stepover: float) -> Array:
    """Lines from places of the outermost turn near a start (1, 3), likewise; they may run into corners."""
    middle = curves[0].nearest(start).s
    lines = [curves[0].wrap(middle + stepover * np.linspace(-NEAR_START, NEAR_START, 4 * NEAR_START + 1))]
    for outer, inner in pairwise(curves):
        lines.append(inner.nearest(outer.at(lines[-1])[0]).s)
    return np.array(lines)


def _away(points: Array, goals: Array) -> Array:
    """Distance of points (n, 3) to the nearest goal (g, 3) [m]; 0 without goals."""
    if len(goals) == 0:
        return np.zeros(len(points))
    return np.asarray(np.linalg.norm(points[:, None] - goals, axis=2).min(axis=1))


def _alone(curves: Sequence[Curve], stepover: float) -> list[Array]:
    """Arc lengths of each turn's points that do not lie beside the next or the last turn [m]."""
    out = [np.empty(0) for _ in curves]
    for i in range(len(curves) - 1):
        on_outer, on_inner = beside(curves[i], curves[i + 1], stepover)
        out[i] = np.concatenate([out[i], curves[i].knots[:-1][~on_outer]])
        out[i + 1] = curves[i + 1].knots[:-1][~on_inner]
    return out


def _room(curve: Curve, s: Array, corners: Array) -> Array:
    """How far places are from the nearest of the corners of a closed curve; half its length if it has none [m]."""
    if len(corners) == 0:
        return np.full(len(s), 0.5 * curve.length)
    ordered = np.sort(np.mod(corners, curve.length))
    after = np.searchsorted(ordered, s) % len(ordered)
    ahead, behind = np.mod(ordered[after] - s, curve.length), np.mod(s - ordered[after - 1], curve.length)
    return np.asarray(np.minimum(behind, ahead))


def _corners(curve: Curve, stepover: float) -> Array:
    """Arc lengths of the points at which a closed curve turns sharply [m]."""
    reach = 0.25 * stepover
    count = max(int(curve.length / (0.25 * reach)), 8)
    s = np.linspace(0.0, curve.length, count, endpoint=False)
    ahead, behind = curve.tangents(s + 0.5 * reach, 0.5 * reach), curve.tangents(s - 0.5 * reach, 0.5 * reach)
    return s[(ahead * behind).sum(axis=1) < np.cos(CORNER)]
