"""The chords of a path, each with its normals: what crossings are looked for among (runs -> Segments)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME_PLACE_M = 1e-6
"""Points closer than this are the same place [m]."""


class Segments(NamedTuple):
    """All chords of all runs."""

    start: Array
    """[m], shape (n, 3)."""
    end: Array
    start_normals: Array
    """Unit surface normals, shape (n, 3)."""
    end_normals: Array
    number: Ints
    """Follow each other by one only where segments share a point, shape (n,)."""


def segments_of(runs: Sequence[Curve]) -> Segments:
    """All chords of open curves, those of no length left out."""
    start, end = (np.concatenate([curve.positions[cut] for curve in runs]) for cut in (np.s_[:-1], np.s_[1:]))
    first, last = (np.concatenate([curve.normals[cut] for curve in runs]) for cut in (np.s_[:-1], np.s_[1:]))
    gap = np.repeat(2 * np.arange(len(runs)), [len(curve.positions) - 1 for curve in runs])
    kept = np.linalg.norm(end - start, axis=1) > 0.0
    number = np.arange(len(start)) + gap
    return Segments(start[kept], end[kept], first[kept], last[kept], number[kept])
