"""The lifted tool's way from one run to the next, clear of the part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry import Surface
from polish_sim.geometry.distance.signed_distance import signed_distances
from polish_sim.planning.moves.approach import Move, evenly
from polish_sim.planning.moves.way_out import Ball, ball_around, height_to_keep, way_out
from polish_sim.planning.toolpath import APPROACH
from polish_sim.spatial import perpendicular, unit

Array = NDArray[np.float64]

LEVELS = 5
"""So many heights between the lifted tool's own and one above everything are tried, the lowest first."""
ROUND = 24
"""Corners of a way round the part."""


def travel(first: Move, second: Move, up: Array, clearance: float, part: Surface) -> tuple[Move, bool]:
    """Carry the lifted tool from one run to the next, no higher than the part between makes it.

    Args:
        first: The retract that ends the first run.
        second: The approach that begins the second.
        up: Unit vector away from the table, shape (3,).
        clearance: Height a lifted tool has above the part [m].
        part: The whole part.

    Returns:
        The points between, as approach to the second run, and whether they keep clear of the part.
    """
    start, end = first.positions[-1], second.positions[0]
    kept = height_to_keep(part, np.stack([start, end]), clearance)
    clear, line = False, np.empty((0, 3))
    for corners in _ways((start, end), (first.axes[-1], second.axes[0]), up, clearance, part, kept):
        line = _along(corners)
        clear = kept > 0.0 and bool(signed_distances(part, line).min() >= kept)
        if clear:
            break
    # Both ends belong to the moves before and after.
    line = line[1:-1]
    axes = _turned(first.axes[-1], second.axes[0], np.linspace(0.0, 1.0, len(line) + 2)[1:-1])
    return Move(line, axes, APPROACH, np.full(len(line), second.pass_index[0])), clear


def _ways(
    ends: tuple[Array, Array], axes: tuple[Array, Array], up: Array, clearance: float, part: Surface, kept: float
) -> Iterator[Sequence[Array]]:
    """Corners of the ways to try: at rising heights, then round the part, last above everything whatever it hits."""
    start, end = ends
    top = float((part.vertices @ up).max()) + clearance
    low = max(float(start @ up), float(end @ up))
    for level in np.linspace(low, max(top, low), LEVELS):
        yield _over(start, end, up, float(level))
    ball = ball_around(part, clearance)
    yield _round(ends, axes, ball)
    out = [way_out(part, ball, end, axis, up, kept) for end, axis in zip(ends, axes, strict=True)]
    if out[0] is not None and out[1] is not None:
        yield _round(ends, (out[0], out[1]), ball)
    yield _over(start, end, up, max(top, low))


def _over(start: Array, end: Array, up: Array, level: float) -> list[Array]:
    return [start, *(point + up * max(level - float(point @ up), 0.0) for point in (start, end)), end]


def _round(ends: tuple[Array, Array], directions: tuple[Array, Array], ball: Ball) -> list[Array]:
    """Straight out to a ball around the part, over it, and in again."""
    outside = [_leave(end - ball.middle, way, ball.radius) for end, way in zip(ends, directions, strict=True)]
    first, second = (unit(point) for point in outside)
    reach = max(ball.radius, *(float(np.linalg.norm(point)) for point in outside))
    # A chord between corners must not cut into the ball.
    arc = reach / np.cos(0.5 * np.pi / (ROUND - 1)) * _turned(first, second, np.linspace(0.0, 1.0, ROUND))
    return [ends[0], ball.middle + outside[0], *(ball.middle + arc), ball.middle + outside[1], ends[1]]


def _leave(point: Array, axis: Array, radius: float) -> Array:
    """Where a line from a point along an axis leaves a ball about the origin; the point itself if it is outside."""
    inner = float(point @ axis)
    under = inner**2 - float(point @ point) + radius**2
    return point + axis * max(np.sqrt(under) - inner, 0.0) if under > 0.0 else point


def _along(corners: Sequence[Array]) -> Array:
    """Points about a millimetre apart from corner to corner, both ends included, (n, 3)."""
    legs = [corners[0][None]]
    for a, b in pairwise(corners):
        length = float(np.linalg.norm(b - a))
        if length > 1e-9:
            legs.append(a + evenly(0.0, 1.0, length)[1:, None] * (b - a))
    return np.concatenate(legs)


def _turned(first: Array, second: Array, share: Array) -> Array:
    """Unit vectors on the shortest turn from one to another, (k,) shares of it -> (k, 3)."""
    side = second - first * (first @ second)
    size = float(np.linalg.norm(side))
    if size < 1e-9:
        side = perpendicular(first)
    angle = share * np.arctan2(size, first @ second)
    return np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * unit(side)
