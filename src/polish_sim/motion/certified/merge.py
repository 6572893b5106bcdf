"""Short chords become longer ones, with part of the tolerance.

A run of way points is replaced by the chord between its ends while every one of them lies within a share of the
tolerance of the chord, in the order of their projections; tool axes are compared at the same places. What a chord
has not used of the tolerance is left to the corners at its ends.
"""

from __future__ import annotations

import math
from typing import Annotated

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record

MOST_MERGED = 32  #: Most way points a chord stands for
WIDEST_TURN = 0.5  #: Most the tool's axis turns along a chord, and its roll [rad]


class Run(Record):
    """Way points since the last one that stays, oldest first."""

    tips: Annotated[Array, (MOST_MERGED + 1, 3)]  #: [m]
    rotations: Annotated[Array, (MOST_MERGED + 1, 3, 3)]  #: Tool frames
    feeds: Annotated[Array, (MOST_MERGED + 1,)]  #: Caps on the tip's speed on the way to them [m/s]


class Shares(Record):
    """What merging may use up."""

    tip: float  #: [m]
    axis: float  #: [rad]
    length: float  #: A chord and a segment are not joined if both are longer [m]
    turn: float  #: The same for turns of the tool's axis [rad]


@njit(cache=True, error_model="numpy", _nrt=False)
def chord_deviation(run: Run, last: int) -> tuple[float, float]:
    """Distance of a run's tips [m] and axes [rad] from the chord to its way point ``last``; infinite if out of order.

    Between way points the distance of two straight lines is largest at an end; that of two great arcs of angle t is
    at most 1 / cos(t/2) times as large as at an end (chord lengths; t is the chord's whole turn). So the result holds
    for every point of the polyline and of the chord.
    """
    length, turn = _distance(run.tips, 0, last), _turn_between(run.rotations, 0, last, 2)
    sine = math.sin(turn)
    tip = axis = before = 0.0
    for i in range(1, last):
        share = _share_along(run, i, last, length, turn)
        if not before <= share <= 1.0:
            return math.inf, math.inf
        before = share
        first = math.sin((1.0 - share) * turn) / sine if sine > 1e-12 else 1.0 - share
        second = math.sin(share * turn) / sine if sine > 1e-12 else share
        off_tip = off_axis = 0.0
        for j in range(3):
            off_tip += (run.tips[i, j] - run.tips[0, j] - share * (run.tips[last, j] - run.tips[0, j])) ** 2
            on_arc = first * run.rotations[0, j, 2] + second * run.rotations[last, j, 2]
            off_axis += (run.rotations[i, j, 2] - on_arc) ** 2
        tip, axis = max(tip, math.sqrt(off_tip)), max(axis, math.sqrt(off_axis))
    widened = axis / math.cos(0.5 * turn)
    return tip, math.asin(widened) if widened < 1.0 else math.inf


@njit(cache=True, error_model="numpy", _nrt=False)
def _distance(tips: Array, i: int, k: int) -> float:
    x, y, z = tips[k, 0] - tips[i, 0], tips[k, 1] - tips[i, 1], tips[k, 2] - tips[i, 2]
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy", _nrt=False)
def _turn_between(rotations: Array, i: int, k: int, column: int) -> float:
    """Angle between two frames' x (0) or tool axes (2) [rad]."""
    square = 0.0
    for j in range(3):
        square += (rotations[k, j, column] - rotations[i, j, column]) ** 2
    return 2.0 * math.asin(min(0.5 * math.sqrt(square), 1.0))


@njit(cache=True, error_model="numpy", _nrt=False)
def _share_along(run: Run, i: int, last: int, length: float, turn: float) -> float:
    """Where way point ``i`` projects to, as a share of the chord: by its tip, by its axis if the tip stands still."""
    if length > 0.0:
        dot = 0.0
        for j in range(3):
            dot += (run.tips[i, j] - run.tips[0, j]) * (run.tips[last, j] - run.tips[0, j])
        return dot / (length * length)
    return _turn_between(run.rotations, 0, i, 2) / turn if turn > 0.0 else 0.0


@njit(cache=True, error_model="numpy", _nrt=False)
def joins(run: Run, last: int, shares: Shares) -> bool:
    """Whether a run may be led on to its way point ``last``: one of both parts is short, turns and deviation small."""
    if last > 1:
        if last > MOST_MERGED - 1 or run.feeds[last] != run.feeds[last - 1]:
            return False
        if not (_is_short(run, 0, last - 1, shares) or _is_short(run, last - 1, last, shares)):
            return False
        if max(_turn_between(run.rotations, 0, last, 2), _turn_between(run.rotations, 0, last, 0)) >= WIDEST_TURN:
            return False
    tip, axis = chord_deviation(run, last)
    return tip <= shares.tip and axis <= shares.axis


@njit(cache=True, error_model="numpy", _nrt=False)
def _is_short(run: Run, i: int, k: int, shares: Shares) -> bool:
    return _distance(run.tips, i, k) < shares.length and _turn_between(run.rotations, i, k, 2) < shares.turn


@njit(cache=True, error_model="numpy", _nrt=False)
def store_point(run: Run, i: int, tip: Array, rotation: Array, feed: float) -> None:
    """Write way point ``i`` of a run."""
    run.feeds[i] = feed
    for j in range(3):
        run.tips[i, j] = tip[j]
        for c in range(3):
            run.rotations[i, j, c] = rotation[j, c]
