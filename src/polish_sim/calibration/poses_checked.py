"""What every pose a calibration is given must satisfy (layer 8b)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.calibration.readings import ROTATION_TOLERANCE
from polish_sim.errors import CalibrationError

Array = NDArray[np.float64]


def check_poses(T: Array, kind: str) -> None:
    """Refuse what is no stack of rigid transforms.

    Args:
        T: Poses, shape (n, 4, 4).
        kind: What one of them belongs to, e.g. ``"touch"``.

    Raises:
        CalibrationError: A wrong shape, a value that is not finite, a matrix that is no rotation; names the first.
    """
    if T.ndim != 3 or T.shape[1:] != (4, 4):
        raise CalibrationError(f"poses need the shape (n, 4, 4); got {T.shape}.")
    bad = ~np.isfinite(T).all(axis=(1, 2))
    if bad.any():
        raise CalibrationError(f"{kind} {int(np.argmax(bad)) + 1} holds a value that is not finite: leave it out.")
    R = T[:, :3, :3]
    wrong = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0) > ROTATION_TOLERANCE
    wrong |= np.linalg.det(R) < 0.0
    if wrong.any():
        raise CalibrationError(
            f"the orientation of {kind} {int(np.argmax(wrong)) + 1} is not a right-handed rotation: "
            "are columns swapped or a sign lost?"
        )
