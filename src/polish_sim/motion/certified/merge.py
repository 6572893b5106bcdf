"""Short chords become longer ones, with part of the tolerance (layer 6).

A run of way points is replaced by the chord between its ends while every one of them lies within a share of the
tolerance of the chord, in the order of their projections; tool axes are compared at the same places. What a chord
has not used of the tolerance is left to the corners at its ends.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

MOST_MERGED = 32
"""Most way points a chord stands for."""
WIDEST_TURN = 0.5
"""Most the tool's axis turns along a chord, and its roll [rad]."""


class Run(NamedTuple):
    """Way points since the last one that stays, oldest first."""

    tips: Array
    """[m], shape (MOST_MERGED + 1, 3)."""
    rotations: Array
    """Tool frames, shape (MOST_MERGED + 1, 3, 3)."""
    feeds: Array
    """Caps on the tip's speed on the way to them [m/s], shape (MOST_MERGED + 1,)."""


class Shares(NamedTuple):
    """What merging may use up."""

    tip: float
    """[m]."""
    axis: float
    """[rad]."""
    length: float
    """A chord and a segment are not joined if both are longer [m]."""
    turn: float
    """The same for turns of the tool's axis [rad]."""


class Deviation(NamedTuple):
    """How far a run's way points are from its chord; infinite if they are out of order along it."""

    tip: float
    """[m]."""
    axis: float
    """[rad]."""


def empty_run() -> Run:
    """A run without way points."""
    return Run(np.zeros((MOST_MERGED + 1, 3)), np.zeros((MOST_MERGED + 1, 3, 3)), np.full(MOST_MERGED + 1, np.inf))


@njit(cache=True, error_model="numpy")
def chord_deviation(run: Run, last: int) -> Deviation:
    """Distance of a run's way points from the chord between its first and its last one.

    Between way points the distance of two straight lines is largest at an end; that of two great arcs of angle t is
    at most 1 / cos(t/2) times as large as at an end (chord lengths; t is the chord's whole turn).

    Args:
        run: Way points.
        last: Index of the last one.

    Returns:
        A bound for every point of the polyline and of the chord.
    """
    length = _distance(run.tips, 0, last)
    turn = _axis_angle(run.rotations, 0, last)
    tip = axis = before = 0.0
    for i in range(1, last):
        share = _share_along(run, i, last, length, turn)
        if not before <= share <= 1.0:
            return Deviation(math.inf, math.inf)
        before = share
        tip = max(tip, _tip_distance(run.tips, i, last, share))
        axis = max(axis, _axis_distance(run.rotations, i, last, share, turn))
    widened = axis / math.cos(0.5 * turn)
    return Deviation(tip, math.asin(widened) if widened < 1.0 else math.inf)


@njit(cache=True, error_model="numpy")
def _distance(tips: Array, i: int, k: int) -> float:
    x, y, z = tips[k, 0] - tips[i, 0], tips[k, 1] - tips[i, 1], tips[k, 2] - tips[i, 2]
    return math.sqrt(x * x + y * y + z * z)


@njit(cache=True, error_model="numpy")
def _axis_angle(rotations: Array, i: int, k: int) -> float:
    """Angle between two frames' tool axes [rad]."""
    x, y, z = (rotations[k, 0, 2] - rotations[i, 0, 2], rotations[k, 1, 2] - rotations[i, 1, 2],
               rotations[k, 2, 2] - rotations[i, 2, 2])  # fmt: skip
    return 2.0 * math.asin(min(0.5 * math.sqrt(x * x + y * y + z * z), 1.0))


@njit(cache=True, error_model="numpy")
def _share_along(run: Run, i: int, last: int, length: float, turn: float) -> float:
    """Where way point ``i`` projects to, as a share of the chord: by its tip, by its axis if the tip stands still."""
    if length > 0.0:
        dot = 0.0
        for j in range(3):
            dot += (run.tips[i, j] - run.tips[0, j]) * (run.tips[last, j] - run.tips[0, j])
        return dot / (length * length)
    return _axis_angle(run.rotations, 0, i) / turn if turn > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _tip_distance(tips: Array, i: int, last: int, share: float) -> float:
    square = 0.0
    for j in range(3):
        square += (tips[i, j] - tips[0, j] - share * (tips[last, j] - tips[0, j])) ** 2
    return math.sqrt(square)


@njit(cache=True, error_model="numpy")
def _axis_distance(rotations: Array, i: int, last: int, share: float, turn: float) -> float:
    """Length of the straight line from way point ``i``'s tool axis to the chord's at a share of it [-]."""
    sine = math.sin(turn)
    first = math.sin((1.0 - share) * turn) / sine if sine > 1e-12 else 1.0 - share
    second = math.sin(share * turn) / sine if sine > 1e-12 else share
    square = 0.0
    for j in range(3):
        square += (rotations[i, j, 2] - first * rotations[0, j, 2] - second * rotations[last, j, 2]) ** 2
    return math.sqrt(square)


@njit(cache=True, error_model="numpy")
def may_join(run: Run, last: int, shares: Shares) -> bool:
    """Whether a run may be led on to its way point ``last``: one of both parts is short, turns are small."""
    if last == 1:
        return True
    if last > MOST_MERGED - 1 or run.feeds[last] != run.feeds[last - 1]:
        return False
    if not (_is_short(run, 0, last - 1, shares) or _is_short(run, last - 1, last, shares)):
        return False
    return _axis_angle(run.rotations, 0, last) < WIDEST_TURN and _frame_turn(run.rotations, last) < WIDEST_TURN


@njit(cache=True, error_model="numpy")
def _is_short(run: Run, i: int, k: int, shares: Shares) -> bool:
    return _distance(run.tips, i, k) < shares.length and _axis_angle(run.rotations, i, k) < shares.turn


@njit(cache=True, error_model="numpy")
def _frame_turn(rotations: Array, last: int) -> float:
    """Angle between the x axes of the first and the last frame [rad], which holds the roll."""
    square = 0.0
    for j in range(3):
        square += (rotations[last, j, 0] - rotations[0, j, 0]) ** 2
    return 2.0 * math.asin(min(0.5 * math.sqrt(square), 1.0))


@njit(cache=True, error_model="numpy")
def store_point(run: Run, i: int, tip: Array, rotation: Array, feed: float) -> None:
    """Write way point ``i`` of a run."""
    run.feeds[i] = feed
    for j in range(3):
        run.tips[i, j] = tip[j]
        for c in range(3):
            run.rotations[i, j, c] = rotation[j, c]


@njit(cache=True, error_model="numpy")
def joins(run: Run, last: int, shares: Shares) -> bool:
    """Whether a run may be led on to its way point ``last``."""
    if not may_join(run, last, shares):
        return False
    deviation = chord_deviation(run, last)
    return deviation.tip <= shares.tip and deviation.axis <= shares.axis
