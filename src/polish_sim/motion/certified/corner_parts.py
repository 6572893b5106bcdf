"""A corner and how it is passed: what every proof about it takes (layer 6)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.segment_rates import Segment

Array = NDArray[np.float64]


class Sides(NamedTuple):
    """The two segments that meet at a corner, in the base frame."""

    old: Segment
    new: Segment
    spans: tuple[float, float]
    """Generalised lengths of both [m]."""


class Kernel(NamedTuple):
    """Pieces of a corner kernel or of a bend."""

    durations: Array
    """[s], shape (pieces,); 0 for one that is not used."""
    remaining: Array
    """Cubics of what is left of the old segment [m], shape (pieces, 4)."""
    gone: Array
    """Cubics of what is gone of the new one [m], shape (pieces, 4)."""


def new_kernel(pieces: int) -> Kernel:
    """Room for a kernel."""
    return Kernel(np.zeros(pieces), np.zeros((pieces, 4)), np.zeros((pieces, 4)))


@njit(cache=True, error_model="numpy")
def copy_scaled(source: Kernel, scale: float, slowdown: float, kernel: Kernel) -> None:
    """Write a kernel's smaller, slower copy.

    Args:
        source: The kernel.
        scale: Lengths shrink by its cube, times by itself: the jerk stays.
        slowdown: Factor on times beyond that.
        kernel: Written; may be the source.
    """
    for p in range(source.durations.shape[0]):
        kernel.durations[p] = source.durations[p] * scale * slowdown
        factor = scale**3
        for c in range(4):
            kernel.remaining[p, c] = source.remaining[p, c] * factor
            kernel.gone[p, c] = source.gone[p, c] * factor
            factor /= scale * slowdown
