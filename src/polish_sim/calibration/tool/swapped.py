"""Touches that fit only after columns are swapped or turned round: told from touches that are merely bad (layer 8b)."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.tool.touches import ToolTouches
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

SUSPECT = 2e-3
"""Touches that leave less than this are not suspected [m]."""
_BETTER = 0.1


def refuse_swapped(touches: ToolTouches) -> None:
    """Refuse positions that fit their orientations ten times better with columns swapped or a sign changed.

    Raises:
        CalibrationError: Naming what fits.
    """
    left = _median_left(touches.R, touches.origins)
    if left < SUSPECT:
        return
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if _median_left(touches.R, touches.origins[:, order] * signs) < _BETTER * left:
            named = ", ".join(("-" if s < 0.0 else "") + "xyz"[axis] for axis, s in zip(order, signs, strict=True))
            raise CalibrationError(
                f"the touches fit to {1e3 * left:.2g} mm only, but well if x, y, z are read as {named}: columns are "
                "swapped or a sign is lost (a left-handed frame)."
            )


def _median_left(R: Array, origins: Array) -> float:
    """Median distance of the touches from their fit [m], which a wrong one moves little."""
    A = np.concatenate([R, np.tile(-np.eye(3), (len(R), 1, 1))], axis=2)
    theta = np.linalg.lstsq(A.reshape(-1, 6), -origins.ravel(), rcond=None)[0]
    return float(np.median(np.linalg.norm(A @ theta + origins, axis=1)))
