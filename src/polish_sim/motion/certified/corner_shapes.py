"""The table of corner kernels: how the acceleration runs through a corner, for turn, tolerance and speed (layer 6).

A kernel is symmetric about its middle, so its first half says it all: ``HALF`` pieces of equal duration with
acceleration linear in each. At every knot the table holds two numbers, of the motion ``-a d1 + b d2`` about the
vertex (a is left on the old segment, b gone on the new one): ``X = a'' - b''`` and ``Y = b'' sin(turn)`` (``b''``
beyond a right angle), the acceleration away from the old line: what lies between nodes stays as close to it as they do.
They are solutions of a convex programme at unit acceleration and jerk (lengths in A^3/J^2, times in A/J): least time
lost on a long path with the motion within the tolerance of the two lines, remade by
``python -m benchmarks.corner_shapes``. What is read between its nodes is only a good guess; limits and tolerance are
held by scaling it (corner.py).
"""

from __future__ import annotations

from importlib.resources import as_file, files
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit

Array = NDArray[np.float64]

HALF = 6
"""Pieces of half a kernel."""
PIECES = 2 * HALF
"""Pieces of a kernel."""


class CornerShapes(NamedTuple):
    """Kernels on a grid, at unit acceleration and jerk."""

    angles: Array
    """Turns of the path at the nodes [rad], rising, shape (p,)."""
    tolerances: Array
    """Logarithms of tolerance J^2/A^3, rising, shape (q,)."""
    speeds: Array
    """Logarithms of speed limit J/A^2, rising, shape (r,)."""
    values: Array
    """Half duration, X at knots 0 to HALF - 1, Y at knots 1 to HALF, shape (p, q, r, 1 + 2 HALF)."""


def corner_shapes() -> CornerShapes:
    """Read the table that comes with the package."""
    with as_file(files("polish_sim.motion.certified").joinpath("corner_shapes.npz")) as file, np.load(file) as data:
        return CornerShapes(
            data["angles"].astype(float),
            np.log(data["tolerances"].astype(float)),
            np.log(data["speeds"].astype(float)),
            np.ascontiguousarray(data["values"].astype(float)),
        )


@njit(cache=True, error_model="numpy", forceinline=True)
def _place(nodes: Array, x: float) -> tuple[int, float]:
    """Interval of ``nodes`` that ``x`` is in and how far along it, held at the ends."""
    i = 0
    while i < nodes.size - 2 and x >= nodes[i + 1]:
        i += 1
    return i, min(max((x - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def read_shape(shapes: CornerShapes, angle: float, tolerance: float, speed: float, out: Array) -> None:
    """Interpolate a kernel between the nodes.

    Args:
        shapes: The table.
        angle: Turn of the path [rad].
        tolerance: Tolerance J^2/A^3, above 0.
        speed: Speed limit J/A^2, above 0.
        out: Changed: half duration, X and Y as in the table, shape (1 + 2 HALF,) or longer.
    """
    i, u = _place(shapes.angles, angle)
    j, v = _place(shapes.tolerances, np.log(tolerance))
    k, w = _place(shapes.speeds, np.log(speed))
    for m in range(1 + PIECES):
        out[m] = 0.0
    for corner in range(8):
        di, dj, dk = corner & 1, (corner >> 1) & 1, corner >> 2
        share = (u if di else 1.0 - u) * (v if dj else 1.0 - v) * (w if dk else 1.0 - w)
        if share > 0.0:
            for m in range(1 + PIECES):
                out[m] += share * shapes.values[i + di, j + dj, k + dk, m]
