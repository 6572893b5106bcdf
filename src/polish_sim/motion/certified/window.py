"""How every corner is passed: least time over the window, by dynamic programming (layer 6).

A corner has a few states, from an exact stop (state 0) to its full kernel. The least time to every state of the newest
corner follows from those of the corner before and the fastest connectors between them. The best way to a stop at the
end of the newest line decides on the oldest open corner.

Never slower than exact stops: the way "as decided so far, then stop at every corner" is always among those compared,
so that one more line adds at most its own time from rest to rest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.buffers import ACCELERATION, DURATION, SIZE, SPEED, Corners, Lines
from polish_sim.motion.certified.connector import Ends, LineLimits, connector_time

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def line_limits(lines: Lines, k: int) -> LineLimits:
    """Limits along a line."""
    return LineLimits(lines.limits[k, 0], lines.limits[k, 1], lines.limits[k, 2])


@njit(cache=True, error_model="numpy")
def limits_between(lines: Lines, k: int, first: float, second: float) -> LineLimits:
    """Limits along a line that is run into and left at these speeds."""
    row, c = lines.limits[k], 3 if first == 0.0 and second == 0.0 else 0
    return LineLimits(row[c], row[c + 1], row[c + 2])


@njit(cache=True, error_model="numpy")
def ends_between(first: Array, second: Array) -> Ends:
    """How the connector between two corners' states begins and ends."""
    return Ends(first[SPEED], first[ACCELERATION], second[SPEED], second[ACCELERATION])


@njit(cache=True, error_model="numpy")
def run_time(lines: Lines, k: int, first: Array, second: Array) -> float:
    """Time of line ``k`` between two corner states [s]; infinite if it is too short for them."""
    distance = lines.spans[k] - first[SIZE] - second[SIZE]
    # Rounding may not take a line away from two corners that share it wholly.
    if distance < -1e-15 * lines.spans[k]:
        return math.inf
    limits = limits_between(lines, k, first[SPEED], second[SPEED])
    return connector_time(ends_between(first, second), max(distance, 0.0), limits)


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def reach_corner(lines: Lines, corners: Corners, k: int) -> None:
    """Fill least times and origins of the states of corner ``k`` from those of corner ``k - 1``."""
    for j in range(corners.levels[k]):
        best, origin = math.inf, 0
        second = corners.states[k, j]
        for i in range(corners.levels[k - 1] - 1, -1, -1):
            first, cost = corners.states[k - 1, i], corners.costs[k - 1, i]
            distance = lines.spans[k - 1] - first[SIZE] - second[SIZE]
            if cost + distance / max(lines.limits[k - 1, 0], lines.limits[k - 1, 3]) >= best:
                continue
            time = cost + run_time(lines, k - 1, first, second)
            if time < best:
                best, origin = time, i
        corners.costs[k, j] = best + second[DURATION]
        corners.origins[k, j] = origin


@njit(cache=True, error_model="numpy")
def best_before_stop(lines: Lines, corners: Corners, k: int) -> int:
    """State of corner ``k`` on the fastest way to a stop at the end of line ``k``."""
    best, state = math.inf, 0
    for i in range(corners.levels[k]):
        if corners.costs[k, i] >= best:
            continue
        distance = lines.spans[k] - corners.states[k, i, SIZE]
        if distance < 0.0:
            continue
        ends = Ends(corners.states[k, i, SPEED], corners.states[k, i, ACCELERATION], 0.0, 0.0)
        time = corners.costs[k, i] + connector_time(ends, distance, limits_between(lines, k, ends.v0, 0.0))
        if time < best:
            best, state = time, i
    return state


@njit(cache=True, error_model="numpy")
def decide(corners: Corners, corner: int, last: int, state: int) -> None:
    """Decide on a corner's state: the one on the way to ``state`` of corner ``last``; ways past it are dropped."""
    for k in range(last, corner, -1):
        state = corners.origins[k, state]
    corners.chosen[corner] = state
    for i in range(corners.levels[corner]):
        if i != state:
            corners.costs[corner, i] = math.inf
    for k in range(corner + 1, last + 1):
        for i in range(corners.levels[k]):
            if math.isinf(corners.costs[k - 1, corners.origins[k, i]]):
                corners.costs[k, i] = math.inf


@njit(cache=True, error_model="numpy")
def decide_all(corners: Corners, first: int, last: int, state: int) -> None:
    """Decide on all corners from ``first`` to ``last``, which is passed in ``state``."""
    for k in range(last, first - 1, -1):
        corners.chosen[k] = state
        state = corners.origins[k, state]


@njit(cache=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def forget_past(corners: Corners, corner: int, last: int) -> None:
    """Count times from a decided corner on, so that they do not lose digits on a long path."""
    past = corners.costs[corner, corners.chosen[corner]]
    for k in range(corner, last + 1):
        for i in range(corners.levels[k]):
            corners.costs[k, i] -= past
