"""The lifted tool: what it keeps clear of, its way from stroke to stroke, and the order of strokes in which
these ways are short."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools, Indices, norms, perpendicular, turned, unit
from polish_sim.geometry import Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, minus
from polish_sim.planning.quality.tool_room import CHECKED_APART, Places, Tool
from polish_sim.planning.toolpath import APPROACH, ToolPath, arc_length, rows_apart

KEPT = 0.7  #: Share of the clearance the travelling tool keeps from the part
KEPT_LOW = 0.9  #: Where it was lifted less than that: share of the height it had then
APART_M = 3e-4  #: In the air the tool point keeps this far from the part, but at most half its height [m]
SPACING_M = 1e-3  #: Of points in the air [m]


class Move(NamedTuple):
    """A piece of the tool path, column by column."""

    positions: Array  #: Tool points [m], shape (n, 3)
    axes: Array  #: Unit tool axes, shape (n, 3)
    segment: NDArray[np.int8]  #: Codes of the segments, shape (n,)
    pass_index: Indices  #: Shape (n,)


def move_in(segment: int, positions: Array, axes: Array, passes: int | Indices) -> Move:
    """A piece in one segment; one axis (3,), or one number of a pass, holds for all its points."""
    count = len(positions)
    codes = np.full(count, segment, np.int8)
    return Move(positions, np.broadcast_to(axes, (count, 3)), codes, np.full(count, passes))


def move_of(path: ToolPath) -> Move:
    """A whole path as a piece."""
    return Move(path.positions_work, path.axes_work, path.segment, path.pass_index)


def path_of(move: Move, *columns: Any) -> ToolPath:
    """The path of a piece, with its curvature and, if they are its own, forces and feeds."""
    s = arc_length(move.positions)
    return ToolPath(move.positions, move.axes, s, move.pass_index, move.segment, *columns)


class AirSpace(NamedTuple):
    """What the lifted tool must keep clear of."""

    part: Surface  #: The whole part, in its fixture if it has one
    clearance: float  #: Height of a lifted tool above the part along its axis [m]
    up: Array  #: Unit vector away from the table, shape (3,)
    tool: Tool | None = None  #: What stands behind the tool point; None looks at that alone
    alone: Surface | None = None  #: The part without a fixture, if it has one: the tool knows that by itself

    @property
    def radius(self) -> float:
        """Radius of the ball about the part's middle outside which the tool travels freely [m]: the part, and
        half as much again as the clearance."""
        return self.part.radius + 1.5 * self.clearance

    def has_room(self, line: Array, axes: Array, presses: Places | None = None) -> bool:
        """Whether the tool is nowhere in the part along points (n, 3), pressed as it is at a place or not at
        all."""
        if self.tool is None:
            return True
        rows = rows_apart(arc_length(line), CHECKED_APART * self.tool.pad.radius_m)
        low, yields = (presses.lows[0], presses.yields[0]) if presses else (APART_M, 0.0)
        places = Places(line[rows], axes[rows], np.full(len(rows), low), np.full(len(rows), yields))
        return not self.tool.stands_in(self.alone or self.part, places).depths.any()

    def height_to_keep(self, tops: Array) -> float:
        """Distance from the part a tool keeps that travels from or to places (n, 3) [m]."""
        return min(KEPT * self.clearance, KEPT_LOW * signed_distances(self.part, tops).min())


def evenly(first: float, last: float, length: float) -> Array:
    """Values from first to last, about `SPACING_M` apart over a length."""
    return np.linspace(first, last, max(int(np.ceil(length / SPACING_M)), 2) + 1)


LEVELS = 5  #: Heights tried between the lifted tool's own and one above everything, the lowest first
ROUND = 24  #: Corners of a way round the part


def travel(first: Move, second: Move, air: AirSpace) -> Move | None:
    """Carry the lifted tool from one run to the next, no higher than the part between makes it.

    Returns the points between, as approach to the second run; None if none of the ways keeps clear of the
    part.
    """
    ends = np.stack([first.positions[-1], second.positions[0]])
    axes = first.axes[-1], second.axes[0]
    kept = air.height_to_keep(ends)
    for corners in _ways(ends, axes, air) if kept > 0.0 else ():
        line = _along(corners)
        turning = turn_between(*axes, np.linspace(0.0, 1.0, len(line)))
        if signed_distances(air.part, line).min() >= kept and air.has_room(line, turning):
            # Both ends belong to the moves before and after.
            return move_in(APPROACH, line[1:-1], turning[1:-1], second.pass_index[0])
    return None


def _ways(ends: Array, axes: tuple[Array, Array], air: AirSpace) -> Iterator[Sequence[Array]]:
    """Corners of the ways to try between two places (2, 3) [m]: at rising heights, then round the part."""
    top = (air.part.vertices @ air.up).max() + air.clearance
    low = max(end @ air.up for end in ends)
    for level in np.linspace(low, max(top, low), LEVELS):
        yield [ends[0], *(end + air.up * max(level - (end @ air.up), 0.0) for end in ends), ends[1]]
    yield _round(ends, axes, air)


def _round(ends: Array, directions: tuple[Array, Array], air: AirSpace) -> list[Array]:
    """Straight out to the ball around the part, over it, and in again."""
    middle = air.part.middle
    outside = [_leave(end - middle, way, air.radius) for end, way in zip(ends, directions, strict=True)]
    first, second = (unit(point) for point in outside)
    reach = max(air.radius, *(np.linalg.norm(point) for point in outside))
    # A chord between corners must not cut into the ball.
    arc = (
        reach / np.cos(0.5 * np.pi / (ROUND - 1)) * turn_between(first, second, np.linspace(0.0, 1.0, ROUND))
    )
    return [ends[0], middle + outside[0], *(middle + arc), middle + outside[1], ends[1]]


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


def turn_between(first: Array, second: Array, share: Array) -> Array:
    """Unit vectors on the shortest turn from one to another, (k,) shares of it -> (k, 3)."""
    side = second - first * (first @ second)
    size = np.linalg.norm(side)
    if size < 1e-9:
        side = perpendicular(first)
    return turned(first, unit(side), share * np.arctan2(size, first @ second))


WINDOW = 60  #: Neighbours in the order that change places: time stays proportional to their number
MOST_SWEEPS = 40
LEAST_GAIN_M = 1e-6  #: A change that shortens the way by less is left alone: rounding must not choose


def order_blocks(ends: Array, free: bool, start: Array | None = None) -> tuple[Indices, Bools]:
    """Order blocks so that the way from the end of each to the beginning of the next is short overall.

    Nearest neighbour first, then stretches of the order are turned round (2-opt) as long as that helps. The
    first block stays the first: the given one, or the one nearest to ``start`` (3,) [m]. ``ends`` (n, 2, 3)
    [m] are where each block begins and ends; those that are ``free`` may be walked from their end.

    Returns which block comes k-th (n,), and whether it is walked from its end (n,).
    """
    order, flips = nearest_neighbours(ends, free, start)
    if len(order) > 2:
        _improve(np.ascontiguousarray(ends), order, flips, free)
    return order, flips.astype(bool)


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
        block, side = np.unravel_index(away.argmin(), away.shape)
        order[k], flips[k] = block, side
        waiting[block] = False
        here = ends[block, 1 - side]
    return order, flips


@njit
def _way(ends: Array, order: Indices, flips: Indices, first: int, last: int) -> float:
    """Length of the ways between the blocks from the first place to the last [m]."""
    total = 0.0
    for k in range(first, last):
        way = minus(ends[order[k], 1 - flips[k]], ends[order[k + 1], flips[k + 1]])
        total += np.sqrt(dot(way, way))
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
def _improve(ends: Array, order: Indices, flips: Indices, free: bool) -> None:
    """Turn stretches of the order round while that shortens the way; the first place stays."""
    n = len(order)
    for _ in range(MOST_SWEEPS):
        better = False
        for i in range(1, n):
            for j in range(i, min(n, i + WINDOW + 1)):
                last = min(j + 1, n - 1)
                before = _way(ends, order, flips, i - 1, last)
                _turn_round(order, flips, i, j, free)
                if _way(ends, order, flips, i - 1, last) < before - LEAST_GAIN_M:
                    better = True
                else:
                    _turn_round(order, flips, i, j, free)
        if not better:
            return
