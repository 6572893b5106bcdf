"""Whether a force loop has come to rest, and the map of where it does (layer 8c)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.analysis.score_figures import LARGEST_OSCILLATION, LEAST_ALLOWED_N

Array = NDArray[np.float64]

AT_REST_N = 0.05
"""Swing of the force, peak to peak, below which the loop is at rest [N]."""
DYING = 0.9
"""A swing that shrinks by this factor in a window is dying away [-]."""
WINDOW_S = 0.8


class Rest(NamedTuple):
    """How a loop ended."""

    resting: bool
    """No swing, or one that dies away."""
    stable: bool
    """Resting, or a swing as small as the scorecard allows: friction of the joints can keep a small one up."""
    swing: float
    """Of the exact force, peak to peak in the last window [N]."""
    frequency: float
    """Of that swing [rad/s]."""
    offset: float
    """Mean force less the wanted one in the last window [N]."""


class Border(NamedTuple):
    """Stability over springs and latency, controller by controller."""

    scales: Array
    """Springs of head and pad by what plan and controller take them for, in the cell [-], shape (n,)."""
    latencies: Array
    """Sensor and command together, in the cell [s], shape (m,)."""
    rests: dict[str, list[list[Rest]]]
    """How each run ended, by controller, latency and scale."""
    line_scales: Array
    """Springs, for the linear model [-], shape (k,)."""
    lines: dict[str, Array]
    """Latency up to which the linear model is stable [s], by controller, shape (k,); infinite where it always is."""


def judge_rest(force: Array, wanted: float, dt: float) -> Rest:
    """Whether a force held constant has come to rest, from its last two windows.

    Args:
        force: Exact force of the hold at every step [N], shape (n,); too short a hold is not at rest.
        wanted: Force wanted [N].
        dt: Physics step [s].

    Returns:
        How it ended.
    """
    rows = round(WINDOW_S / dt)
    if len(force) < 2 * rows:
        return Rest(False, False, math.inf, math.nan, math.nan)
    before, last = force[-2 * rows : -rows], force[-rows:]
    swing, earlier = float(np.ptp(last)), float(np.ptp(before))
    spectrum = np.abs(np.fft.rfft((last - last.mean()) * np.hanning(rows), 8 * rows))
    frequency = 2.0 * math.pi * float(np.argmax(spectrum)) / (8 * rows * dt)
    resting = swing < AT_REST_N or swing < DYING * earlier
    allowed = 2.0 * max(LEAST_ALLOWED_N, LARGEST_OSCILLATION * wanted)
    return Rest(resting, resting or swing <= allowed, swing, frequency, float(last.mean()) - wanted)
