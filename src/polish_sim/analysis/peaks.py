"""Where the path's curvature changes strongly, and what the force does there (paper 1, fig. 15)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array
from polish_sim.planning.toolpath import ToolPath

FLAT_1_M = 1.0 / 0.300  #: Below this normal curvature the path counts as gentle [1/m]
SHARP_1_M = 1.0 / 0.120  #: A peak of the normal curvature rises above this [1/m]
WINDOW_M = 0.015  #: Half-width of a peak's window along the path [m]: the curvature rises within 15 mm


class PeakErrors(NamedTuple):
    """Largest force error per window, averaged over the windows at the peaks and over those away from them."""

    at_peaks_n: float
    between_peaks_n: float


def curvature_peaks(path: ToolPath) -> NDArray[np.intp]:
    """Ascending indices of the path's points where its normal curvature rises from gentle to sharp.

    A bend is a stretch of process points whose curvature's magnitude stays at ``FLAT_1_M`` or above; its largest value
    is a peak if it exceeds ``SHARP_1_M``. Ripples on a bend are one peak, and humps and hollows count alike.
    """
    process = np.flatnonzero(path.process)
    magnitude = np.abs(path.curvature[process])
    bent = np.concatenate([[False], magnitude >= FLAT_1_M, [False]])
    edges = np.flatnonzero(np.diff(bent))
    tops = [first + int(np.argmax(magnitude[first:last])) for first, last in edges.reshape(-1, 2)]
    return process[[top for top in tops if magnitude[top] > SHARP_1_M]]


def errors_at_peaks(path_s: Array, force_error: Array, peaks_s: Array) -> PeakErrors:
    """Means of the force error [N] (n,) at peaks [m] of the path and in stretches of the same length elsewhere; NaN if
    none.

    The largest of many noisy samples is large anywhere, so the peaks are compared with the same statistic between them.
    """
    magnitude = np.abs(force_error)
    at_peaks = [_largest(path_s, magnitude, s - WINDOW_M, s + WINDOW_M) for s in peaks_s]
    edges = np.arange(path_s[0], path_s[-1] - 2 * WINDOW_M, 2 * WINDOW_M) if len(path_s) else np.empty(0)
    between = [
        _largest(path_s, magnitude, low, low + 2 * WINDOW_M)
        for low in edges
        if not np.any((peaks_s > low - WINDOW_M) & (peaks_s < low + 3 * WINDOW_M))
    ]
    return PeakErrors(_mean(at_peaks), _mean(between))


def _largest(path_s: Array, magnitude: Array, low: float, high: float) -> float:
    start, stop = np.searchsorted(path_s, [low, high])
    return float(magnitude[start:stop].max()) if stop > start else math.nan


def _mean(values: list[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.mean(known)) if known else math.nan
