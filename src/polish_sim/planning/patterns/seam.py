"""Where a spiral steps from turn to turn: a line across all turns that keeps away from corners (turns -> seams)."""

from __future__ import annotations

from collections.abc import Sequence
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
START_PRICE = 3.0
"""What a step-over away from where the path shall begin is worth."""
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
    count = min(CANDIDATES, max(int(curves[-1].length / (0.25 * stepover)), 8))
    points = curves[-1].at(np.linspace(0.0, curves[-1].length, count, endpoint=False))[0]
    price = (GOAL_PRICE * _away(points, goals) + START_PRICE * _away(points, inner)) / stepover
    lines: list[Array] = []
    rooms: list[Array] = []
    alone = _alone(curves, stepover)
    for curve, single in zip(reversed(curves), reversed(alone), strict=True):
        nearest = curve.nearest(points)
        if lines:
            price += 10.0 * np.maximum(np.abs(nearest.distances / stepover - 1.0) - 0.1, 0.0)
        points = nearest.positions
        lines.append(nearest.s)
        rooms.append(_room(curve, nearest.s, np.concatenate([_corners(curve, stepover), single])))
        wanted = 0.5 * min(longest, SHARE_OF_TURN * curve.length) + ROOM * stepover
        price += np.maximum(1.0 - rooms[-1] / wanted, 0.0) - 0.02 * rooms[-1] / curve.length
    price += START_PRICE * _away(points, outer) / stepover
    best = int(np.argmax(price <= price.min() + SAME))
    # Inner turns have corners everywhere; there little is left of the step.
    room = np.percentile([each[best] for each in rooms], 25.0)
    band = float(np.clip(2.0 * (room - ROOM * stepover), SHORTEST * stepover, longest))
    s = np.array([line[best] for line in reversed(lines)])
    return Seams(s, min(band, SHARE_OF_TURN * curves[0].length))


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
