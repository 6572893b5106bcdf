"""The stretches of a path in contact as one set of arrays, read anywhere along them (runs -> Strands)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curves.curve import Curve
from polish_sim.spatial import unit

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_BETWEEN = 1.0
"""Length left between runs on the common scale [m], so that none reads into the next."""


class Samples(NamedTuple):
    """Evenly spaced points of all runs, run after run."""

    run: Ints
    """Which run, shape (n,)."""
    s: Array
    """Arc length from the run's start [m], shape (n,)."""
    points: Array
    """[m], shape (n, 3)."""
    normals: Array
    """Unit surface normals, shape (n, 3)."""
    first: Ints
    """Number of each run's first sample, one more at the end, shape (runs + 1,)."""


class Strands:
    """Open polylines on the surface, side by side on one scale of arc length."""

    def __init__(self, runs: Sequence[Curve]) -> None:
        """Take the runs, open curves of two points or more."""
        self.runs = tuple(runs)
        self.lengths = np.array([run.length for run in runs])
        """Length of each run [m], shape (runs,)."""
        self._offsets = np.concatenate([[0.0], np.cumsum(self.lengths + _BETWEEN)[:-1]])
        self._knots = np.concatenate([run.knots + offset for run, offset in zip(runs, self._offsets, strict=True)])
        self._positions = np.concatenate([run.positions for run in runs])
        self._normals = np.concatenate([run.normals for run in runs])

    def at(self, run: Ints, s: Array) -> tuple[Array, Array]:
        """Positions [m] and unit normals of runs (n,) at arc lengths (n,), held at a run's ends."""
        where = self._offsets[run] + np.clip(s, 0.0, self.lengths[run])
        index = np.searchsorted(self._knots, where, side="right") - 1
        index = np.clip(index, 0, len(self._knots) - 2)
        # At a run's very end the next knot belongs to another run.
        span = self._knots[index + 1] - self._knots[index]
        share = np.where((where > self._knots[index]) & (span > 0.0), where - self._knots[index], 0.0)
        share = (share / np.where(span > 0.0, span, 1.0))[:, None]
        positions = self._positions[index] + share * (self._positions[index + 1] - self._positions[index])
        return positions, unit(self._normals[index] + share * (self._normals[index + 1] - self._normals[index]))

    def sample(self, spacing: float) -> Samples:
        """Points no further apart than a spacing [m], three or more of each run, both ends among them."""
        counts = np.maximum(np.ceil(self.lengths / spacing).astype(np.int64), 2) + 1
        first = np.concatenate([[0], np.cumsum(counts)])
        run = np.repeat(np.arange(len(counts)), counts)
        s = (np.arange(first[-1]) - first[run]) * (self.lengths / (counts - 1))[run]
        points, normals = self.at(run, s)
        return Samples(run, s, points, normals, first)
