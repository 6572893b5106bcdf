"""When each segment of a chain is passed: its progress as cubic pieces of time (layer 6).

Every rule answers in this form: FIR-filtered boxes are piecewise cubic, corners of piecewise constant jerk too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Schedule(NamedTuple):
    """Progress of every segment over time: 0 before its first piece, 1 after its last, cubic in each.

    Segments overlap at corners: while segment k comes to its end, k + 1 already begins. The tip is the first way
    point plus the sum of ``progress * length * direction``; the tool's rotation is composed in the same order,
    ``... exp(b n_2) exp(a n_1) R_0``, later segments on the left, rolls added up.
    """

    segments: NDArray[np.int64]
    """Segment each piece belongs to, not falling, shape (m,)."""
    starts: Array
    """When each piece begins [s], rising within a segment, shape (m,)."""
    durations: Array
    """[s], shape (m,); a segment's pieces follow one another without a gap."""
    coefficients: Array
    """Progress c0 + c1 t + c2 t^2 + c3 t^3 with t from the piece's start, shape (m, 4)."""
    end: float
    """When the last segment has arrived [s]: the cycle time."""
