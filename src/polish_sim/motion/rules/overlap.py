"""From filter times to a schedule: neighbours overlap as far as the tolerances let them (paper 4, eq. 12-14)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.motion.smoothing.chain import Chain
from polish_sim.motion.smoothing.corner_error import corner_overlap, corner_speed
from polish_sim.motion.smoothing.fir import fir_schedule, sorted_times
from polish_sim.motion.smoothing.schedule import Schedule

Array = NDArray[np.float64]


def overlapped(chain: Chain, triples: Array, tolerance: float, axis_tolerance: float) -> Schedule:
    """Let each segment begin before the last one has ended.

    No more than two are under way at once: a corner takes at most half of each neighbour's time.

    Args:
        chain: The segments.
        triples: Filter times of each [s], shape (n, 3).
        tolerance: Of the tip at its vertices [m]; 0 stops at each.
        axis_tolerance: Of the tool axis [rad]; 0 stops at each.

    Returns:
        The schedule.
    """
    overlaps = np.zeros(max(len(triples) - 1, 0))
    _fill_overlaps(chain, triples, tolerance, axis_tolerance, overlaps)
    starts = np.concatenate([[0.0], np.cumsum(triples.sum(axis=1)[:-1] - overlaps)])[: len(triples)]
    return fir_schedule(starts, triples)


@njit(cache=True, error_model="numpy", _nrt=False)
def _fill_overlaps(chain: Chain, triples: Array, tolerance: float, axis_tolerance: float, overlaps: Array) -> None:
    for k in range(overlaps.shape[0]):
        a1, b1, c1 = sorted_times(triples[k, 0], triples[k, 1], triples[k, 2])
        a2, b2, c2 = sorted_times(triples[k + 1, 0], triples[k + 1, 1], triples[k + 1, 2])
        along = across = 0.0
        for i in range(3):
            along += chain.directions[k, i] * chain.directions[k + 1, i]
            across += chain.turn_axes[k, i] * chain.turn_axes[k + 1, i]
        tip = corner_speed(chain.lengths[k] / a1, chain.lengths[k + 1] / a2, along)
        axis = corner_speed(chain.angles[k] / a1, chain.angles[k + 1] / a2, across)
        overlaps[k] = min(
            corner_overlap(tolerance, tip, b1, c1, b2, c2),
            corner_overlap(axis_tolerance, axis, b1, c1, b2, c2),
            0.5 * (a1 + b1 + c1),
            0.5 * (a2 + b2 + c2),
        )
