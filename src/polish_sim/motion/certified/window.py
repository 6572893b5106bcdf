"""What the look-ahead keeps, and how every corner is passed: least time over the window, by dynamic programming.

A few hundred segments, lines and corners are kept, moved to the front of their buffers when these are full; the sizes
are compiled into every kernel of the stream.

A corner has a few states, from an exact stop (state 0) to its full kernel. The least time to every state of the newest
corner follows from those of the corner before and the fastest connectors between them. The best way to a stop at the
end of the newest line decides on the oldest open corner.

Never slower than exact stops: the way "as decided so far, then stop at every corner" is always among those compared,
so that one more line adds at most its own time from rest to rest.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.connector import Ends, Peaks, connector_time
from polish_sim.motion.certified.kernel import PIECES, Figures, Kernel
from polish_sim.motion.rules.chain import Chain

LOOKAHEAD = 8  #: A line of segments is given out once so many lines after it are known
CAPACITY = 448  #: Segments the buffers hold
MOST_STRUNG = 12  #: Most segments a line has
FULL_LEVELS, LEVELS = 4, 8  #: States of a corner: exact stop to full kernel, then plain kernels up to their largest


class Segments(NamedTuple):
    """The merged chain as far as it is kept, and what may be done along each of its segments."""

    chain: Chain
    spans: Array  #: Generalised length l of each segment [m]: of the tip, or a turn worth as much time, (CAPACITY,)
    limits: Array
    """Speed, acceleration and jerk along l [m/s, m/s^2, m/s^3], then those from rest to rest, shape (CAPACITY, 6)."""
    bends: Array  #: Length [m] and largest speed [m/s] of the bend before each segment, shape (CAPACITY, 2)
    used: Array  #: What merging has used of tip and axis tolerance [m, rad], shape (CAPACITY, 2)
    raw_ends: Indices  #: Number of the way point each segment ends at, shape (CAPACITY,)
    q: Array  #: Joint angles at the way points [rad], shape (CAPACITY + 1, 6)


class Lines(NamedTuple):
    """Line k strings segments first[k] to first[k + 1] - 1 together; often it is just one."""

    first: Indices  #: Shape (CAPACITY + 1,)
    spans: Array  #: Generalised length [m], shape (CAPACITY,)
    limits: Array
    """Speed, acceleration and jerk of the law along it [m/s, m/s^2, m/s^3], then those from rest to rest,
    shape (CAPACITY, 6)."""
    rooms: Array  #: What corners may take of its start and of its end [m], shape (CAPACITY, 2)


class Corners(NamedTuple):
    """Corner k lies between lines k - 1 and k."""

    durations: Array  #: Of the full kernel's pieces [s], shape (CAPACITY + 1, PIECES)
    remaining: Array  #: Their cubics: what remains of the old segment [m], shape (CAPACITY + 1, PIECES, 4)
    gone: Array  #: Their cubics: what is gone of the new segment [m], shape (CAPACITY + 1, PIECES, 4)
    scales: Array  #: Factors on its lengths and times in each state; negative: plain kernel, (CAPACITY + 1, LEVELS, 2)
    states: Array  #: `Figures` of each state, shape (CAPACITY + 1, LEVELS, 4)
    levels: Indices  #: Number of states in use, shape (CAPACITY + 1,)
    costs: Array  #: Least time to the end of a corner passed in a state, or infinite, shape (CAPACITY + 1, LEVELS)
    origins: Indices  #: State of the corner before on the way there, shape (CAPACITY + 1, LEVELS)
    chosen: Indices  #: The state that is decided on, -1 before that, shape (CAPACITY + 1,)


def new_buffers(q_start: Array) -> tuple[Segments, Lines, Corners]:
    """Buffers of a path that begins at corner 0, at rest, with the joints at ``q_start`` [rad], shape (6,)."""
    n, m, index = CAPACITY, CAPACITY + 1, np.int64
    shapes = (m, 3), (m, 3), (m, 3, 3), n, (n, 3), n, (n, 3), n
    chain = Chain(*(np.zeros(shape) for shape in shapes))
    plain = np.zeros(n), np.zeros((n, 6)), np.zeros((n, 2)), np.zeros((n, 2))
    segments = Segments(chain, *plain, np.zeros(n, index), np.zeros((m, 6)))
    segments.q[0] = q_start
    lines = Lines(np.zeros(m, index), np.zeros(n), np.zeros((n, 6)), np.zeros((n, 2)))
    kernels = np.zeros((m, PIECES)), np.zeros((m, PIECES, 4)), np.zeros((m, PIECES, 4))
    corners = Corners(
        *kernels, np.zeros((m, LEVELS, 2)), np.zeros((m, LEVELS, 4)), np.ones(m, index), np.full((m, LEVELS), np.inf),
        np.zeros((m, LEVELS), index), np.full(m, -1, index),
    )  # fmt: skip
    corners.costs[0, 0], corners.chosen[0] = 0.0, 0
    return segments, lines, corners


def move_to_front(segments: Segments, lines: Lines, corners: Corners, line: int, last: int) -> int:
    """Drop the lines before ``line``; ``last`` is the one that may be open. Returns how many segments were dropped."""
    moved = int(lines.first[line])
    for rows in (*segments.chain, *segments[1:]):
        rows[: len(rows) - moved] = rows[moved:].copy()
    for rows in (*lines, *corners):
        rows[: last + 1 - line] = rows[line : last + 1].copy()
    lines.first[: last + 1 - line] -= moved
    return moved


@njit(cache=True, error_model="numpy", _nrt=False)
def kernel_of(corners: Corners, k: int) -> Kernel:
    """The full kernel of corner ``k``."""
    return Kernel(corners.durations[k], corners.remaining[k], corners.gone[k])


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def state_of(corners: Corners, k: int, i: int) -> Figures:
    """How corner ``k`` is passed in a state."""
    row = corners.states[k, i]
    return Figures(row[0], row[1], row[2], row[3])


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def decided(corners: Corners, k: int) -> Figures:
    """How corner ``k`` is passed in the state decided on."""
    return state_of(corners, k, corners.chosen[k])


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def set_state(corners: Corners, k: int, i: int, figures: Figures, length: float, time: float) -> None:
    """Write a state of a corner: its figures, and the factors on its kernel's lengths and times."""
    row = corners.states[k, i]
    row[0], row[1], row[2], row[3] = figures.size, figures.speed, figures.acceleration, figures.duration
    corners.scales[k, i, 0], corners.scales[k, i, 1] = length, time


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def peaks_of(rows: Array, k: int) -> Peaks:
    """Limits along a segment or a line, of ``limits``."""
    return Peaks(rows[k, 0], rows[k, 1], rows[k, 2])


