"""What the look-ahead keeps: a few hundred segments and corners, moved to the front when full (layer 6).

Its sizes are compiled into every `njit(...)` kernel of the stream.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.certified.corner_shapes import PIECES
from polish_sim.motion.rules.chain import Chain

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LOOKAHEAD = 8
"""A line of segments is given out once so many lines after it are known."""
CAPACITY = 448
"""Segments the buffers hold."""
MOST_STRUNG = 12
"""Most segments a line has."""
FULL_LEVELS, LEVELS = 4, 8
"""States a corner may be passed in: first exact stop to full kernel, then plain kernels up to their largest."""
SIZE, SPEED, ACCELERATION, DURATION = 0, 1, 2, 3
"""What a state says of a corner: how much of either segment it takes [m], speed and acceleration there, its time."""


class Segments(NamedTuple):
    """The merged chain as far as it is kept, and what may be done along each of its segments."""

    chain: Chain
    spans: Array
    """Generalised length l of each segment [m]: of the tip, or of a turn worth as much time, shape (CAPACITY,)."""
    limits: Array
    """Speed, acceleration and jerk along l [m/s, m/s^2, m/s^3], then those from rest to rest, shape (CAPACITY, 6)."""
    bends: Array
    """Length [m] and largest speed [m/s] of the bend before each segment, shape (CAPACITY, 2)."""
    used: Array
    """What merging has used of tip and axis tolerance [m, rad], shape (CAPACITY, 2)."""
    raw_ends: Indices
    """Number of the way point each segment ends at, shape (CAPACITY,)."""


class Lines(NamedTuple):
    """Line k strings segments first[k] to first[k + 1] - 1 together; often it is just one."""

    first: Indices
    """Shape (CAPACITY + 1,)."""
    spans: Array
    """Generalised length [m], shape (CAPACITY,)."""
    limits: Array
    """Speed, acceleration and jerk of the law along it [m/s, m/s^2, m/s^3], then those from rest to rest,
    shape (CAPACITY, 6)."""
    rooms: Array
    """What corners may take of its start and of its end [m], shape (CAPACITY, 2)."""


class Corners(NamedTuple):
    """Corner k lies between lines k - 1 and k."""

    durations: Array
    """Of the full kernel's pieces [s], shape (CAPACITY, PIECES)."""
    remaining: Array
    """Their cubics: what is left of the old segment [m], shape (CAPACITY, PIECES, 4)."""
    gone: Array
    """Their cubics: what is gone of the new segment [m], shape (CAPACITY, PIECES, 4)."""
    scales: Array
    """Scale of the kernel in each state: sizes grow as its cube, times as itself; negative for the plain kernel,
    shape (CAPACITY, LEVELS)."""
    slowdowns: Array
    """Factor on its times beyond that, shape (CAPACITY, LEVELS)."""
    states: Array
    """SIZE, SPEED, ACCELERATION and DURATION of each state, shape (CAPACITY, LEVELS, 4)."""
    levels: Indices
    """Number of states in use, shape (CAPACITY,)."""
    costs: Array
    """Least time up to the end of a corner passed in a state; infinite if it cannot be, shape (CAPACITY, LEVELS)."""
    origins: Indices
    """State of the corner before on the way there, shape (CAPACITY, LEVELS)."""
    chosen: Indices
    """The state that is decided on, -1 before that, shape (CAPACITY,)."""


def new_segments() -> Segments:
    """Buffers without a segment."""
    n = CAPACITY
    chain = Chain(
        tips=np.zeros((n + 1, 3)), axes=np.zeros((n + 1, 3)), rotations=np.zeros((n + 1, 3, 3)),
        lengths=np.zeros(n), directions=np.zeros((n, 3)), angles=np.zeros(n), turn_axes=np.zeros((n, 3)),
        rolls=np.zeros(n),
    )  # fmt: skip
    return Segments(
        chain, np.zeros(n), np.zeros((n, 6)), np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n, dtype=np.int64)
    )


def new_lines() -> Lines:
    """Buffers without a line."""
    n = CAPACITY
    return Lines(np.zeros(n + 1, dtype=np.int64), np.zeros(n), np.zeros((n, 6)), np.zeros((n, 2)))


def new_corners() -> Corners:
    """Buffers without a corner; the path begins at rest at corner 0."""
    n = CAPACITY + 1
    corners = Corners(
        durations=np.zeros((n, PIECES)), remaining=np.zeros((n, PIECES, 4)), gone=np.zeros((n, PIECES, 4)),
        scales=np.zeros((n, LEVELS)), slowdowns=np.ones((n, LEVELS)),
        states=np.zeros((n, LEVELS, 4)), levels=np.ones(n, dtype=np.int64), costs=np.full((n, LEVELS), np.inf),
        origins=np.zeros((n, LEVELS), dtype=np.int64), chosen=np.full(n, -1, dtype=np.int64),
    )  # fmt: skip
    corners.costs[0, 0] = 0.0
    corners.chosen[0] = 0
    return corners
