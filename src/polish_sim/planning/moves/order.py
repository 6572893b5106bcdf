"""In which order, and which way round, the runs of a path are walked so that the air moves are short."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

WINDOW = 60
"""Only so many neighbours in the order change places with one another: time stays proportional to their number."""
MOST_SWEEPS = 40
LEAST_GAIN_M = 1e-6
"""A change that shortens the way by less is left alone: rounding must not choose."""


class Tour(NamedTuple):
    """An order of blocks."""

    order: Ints
    """Which block comes k-th, shape (n,)."""
    backwards: NDArray[np.bool_]
    """Whether the k-th block is walked from its end, shape (n,)."""
    air_m: float
    """Length of the straight ways from block to block [m]."""


def order_blocks(ends: Array, free: bool, start: Array | None = None) -> Tour:
    """Order blocks so that the way from the end of each to the beginning of the next is short overall.

    Nearest neighbour first, then stretches of the order are turned round (2-opt) and single blocks moved (or-opt)
    as long as that helps. The first block stays the first: the given one, or the one at the start asked for.

    Args:
        ends: Where each block begins and ends [m], shape (n, 2, 3).
        free: Whether a block may be walked from its end.
        start: Point the first block is to begin at, about [m], shape (3,); None: the first block given, as it is.

    Returns:
        The tour.
    """
    order, flips = _nearest_neighbours(ends, free, start)
    _improve(np.ascontiguousarray(ends), order, flips, free, WINDOW, MOST_SWEEPS)
    return Tour(order, flips.astype(bool), float(_way(ends, order, flips, 0, len(order) - 1)))


def _nearest_neighbours(ends: Array, free: bool, start: Array | None) -> tuple[Ints, Ints]:
    """Each block followed by the one that begins nearest."""
    waiting = np.ones(len(ends), dtype=bool)
    order, flips = np.zeros(len(ends), np.int64), np.zeros(len(ends), np.int64)
    here = ends[0, 0] if start is None else start
    for k in range(len(ends)):
        away = np.linalg.norm(ends - here, axis=2)
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


@njit(cache=True, error_model="numpy")
def _way(ends: Array, order: Ints, flips: Ints, first: int, last: int) -> float:
    """Length of the ways between the blocks from the first place to the last [m]."""
    total = 0.0
    for k in range(first, last):
        a, b = ends[order[k], 1 - flips[k]], ends[order[k + 1], flips[k + 1]]
        total += np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    return total


@njit(cache=True, error_model="numpy")
def _turn_round(order: Ints, flips: Ints, i: int, j: int, free: bool) -> None:
    """Walk the blocks from place i to place j in the opposite order, each from its other end if that is free."""
    while i < j:
        order[i], order[j] = order[j], order[i]
        flips[i], flips[j] = flips[j], flips[i]
        if free:
            flips[i], flips[j] = 1 - flips[i], 1 - flips[j]
        i += 1
        j -= 1
    if i == j and free:
        flips[i] = 1 - flips[i]


@njit(cache=True, error_model="numpy")
def _shift(order: Ints, flips: Ints, i: int, j: int) -> None:
    """Move the block at place i to place j."""
    block, flip = order[i], flips[i]
    step = 1 if j > i else -1
    for k in range(i, j, step):
        order[k], flips[k] = order[k + step], flips[k + step]
    order[j], flips[j] = block, flip


@njit(cache=True, error_model="numpy")
def _improve(ends: Array, order: Ints, flips: Ints, free: bool, window: int, sweeps: int) -> None:
    """Turn stretches round and move blocks while that shortens the way; the first place stays."""
    n = len(order)
    for _ in range(sweeps):
        better = False
        for i in range(1, n):
            for j in range(max(1, i - window), min(n, i + window + 1)):
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
