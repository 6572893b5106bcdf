"""The step-over a path of unknown origin was made with, from the path itself (ToolPath -> metres)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.quality.spacing import measure_stepover
from polish_sim.planning.quality.strands import Samples, Strands
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import unit

Array = NDArray[np.float64]

ASKED = 2000
"""Places along the path at which its neighbours are looked for."""
NEIGHBOURS = 64
COARSER = (1.0, 4.0, 16.0)
"""Where neighbours are further away than that many samples of the own turn, fewer samples are tried."""
ROUNDS = 8
FINE = 0.25
"""Samples are fine enough at this share of the step-over."""
MOST_SAMPLES = 500_000
SIDEWAYS = 0.5
"""Largest share of the way to a neighbour that may lie along the path."""
LOOP = 3.0
"""A neighbour on the same run is at least so many times as far along the path as straight across."""


def guess_stepover(path: ToolPath) -> float | None:
    """Median distance between neighbouring turns of a path.

    Args:
        path: Any path.

    Returns:
        The distance [m]; None if no stretch of it runs beside another.
    """
    index = np.flatnonzero(path.process)
    stretches = [
        rows
        for rows in np.split(index, np.flatnonzero(np.diff(index) > 1) + 1)
        if len(rows) > 1 and np.ptp(path.s[rows])
    ]
    if not stretches:
        return None
    # No surface yet: the tool axis stands in for its normal.
    runs = [Curve(path.positions_work[rows], path.axes_work[rows], False) for rows in stretches]
    strands = Strands(runs)
    total = float(strands.lengths.sum())
    for coarse in COARSER:
        guess = _refined_guess(strands, total, coarse * total / ASKED)
        if guess is not None:
            exact = measure_stepover(runs, guess).distances_m
            return float(np.median(exact)) if len(exact) else guess
    return None


def _refined_guess(strands: Strands, total: float, spacing: float) -> float | None:
    """The guess from samples at first a spacing apart [m], then ever finer until they tell turns apart."""
    guess = None
    for _ in range(ROUNDS):
        guess = _guess(strands.sample(spacing))
        if guess is None or spacing <= 1.5 * FINE * guess or total / spacing > MOST_SAMPLES:
            break
        spacing = FINE * guess
    return guess


def _guess(path: Samples) -> float | None:
    """Median distance from some samples to the nearest one of another turn."""
    asked = np.unique(np.linspace(0, len(path.s) - 1, ASKED).astype(np.int64))
    low, high = path.first[path.run[asked]], path.first[path.run[asked] + 1] - 1
    tangents = unit(path.points[np.minimum(asked + 1, high)] - path.points[np.maximum(asked - 1, low)])
    count = min(NEIGHBOURS, len(path.s))
    distance, index = cKDTree(path.points).query(path.points[asked], k=count)
    towards = path.points[index] - path.points[asked, None]
    along = np.abs((towards * tangents[:, None]).sum(axis=2))
    far = np.abs(path.s[index] - path.s[asked, None]) > LOOP * distance
    other = (far | (path.run[index] != path.run[asked, None])) & (along < SIDEWAYS * distance)
    found = other.any(axis=1)
    if found.mean() < 0.05:
        return None
    return float(np.median(distance[found, other[found].argmax(axis=1)]))
