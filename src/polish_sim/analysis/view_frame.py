"""The frame pictures of a part are drawn in: to the right, to the back, up (up -> rotation)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.spatial import unit

Array = NDArray[np.float64]


def view_frame(up: Array) -> Array:
    """Rotation R_view_work: its rows are the picture's right, back and up in the work frame, shape (3, 3).

    Args:
        up: Unit vector away from the table, work frame, shape (3,).
    """
    right = np.cross([0.0, 1.0, 0.0], up) if abs(up[1]) < 0.9 else np.cross([0.0, 0.0, -1.0], up)
    right = unit(right)
    return np.stack([right, np.cross(up, right), up])
