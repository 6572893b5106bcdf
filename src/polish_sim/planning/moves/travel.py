"""The lifted tool's way from one run to the next, clear of the part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices, norms
from polish_sim.geometry import Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.kernel_cache import njit
from polish_sim.planning.moves.leads import AirSpace, Ball, Move, ball_around, evenly, height_to_keep, way_out
from polish_sim.planning.toolpath import APPROACH
from polish_sim.spatial import perpendicular, unit

LEVELS = 5  #: Heights tried between the lifted tool's own and one above everything, the lowest first
ROUND = 24  #: Corners of a way round the part


def travel(first: Move, second: Move, air: AirSpace) -> tuple[Move, bool]:
    """Carry the lifted tool from one run to the next, no higher than the part between makes it.

    Returns the points between, as approach to the second run, and whether they keep clear of the part.
    """
    up, clearance, part = air.up, air.clearance, air.part
    start, end = first.positions[-1], second.positions[0]
    kept = height_to_keep(part, np.stack([start, end]), clearance)
    clear, line, axes = False, np.empty((0, 3)), np.empty((0, 3))
    for corners in _ways((start, end), (first.axes[-1], second.axes[0]), up, clearance, part, kept):
        line = _along(corners)
        axes = turned(first.axes[-1], second.axes[0], np.linspace(0.0, 1.0, len(line)))
        clear = kept > 0.0 and bool(signed_distances(part, line).min() >= kept) and air.has_room(line, axes)
        if clear:
            break
    # Both ends belong to the moves before and after.
    line, axes = line[1:-1], axes[1:-1]
    return Move(line, axes, APPROACH, np.full(len(line), second.pass_index[0])), clear


def _ways(
    ends: tuple[Array, Array],
    axes: tuple[Array, Array],
    up: Array,
    clearance: float,
    part: Surface,
    kept: float,
) -> Iterator[Sequence[Array]]:
    """Corners of the ways to try: at rising heights, then round the part, last above everything,
    unchecked."""
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
    arc = reach / np.cos(0.5 * np.pi / (ROUND - 1)) * turned(first, second, np.linspace(0.0, 1.0, ROUND))
    return [ends[0], ball.middle + outside[0], *(ball.middle + arc), ball.middle + outside[1], ends[1]]


def _leave(point: Array, axis: Array, radius: float) -> Array:
    """Where a line from a point along an axis leaves a ball about the origin; the point itself if it is
    outside."""
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


def turned(first: Array, second: Array, share: Array) -> Array:
    """Unit vectors on the shortest turn from one to another, (k,) shares of it -> (k, 3)."""
    side = second - first * (first @ second)
    size = float(np.linalg.norm(side))
    if size < 1e-9:
        side = perpendicular(first)
    angle = share * np.arctan2(size, first @ second)
    return np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * unit(side)


# In which order, and which way round, the runs of a path are walked so that the air moves are short.

WINDOW = 60  #: Neighbours in the order that change places: time stays proportional to their number
MOST_SWEEPS = 40
LEAST_GAIN_M = 1e-6  #: A change that shortens the way by less is left alone: rounding must not choose


class Tour(NamedTuple):
    """An order of blocks."""

    order: Indices  #: Which block comes k-th, shape (n,)
    backwards: Bools  #: Whether the k-th block is walked from its end, shape (n,)


def order_blocks(ends: Array, free: bool, start: Array | None = None) -> Tour:
    """Order blocks so that the way from the end of each to the beginning of the next is short overall.

    Nearest neighbour first, then stretches of the order are turned round (2-opt) and single blocks moved
    (or-opt) as long as that helps. The first block stays the first: the given one, or the one nearest to
    ``start`` (3,) [m]. ``ends`` (n, 2, 3) [m] are where each block begins and ends; those that are ``free``
    may be walked from their end.
    """
    order, flips = nearest_neighbours(ends, free, start)
    if len(order) > 2:
        _improve(np.ascontiguousarray(ends), order, flips, free)
    return Tour(order, flips.astype(bool))


def nearest_neighbours(ends: Array, free: bool, start: Array | None) -> tuple[Indices, Indices]:
    """Each block followed by the one that begins nearest."""
    waiting = np.ones(len(ends), dtype=bool)
    order, flips = np.zeros(len(ends), np.int64), np.zeros(len(ends), np.int64)
    here = ends[0, 0] if start is None else start
    for k in range(len(ends)):
        away = norms(ends - here)
        away[~waiting] = np.inf
        # The first block of all begins where it was meant to unless a start is asked for.
        if not free or (k == 0 and start is None):
            away[:, 1] = np.inf
        if k == 0 and start is None:
            away[1:] = np.inf
        block, side = np.unravel_index(int(away.argmin()), away.shape)
        order[k], flips[k] = block, side
        waiting[block] = False
        here = ends[block, 1 - side]
    return order, flips


@njit
def _way(ends: Array, order: Indices, flips: Indices, first: int, last: int) -> float:
    """Length of the ways between the blocks from the first place to the last [m]."""
    total = 0.0
    for k in range(first, last):
        a, b = ends[order[k], 1 - flips[k]], ends[order[k + 1], flips[k + 1]]
        total += np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    return total


@njit
def _turn_round(order: Indices, flips: Indices, i: int, j: int, free: bool) -> None:
    """Walk the blocks from place i to place j in the opposite order, each from its other end if that is
    free."""
    while i < j:
        order[i], order[j] = order[j], order[i]
        flips[i], flips[j] = flips[j], flips[i]
        if free:
            flips[i], flips[j] = 1 - flips[i], 1 - flips[j]
        i += 1
        j -= 1
    if i == j and free:
        flips[i] = 1 - flips[i]


@njit
def _shift(order: Indices, flips: Indices, i: int, j: int) -> None:
    """Move the block at place i to place j."""
    block, flip = order[i], flips[i]
    step = 1 if j > i else -1
    for k in range(i, j, step):
        order[k], flips[k] = order[k + step], flips[k + step]
    order[j], flips[j] = block, flip


@njit
def _improve(ends: Array, order: Indices, flips: Indices, free: bool) -> None:
    """Turn stretches round and move blocks while that shortens the way; the first place stays."""
    n = len(order)
    for _ in range(MOST_SWEEPS):
        better = False
        for i in range(1, n):
            for j in range(max(1, i - WINDOW), min(n, i + WINDOW + 1)):
                first, last = min(i, j) - 1, min(max(i, j) + 1, n - 1)
                before = _way(ends, order, flips, first, last)
                if j >= i:
                    _turn_round(order, flips, i, j, free)
                    if _way(ends, order, flips, first, last) < before - LEAST_GAIN_M:
                        better = True
                        continue
                    _turn_round(order, flips, i, j, free)
                if j != i:
                    _shift(order, flips, i, j)
                    if _way(ends, order, flips, first, last) < before - LEAST_GAIN_M:
                        better = True
                        continue
                    _shift(order, flips, j, i)
        if not better:
            return
