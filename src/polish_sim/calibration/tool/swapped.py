"""Touches that fit only after columns are swapped or turned round: told from touches that are merely bad (layer 8b)."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.calibration.tool.touches import ToolTouches
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]

SUSPECT = 2e-3
"""Touches that leave less than this are not suspected [m]."""
LARGEST_LEFT = 5e-3
"""No touches by hand miss by more than this [m]."""
_BETTER = 0.1


def refuse_swapped(touches: ToolTouches) -> None:
    """Refuse poses that fit ten times better with columns in another order or turned round.

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
                "swapped or a sign is lost."
            )
    for R, named in _orientations_otherwise(touches.R):
        if _median_left(R, touches.origins) < _BETTER * left:
            raise CalibrationError(f"the touches fit to {1e3 * left:.2g} mm only, but well if {named}.")


def refuse_far_off(residuals: Array) -> None:
    """Refuse touches that no tip and no point explain.

    Args:
        residuals: What their fit leaves [m], shape (n, 3).

    Raises:
        CalibrationError: More than any touch by hand misses by.
    """
    left = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    if left > LARGEST_LEFT:
        raise CalibrationError(
            f"no tip fits these touches: they leave {1e3 * left:.2g} mm rms. Wanted are positions and orientations of "
            "the flange in the base, touch by touch, of one tool and one fixed point. Are orientations in another "
            "order, in degrees, or those of another frame?"
        )


def _orientations_otherwise(R: Array) -> Iterator[tuple[Array, str]]:
    """The orientations as other files mean the same numbers."""
    yield np.swapaxes(R, 1, 2), "every orientation is turned round: it is that of the base in the flange"
    wxyz = Rotation.from_matrix(R).as_quat(scalar_first=True)
    for order in permutations(range(4)):
        named = ", ".join("q" + "wxyz"[k] for k in order)
        turned = Rotation.from_quat(wxyz[:, order], scalar_first=True)
        yield turned.as_matrix(), f"qw, qx, qy, qz are read as {named}: columns are swapped"
        yield turned.inv().as_matrix(), f"qw, qx, qy, qz are read as {named} and turned round"


def _median_left(R: Array, origins: Array) -> float:
    """Median distance of the touches from their fit [m], which a wrong one moves little."""
    A = np.concatenate([R, np.tile(-np.eye(3), (len(R), 1, 1))], axis=2)
    theta = np.linalg.lstsq(A.reshape(-1, 6), -origins.ravel(), rcond=None)[0]
    return float(np.median(np.linalg.norm(A @ theta + origins, axis=1)))
