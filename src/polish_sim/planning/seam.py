"""Where a spiral steps from turn to turn: a line across all turns that keeps away from corners (turns -> seams)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.curve import Curve

Array = NDArray[np.float64]

BAND = 6.0
"""Length of a blend in step-overs, where the turn is long enough."""
BAND_SHARE = 1.0 / 6.0
"""Longest share of a turn a blend takes."""
CANDIDATES = 96


def band_length(curve: Curve, stepover: float) -> float:
    """Length of the blend at the end of a turn [m]."""
    return min(BAND * stepover, BAND_SHARE * curve.length)


def place_seams(curves: Sequence[Curve], stepover: float) -> Array:
    """Where each turn begins: a line across all turns along which their blends avoid corners.

    Lines are traced outwards from points of the innermost turn, nearest point to nearest point; outwards they
    never run into a corner. The one with the least turning inside its bands wins.

    Args:
        curves: Nested turns, outermost first.
        stepover: Distance between them [m].

    Returns:
        Arc length of each turn's beginning on its curve [m], shape (k,).
    """
    count = min(CANDIDATES, max(int(curves[-1].length / (0.25 * stepover)), 8))
    s = np.linspace(0.0, curves[-1].length, count, endpoint=False)
    points = curves[-1].at(s)[0]
    seams, cost = [s], _bend(curves[-1], s, stepover)
    for curve in reversed(curves[:-1]):
        nearest = curve.nearest(points)
        jump = np.abs(nearest.distances / stepover - 1.0)
        cost += _bend(curve, nearest.s, stepover) + 10.0 * np.maximum(jump - 0.1, 0.0)
        points = nearest.positions
        seams.append(nearest.s)
    best = int(np.argmin(np.round(cost, 6)))
    return np.array([s[best] for s in reversed(seams)])


def _bend(curve: Curve, s: Array, stepover: float) -> Array:
    """How much a turn bends in its band [rad], and a little of how much around it."""
    chords = np.diff(curve.at(np.append(curve.knots, curve.knots[1]))[0], axis=0)
    cosine = (chords[:-1] * chords[1:]).sum(axis=1) / np.linalg.norm(chords[:-1], axis=1)
    angle = np.arccos(np.clip(cosine / np.linalg.norm(chords[1:], axis=1), -1.0, 1.0))
    total = np.concatenate([[0.0], np.cumsum(angle)])

    def within(first: Array, last: Array) -> Array:
        ends = [
            np.interp(curve.wrap(x), curve.knots, total) + np.floor(x / curve.length) * total[-1] for x in (first, last)
        ]
        return ends[1] - ends[0]

    band = band_length(curve, stepover)
    near = within(s - 1.2 * band, s + 0.2 * band)
    far = sum(within(s - (0.5 + k) * band, s - (0.5 - k) * band) / k for k in (1.0, 1.5, 2.0, 2.5))
    return np.asarray(near + 0.05 * far)
