"""What CAM paths say by RAPID and feed: segments, strokes and feeds of their points (readers' rows -> columns)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.toolpath import PROCESS, RETRACT

Array = NDArray[np.float64]
Codes = NDArray[np.int8]


def with_retract(segment: Codes) -> Codes:
    """The segments (n,) with retract after the last process point, of which there is one at least."""
    last = int(np.flatnonzero(segment == PROCESS)[-1])
    return np.where(np.arange(len(segment)) > last, np.int8(RETRACT), segment)


def numbered_strokes(segment: Codes) -> NDArray[np.int64]:
    """Number of the stroke of every point, (n,): a new one begins where the tool comes down from the air."""
    down = (segment[1:] == PROCESS) & (segment[:-1] != PROCESS)
    begins = np.concatenate([[False], down])
    begins[int(np.flatnonzero(segment == PROCESS)[0])] = False
    return np.cumsum(begins).astype(np.int64)


def feeds_from_first(feed: Array) -> Array | None:
    """Feed at every point (n,) from feeds that are NaN before the first one: that one holds; None if there is none."""
    known = np.flatnonzero(np.isfinite(feed))
    if not len(known):
        return None
    return np.where(np.arange(len(feed)) < known[0], feed[known[0]], feed)
