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
from typing import Annotated, Any

from polish_sim.arrays import Array, Indices
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Record
from polish_sim.motion.certified.connector import Ends, Peaks, connector_time
from polish_sim.motion.certified.kernel import Figures, Kernel

LOOKAHEAD = 8  #: Lines that must be known after a line of segments before it is given out
CAPACITY = 448  #: Segments the buffers hold
MOST_STRUNG = 12  #: Most segments a line has
BLOCK = 128  #: Way points taken in at once: the rows they give fit the outbox, their segments the buffers
ROOM = BLOCK + (LOOKAHEAD + 2) * MOST_STRUNG  #: Segments the outbox holds
FULL_LEVELS, LEVELS = 4, 8  #: States of a corner: exact stop to full kernel, then plain kernels up to their largest


class Segments(Record):
    """The merged chain as far as it is kept (as `Chain`), and what may be done along each of its segments."""

    tips: Annotated[Array, (CAPACITY + 1, 3)]
    axes: Annotated[Array, (CAPACITY + 1, 3)]
    rotations: Annotated[Array, (CAPACITY + 1, 3, 3)]
    lengths: Annotated[Array, (CAPACITY,)]
    directions: Annotated[Array, (CAPACITY, 3)]
    angles: Annotated[Array, (CAPACITY,)]
    turn_axes: Annotated[Array, (CAPACITY, 3)]
    rolls: Annotated[Array, (CAPACITY,)]
    spans: Annotated[Array, (CAPACITY,)]  #: Generalised length l of each [m]: of the tip, or a turn worth as much time
    limits: Annotated[Array, (CAPACITY, 6)]
    """Speed, acceleration and jerk along l [m/s, m/s^2, m/s^3], then those from rest to rest."""
    bends: Annotated[Array, (CAPACITY, 2)]  #: Length [m] and largest speed [m/s] of the bend before each
    used: Annotated[Array, (CAPACITY, 2)]  #: What merging has used of tip and axis tolerance [m, rad]
    raw_ends: Annotated[Indices, (CAPACITY,)]  #: Number of the way point each ends at
    q: Annotated[Array, (CAPACITY + 1, 6)]  #: Joint angles at the way points [rad]


class Lines(Record):
    """Line k strings segments first[k] to first[k + 1] - 1 together; often it is just one."""

    first: Annotated[Indices, (CAPACITY + 1,)]
    spans: Annotated[Array, (CAPACITY,)]  #: Generalised length [m]
    limits: Annotated[Array, (CAPACITY, 6)]
    """Speed, acceleration and jerk of the law along it [m/s, m/s^2, m/s^3], then those from rest to rest."""
    rooms: Annotated[Array, (CAPACITY, 2)]  #: What corners may take of its start and of its end [m]


class Corners(Record):
    """Corner k lies between lines k - 1 and k."""

    kernels: Annotated[list[Kernel], (CAPACITY + 1,)]  #: The full ones
    scales: Annotated[Array, (CAPACITY + 1, LEVELS, 2)]
    """Factors on its lengths and times in each state; negative: plain kernel."""
    states: Annotated[Array, (CAPACITY + 1, LEVELS, 4)]  #: `Figures` of each state
    levels: Annotated[Indices, (CAPACITY + 1,)]  #: Number of states in use
    costs: Annotated[Array, (CAPACITY + 1, LEVELS)]  #: Least time to the end of a corner passed in a state, or infinite
    origins: Annotated[Indices, (CAPACITY + 1, LEVELS)]  #: State of the corner before on the way there
    chosen: Annotated[Indices, (CAPACITY + 1,)]  #: The state that is decided on, -1 before that


def move_to_front(segments: Segments, lines: Lines, corners: Corners, line: int, last: int) -> int:
    """Drop the lines before ``line``; ``last`` is the one that may be open. Returns how many segments were dropped."""
    moved = int(lines.first[line])
    for rows in _columns(segments):
        rows[: len(rows) - moved] = rows[moved:].copy()
    for rows in (*_columns(lines), *_columns(corners)):
        rows[: last + 1 - line] = rows[line : last + 1].copy()
    lines.first[: last + 1 - line] -= moved
    return moved


def _columns(record: Any) -> list[Any]:
    """All fields of a record."""
    return [record[name] for name in record.dtype.names]


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


@njit(cache=True, error_model="numpy", _nrt=False)
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
