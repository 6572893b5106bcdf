"""Where a spiral steps from turn to turn: a line across all turns that keeps away from corners (turns -> seams)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curve import Curve

Array = NDArray[np.float64]

LONGEST, SHORTEST = 8.0, 2.5
"""Limits of the length of a blend in step-overs."""
SHARE_OF_PATH = 0.02
"""A blend takes this share of the whole path, within the limits."""
SHARE_OF_TURN = 0.25
"""And at most this share of its turn."""
ROOM = 0.5
"""Step-overs kept between a blend and a corner."""
GROWTH = 0.08
"""Neighbouring blends differ in length by at most this share, so that turns keep their distance within them."""
GOAL_PRICE = 1.0
"""What a step-over away from where the spiral had better end is worth, in blends over corners."""
CORNER = np.radians(30.0)
"""Turning within half a step-over that counts as a corner [rad]."""
CANDIDATES = 96


class Seams(NamedTuple):
    """Where the turns of a spiral begin and how long the blends into the next turns are."""

    s: Array
    """Arc length of each turn's beginning on its curve [m], shape (k,)."""
    bands: Array
    """Length of the blend that ends there [m], shape (k,)."""


def place_seams(curves: Sequence[Curve], stepover: float, goals: Array) -> Seams:
    """Find a line across all turns along which their blends avoid corners.

    Lines are traced outwards from points of the innermost turn, nearest point to nearest point; outwards they
    never run into a corner. The one with the longest blends wins.

    Args:
        curves: Nested turns, outermost first.
        stepover: Distance between them [m].
        goals: Places near which the innermost turn had better end [m], shape (g, 3); none is fine.

    Returns:
        Beginnings and blend lengths.
    """
    total = sum(curve.length for curve in curves)
    longest = float(np.clip(SHARE_OF_PATH * total, SHORTEST * stepover, LONGEST * stepover))
    count = min(CANDIDATES, max(int(curves[-1].length / (0.25 * stepover)), 8))
    points = curves[-1].at(np.linspace(0.0, curves[-1].length, count, endpoint=False))[0]
    lines: list[Array] = []
    cost = np.zeros(count)
    if len(goals):
        away = np.linalg.norm(points[:, None] - goals, axis=2).min(axis=1)
        cost += GOAL_PRICE * away / stepover
    for curve in reversed(curves):
        nearest = curve.nearest(points)
        if lines:
            cost += 10.0 * np.maximum(np.abs(nearest.distances / stepover - 1.0) - 0.1, 0.0)
        points = nearest.positions
        cost += _crowding(curve, nearest.s, longest, stepover)
        lines.append(nearest.s)
    best = int(np.argmin(np.round(cost, 6)))
    s = np.array([line[best] for line in reversed(lines)])
    return Seams(s, _even_bands(curves, s, longest, stepover))


def _crowding(curve: Curve, s: Array, band: float, stepover: float) -> Array:
    """How much of a blend that ends at s would run over a corner, and a little for not lying between corners."""
    corners = _corners(curve, stepover)
    if len(corners) == 0:
        return np.zeros(len(s))
    band = min(band, SHARE_OF_TURN * curve.length)
    behind = np.mod(s[:, None] - corners, curve.length).min(axis=1)
    ahead = np.mod(corners - s[:, None], curve.length).min(axis=1)
    missing = np.maximum(1.0 - behind / (band + ROOM * stepover), 0.0)
    return np.asarray(missing + 0.2 * (ahead < stepover) + 0.02 * np.abs(behind - ahead - band) / curve.length)


def _even_bands(curves: Sequence[Curve], s: Array, longest: float, stepover: float) -> Array:
    """Blends that grow slowly from turn to turn, seen along the seam, and leave room on the innermost turns."""
    reach = SHORTEST * stepover
    scale = np.ones(len(curves))
    for i in range(len(curves) - 1):
        foot = curves[i + 1].nearest(curves[i].at(np.array([s[i] - reach]))[0]).s[0]
        shrink = float(np.mod(s[i + 1] - foot, curves[i + 1].length)) / reach
        scale[i + 1] = scale[i] * (shrink if 0.3 < shrink < 1.3 else 1.0)
    index = np.arange(len(curves))
    steps = np.abs(index[:, None] - index)
    even = (longest / scale * np.exp(GROWTH * steps)).min(axis=1) * scale
    return np.minimum(even, [SHARE_OF_TURN * curve.length for curve in curves])


def _corners(curve: Curve, stepover: float) -> Array:
    """Arc lengths of the points at which a closed curve turns sharply [m]."""
    reach = 0.25 * stepover
    count = max(int(curve.length / (0.25 * reach)), 8)
    s = np.linspace(0.0, curve.length, count, endpoint=False)
    ahead, behind = curve.tangents(s + 0.5 * reach, 0.5 * reach), curve.tangents(s - 0.5 * reach, 0.5 * reach)
    return s[(ahead * behind).sum(axis=1) < np.cos(CORNER)]
