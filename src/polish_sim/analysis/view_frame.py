"""The frame pictures of a part are drawn in: to the right, to the back, up (up -> rotation)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.spatial import unit

Array = NDArray[np.float64]

ALONG = 0.9998
"""Cosine of about one degree: a direction as close to an axis is called by its name."""


def view_frame(up: Array) -> Array:
    """Rotation R_view_work: its rows are the picture's right, back and up in the work frame, shape (3, 3).

    Args:
        up: Unit vector away from the table, work frame, shape (3,).
    """
    right = np.cross([0.0, 1.0, 0.0], up) if abs(up[1]) < 0.9 else np.cross([0.0, 0.0, -1.0], up)
    right = unit(right)
    return np.stack([right, np.cross(up, right), up])


def axis_name(direction: Array) -> str:
    """Which of the part's axes a direction of the picture is, to tell views apart: ``+x``, ``-y``, or as numbers.

    Args:
        direction: Unit vector in the work frame, shape (3,).
    """
    largest = int(np.abs(direction).argmax())
    if abs(direction[largest]) > ALONG:
        return ("-" if direction[largest] < 0.0 else "+") + "xyz"[largest]
    # Adding zero turns -0.0 into 0.0.
    return ", ".join(f"{round(float(value), 2) + 0.0:g}" for value in direction)