@njit(cache=True, error_model="numpy", _nrt=False)
def limits_between(lines: Lines, k: int, first: float, second: float) -> Peaks:
    """Limits along a line that is entered and left at these speeds."""
    row, c = lines.limits[k], 3 if first == 0.0 and second == 0.0 else 0
    return Peaks(row[c], row[c + 1], row[c + 2])


@njit(cache=True, error_model="numpy", _nrt=False)
def run_time(lines: Lines, k: int, first: Figures, second: Figures) -> float:
    """Time of line ``k`` between two corners' kernels [s]; infinite if it is too short for them."""
    distance = lines.spans[k] - first.size - second.size
    # Rounding may not take a line away from two corners that share it wholly.
    if distance < -1e-15 * lines.spans[k]:
        return math.inf
    ends = Ends(first.speed, first.acceleration, second.speed, second.acceleration)
    return connector_time(ends, max(distance, 0.0), limits_between(lines, k, first.speed, second.speed))


@njit(cache=True, error_model="numpy", _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def reach_corner(lines: Lines, corners: Corners, k: int) -> None:
    """Fill least times and origins of the states of corner ``k`` from those of corner ``k - 1``."""
    for j in range(corners.levels[k]):
        best, origin = math.inf, 0
        second = state_of(corners, k, j)
        for i in range(corners.levels[k - 1] - 1, -1, -1):
            first, cost = state_of(corners, k - 1, i), corners.costs[k - 1, i]
            distance = lines.spans[k - 1] - first.size - second.size
            if cost + distance / max(lines.limits[k - 1, 0], lines.limits[k - 1, 3]) >= best:
                continue
            time = cost + run_time(lines, k - 1, first, second)
            if time < best:
                best, origin = time, i
        corners.costs[k, j] = best + second.duration
        corners.origins[k, j] = origin


@njit(cache=True, error_model="numpy", _nrt=False)
def best_before_stop(lines: Lines, corners: Corners, k: int) -> int:
    """State of corner ``k`` on the fastest way to a stop at the end of line ``k``."""
    best, state = math.inf, 0
    for i in range(corners.levels[k]):
        if corners.costs[k, i] < best:
            time = corners.costs[k, i] + run_time(lines, k, state_of(corners, k, i), Figures(0.0, 0.0, 0.0, 0.0))
            if time < best:
                best, state = time, i
    return state


@njit(cache=True, error_model="numpy", _nrt=False)
def decide(corners: Corners, corner: int, last: int, state: int) -> None:
    """Decide on a corner's state: the one on the way to ``state`` of corner ``last``; ways past it are dropped.

    Times are counted from the decided corner on, so that they do not lose digits on a long path.
    """
    for k in range(last, corner, -1):
        state = corners.origins[k, state]
    corners.chosen[corner] = state
    past = corners.costs[corner, state]
    for i in range(corners.levels[corner]):
        if i != state:
            corners.costs[corner, i] = math.inf
    for k in range(corner + 1, last + 1):
        for i in range(corners.levels[k]):
            if math.isinf(corners.costs[k - 1, corners.origins[k, i]]):
                corners.costs[k, i] = math.inf
    for k in range(corner, last + 1):
        for i in range(corners.levels[k]):
            corners.costs[k, i] -= past


@njit(cache=True, error_model="numpy", _nrt=False)
def decide_all(corners: Corners, first: int, last: int, state: int) -> None:
    """Decide on all corners from ``first`` to ``last``, which is passed in ``state``."""
    for k in range(last, first - 1, -1):
        corners.chosen[k] = state
        state = corners.origins[k, state]
