"""What a stream of way points remembers, and what it has ready (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.certified.buffers import (
    LOOKAHEAD,
    MOST_STRUNG,
    Corners,
    Lines,
    Segments,
    new_corners,
    new_lines,
    new_segments,
)
from polish_sim.motion.certified.emit import KERNEL_ROWS, SEGMENT_ROWS, Pen, new_pen
from polish_sim.motion.certified.merge import Run, empty_run
from polish_sim.motion.certified.robot import Robot, new_robot
from polish_sim.motion.rules.limits import Arm

Array = NDArray[np.float64]

BLOCK = 128
"""Way points taken in at once: what they give fits the outbox."""
HELD, RAW, LAST, RAW_END, SEGMENTS, FIRST, LINES, OPEN, GIVEN, OUT_SEGMENTS, OUT_ROWS, RELAID, STATUS = range(13)
"""Counters: way points in the run; taken in; the run's last one, and its number of all; segments in the buffers;
number of the buffers' first one; closed lines in the buffers; whether one is open; next line to give; segments and rows
in the outbox; laws laid anew; what went wrong, 0 if nothing."""
COUNTERS = 13
NO_LAW = 9
"""Status: no law was found that keeps a line's bends in their limits."""
_ROOM = BLOCK + (LOOKAHEAD + 2) * MOST_STRUNG


class Outbox(NamedTuple):
    """What is ready and not yet taken away."""

    tips: Array
    """Way points the segments end at [m], shape (m, 3)."""
    rotations: Array
    """Tool frames there, shape (m, 3, 3)."""
    raw_ends: NDArray[np.int64]
    """Their numbers among the way points taken in, shape (m,)."""
    pen: Pen
    """With the rows of their schedule."""


class Stream(NamedTuple):
    """All a stream remembers."""

    counters: NDArray[np.int64]
    clock: Array
    """When the corner behind the next segment to give begins [s], shape (1,)."""
    run: Run
    segments: Segments
    lines: Lines
    corners: Corners
    outbox: Outbox
    robot: Robot


def new_stream(arm: Arm) -> Stream:
    """A stream before its first way point."""
    pen = new_pen(_ROOM * (SEGMENT_ROWS + KERNEL_ROWS))
    outbox = Outbox(np.zeros((_ROOM, 3)), np.zeros((_ROOM, 3, 3)), np.zeros(_ROOM, dtype=np.int64), pen)
    return Stream(
        np.zeros(COUNTERS, dtype=np.int64),
        np.zeros(1),
        empty_run(),
        new_segments(),
        new_lines(),
        new_corners(),
        outbox,
        new_robot(arm),
    )
