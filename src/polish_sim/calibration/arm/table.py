"""An arm as built: standard Denavit-Hartenberg parameters that may differ from the nominal ones (layer 8b).

A table is an array (4, 6): joint offsets [rad], d [m], a [m], alpha [rad];
T_i = Rz(q_i + offset) Tz(d) Tx(a) Rx(alpha).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.motion.kinematics import DH_A, DH_ALPHA, DH_D

Array = NDArray[np.float64]

NOMINAL = np.stack([np.zeros(6), DH_D, DH_A, DH_ALPHA])
"""The UR5e's table, shape (4, 6)."""


def arm_frames(table: Array, q: Array) -> Array:
    """Poses of all DH frames in the base, base first.

    Args:
        table: The arm's table, shape (4, 6).
        q: Joint angles [rad], shape (n, 6).

    Returns:
        Shape (n, 7, 4, 4).
    """
    frames = np.empty((len(q), 7, 4, 4))
    frames[:, 0] = np.eye(4)
    for i in range(6):
        offset, d, a, alpha = table[:, i]
        c, s = np.cos(q[:, i] + offset), np.sin(q[:, i] + offset)
        ca, sa, zero, one = np.cos(alpha), np.sin(alpha), np.zeros(len(q)), np.ones(len(q))
        rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s]]
        rows += [[zero, sa * one, ca * one, d * one], [zero, zero, zero, one]]
        frames[:, i + 1] = frames[:, i] @ np.moveaxis(np.array(rows), 2, 0)
    return frames


def table_slopes(frames: Array, points: Array) -> Array:
    """Derivative of points that move with the flange by the table's 24 numbers, row by row of the table.

    Offset and d act along and about z of the frame before, a and alpha along and about x of the frame behind.

    Args:
        frames: As from `arm_frames`, in any common frame, shape (n, 7, 4, 4).
        points: The point in every pose, same frame [m], shape (n, 3).

    Returns:
        Shape (n, 3, 24).
    """
    z, x = frames[:, :6, :3, 2], frames[:, 1:, :3, 0]
    about_z = np.cross(z, points[:, None] - frames[:, :6, :3, 3])
    about_x = np.cross(x, points[:, None] - frames[:, 1:, :3, 3])
    return np.concatenate([about_z, z, x, about_x], axis=1).transpose(0, 2, 1)
