"""The largest values of a corner kernel's progress and its derivatives, exact or safely above (layer 6).

At a corner the motion is -x1 a + x2 b, with a what is left of the old segment and b what is gone of the new one. For
any two numbers (a joint's rates) or vectors (turn axes) x1, x2 the size of that and of its derivatives is bounded by
Bezier control points of each cubic piece: exact for the second and third derivative, close for the others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

CONTROLS = 10
"""Control points a piece has: four of the position, three, two and one of its derivatives."""
FIRST = (0, 4, 7, 9, 10)
"""Where those of each order begin."""


class KernelControls(NamedTuple):
    """Control points of all pieces of a kernel, by order of derivative."""

    remaining: Array
    """Of a: positions, speeds, accelerations, jerk, shape (pieces, CONTROLS)."""
    gone: Array
    """Of b, the same shape."""
    most: Array
    """Largest |a|, |a'|, |a''|, |a'''|, the same of b and of |a| + |b|, |a'| + |b'| .., shape (3, 4)."""


def new_kernel_controls(pieces: int) -> KernelControls:
    """Fresh work space for kernels of up to so many pieces."""
    return KernelControls(np.zeros((pieces, CONTROLS)), np.zeros((pieces, CONTROLS)), np.zeros((3, 4)))


@njit(cache=True, error_model="numpy", forceinline=True)
def _fill_row(cubic: Array, row: int, t: float, out: Array) -> None:
    """Control points of c0 + c1 t + c2 t^2 + c3 t^3 on [0, t] and of its derivatives."""
    c0, c1, c2, c3 = cubic[row, 0], cubic[row, 1], cubic[row, 2], cubic[row, 3]
    out[row, 0] = c0
    out[row, 1] = c0 + c1 * t / 3.0
    out[row, 2] = c0 + (2.0 * c1 + c2 * t) * t / 3.0
    out[row, 3] = c0 + (c1 + (c2 + c3 * t) * t) * t
    out[row, 4] = c1
    out[row, 5] = c1 + c2 * t
    out[row, 6] = c1 + (2.0 * c2 + 3.0 * c3 * t) * t
    out[row, 7] = 2.0 * c2
    out[row, 8] = 2.0 * c2 + 6.0 * c3 * t
    out[row, 9] = 6.0 * c3


@njit(cache=True, error_model="numpy")
def fill_controls(durations: Array, remaining: Array, gone: Array, controls: KernelControls) -> None:
    """Write the control points of a kernel.

    Args:
        durations: Of its pieces [s], shape (pieces,); 0 for one that is not used.
        remaining: Cubics of a [m], shape (pieces, 4).
        gone: Cubics of b [m], shape (pieces, 4).
        controls: Written.
    """
    for side in range(3):
        for order in range(4):
            controls.most[side, order] = 0.0
    for p in range(durations.shape[0]):
        _fill_row(remaining, p, durations[p], controls.remaining)
        _fill_row(gone, p, durations[p], controls.gone)
        if durations[p] == 0.0:
            for c in range(CONTROLS):
                controls.remaining[p, c] = 0.0
                controls.gone[p, c] = 0.0
        for order in range(4):
            for c in range(FIRST[order], FIRST[order + 1]):
                old, new = abs(controls.remaining[p, c]), abs(controls.gone[p, c])
                controls.most[0, order] = max(controls.most[0, order], old)
                controls.most[1, order] = max(controls.most[1, order], new)
                controls.most[2, order] = max(controls.most[2, order], old + new)


@njit(cache=True, error_model="numpy")
def most_of_sum(controls: KernelControls, order: int, old: float, new: float) -> float:
    """Bound of |-old a + new b|, or of its derivative of an order."""
    most = 0.0
    for p in range(controls.gone.shape[0]):
        for c in range(FIRST[order], FIRST[order + 1]):
            most = max(most, abs(new * controls.gone[p, c] - old * controls.remaining[p, c]))
    return most


@njit(cache=True, error_model="numpy")
def most_of_vectors(controls: KernelControls, order: int, old: float, new: float, product: float) -> float:
    """Bound of the norm of -x1 a + x2 b (or its derivative), with |x1| = old, |x2| = new, x1.x2 = product."""
    most = 0.0
    for p in range(controls.gone.shape[0]):
        for c in range(FIRST[order], FIRST[order + 1]):
            a, b = controls.remaining[p, c], controls.gone[p, c]
            most = max(most, old * old * a * a + new * new * b * b - 2.0 * product * a * b)
    return math.sqrt(most)
