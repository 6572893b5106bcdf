"""Pieces of a symmetric corner kernel, from the accelerations at its knots (layer 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.motion.certified.corner_shapes import HALF, PIECES

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy", _nrt=False)
def spread_shape(
    shape: Array, sine: float, time: float, acceleration: float, durations: Array, remaining: Array
) -> None:
    """Knot accelerations and durations of a kernel from its shape.

    Args:
        shape: As read from the table, shape (1 + PIECES,).
        sine: Of the turn, 1 beyond a right angle; above 0.
        time: Unit of time [s].
        acceleration: Unit of acceleration [m/s^2].
        durations: Changed, shape (PIECES,).
        remaining: Changed: column 0 holds a'' at the beginning of each piece, column 1 at its end, shape (PIECES, 4).
    """
    for k in range(HALF):
        durations[k] = durations[PIECES - 1 - k] = time * shape[0] / HALF
    for k in range(HALF + 1):
        difference = shape[1 + k] if k < HALF else 0.0
        new = shape[HALF + k] / sine if k > 0 else 0.0
        set_knot(remaining, k, acceleration * (difference + new))
        set_knot(remaining, PIECES - k, acceleration * new)


@njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
def set_knot(remaining: Array, k: int, acceleration: float) -> None:
    """Set a'' at knot ``k``, 0 to PIECES."""
    if k < PIECES:
        remaining[k, 0] = acceleration
    if k > 0:
        remaining[k - 1, 1] = acceleration


@njit(cache=True, error_model="numpy", _nrt=False)
def integrate_knots(durations: Array, remaining: Array, gone: Array) -> tuple[float, float, float, float]:
    """Cubic pieces from accelerations at the knots.

    b runs as a does backwards, both rest where they are not used: a = a' = a'' = 0 at the end.

    Args:
        durations: Symmetric, shape (PIECES,).
        remaining: a'' at both ends of every piece in columns 0 and 1; changed to c0 .. c3 of a, shape (PIECES, 4).
        gone: Changed to c0 .. c3 of b, shape (PIECES, 4).

    Returns:
        Size a(0), speed -a'(0), acceleration a''(0) and duration.
    """
    position = rate = time = 0.0
    start = remaining[0, 0]
    # b: the knots of a from the last to the first.
    for p in range(PIECES):
        mirror, dt = PIECES - 1 - p, durations[p]
        second, third = 0.5 * remaining[mirror, 1], (remaining[mirror, 0] - remaining[mirror, 1]) / (6.0 * dt)
        gone[p, 0], gone[p, 1], gone[p, 2], gone[p, 3] = position, rate, second, third
        position += dt * (rate + dt * (second + dt * third))
        rate += dt * (2.0 * second + dt * 3.0 * third)
        time += dt
    size, speed = position, rate
    rate = -rate
    for p in range(PIECES):
        dt = durations[p]
        second, third = 0.5 * remaining[p, 0], (remaining[p, 1] - remaining[p, 0]) / (6.0 * dt)
        remaining[p, 0], remaining[p, 1], remaining[p, 2], remaining[p, 3] = position, rate, second, third
        position += dt * (rate + dt * (second + dt * third))
        rate += dt * (2.0 * second + dt * 3.0 * third)
    return size, speed, start, time


@njit(cache=True, error_model="numpy", _nrt=False)
def scale_pieces(durations: Array, remaining: Array, gone: Array, length: float, time: float) -> None:
    """Multiply a kernel's lengths and times.

    Args:
        durations: Changed, shape (PIECES,).
        remaining: Changed, shape (PIECES, 4).
        gone: Changed, shape (PIECES, 4).
        length: Factor on lengths.
        time: Factor on times.
    """
    for p in range(PIECES):
        durations[p] *= time
        factor = length
        for c in range(4):
            remaining[p, c] *= factor
            gone[p, c] *= factor
            factor /= time
