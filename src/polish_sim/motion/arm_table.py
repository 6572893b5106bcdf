"""An arm as built: standard Denavit-Hartenberg parameters that may differ from the nominal ones (layer 6).

A table is an array (4, 6): joint offsets [rad], d [m], a [m], alpha [rad];
T_i = Rz(q_i + offset) Tz(d) Tx(a) Rx(alpha).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polish_sim.errors import ReachError
from polish_sim.motion.kinematics import DH_A, DH_ALPHA, DH_D
from polish_sim.spatial import inverse

Array = NDArray[np.float64]

NOMINAL = np.stack([np.zeros(6), DH_D, DH_A, DH_ALPHA])
"""The UR5e's table, shape (4, 6)."""
NOMINAL.setflags(write=False)
CLOSE: Final = 1e-12
"""Flange poses are reached to this [m] and [rad]."""
_ROUNDS: Final = 10


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


def is_nominal(table: Array) -> bool:
    """Whether a table is the UR5e's own, number by number."""
    return bool(np.array_equal(table, NOMINAL))


def link_poses(table: Array) -> Array:
    """Pose of each link's frame in the one before with the joints at zero, shape (6, 4, 4)."""
    frames = arm_frames(table, np.zeros((1, 6)))[0]
    return np.asarray(inverse(frames[:6]) @ frames[1:])


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


def flange_poses(table: Array, q: Array) -> Array:
    """Where the flange of an arm is in its base.

    Args:
        table: The arm's table, shape (4, 6).
        q: Joint angles [rad], shape (n, 6).

    Returns:
        Shape (n, 4, 4).
    """
    return np.ascontiguousarray(arm_frames(table, q)[:, 6])


def reach_with_table(table: Array, T_base_flange: Array, q: Array) -> Array:
    """Joint angles that bring the flange of an arm there, from ones that almost do: Newton's method.

    The closed form knows the nominal table only. Of an arm half a millimetre off it, its solution is that close.

    Args:
        table: The arm's table, shape (4, 6).
        T_base_flange: Wanted poses, shape (n, 4, 4).
        q: Where to start, of the configuration wanted [rad], shape (n, 6).

    Returns:
        Joint angles [rad], shape (n, 6).

    Raises:
        ReachError: A pose is not reached: near a singularity, or the start was not close.
    """
    q = q.copy()
    for _ in range(_ROUNDS):
        frames = arm_frames(table, q)
        off = _pose_errors(frames[:, 6], T_base_flange)
        if np.abs(off).max() < CLOSE:
            return q
        z, arms = frames[:, :6, :3, 2], frames[:, 6, None, :3, 3] - frames[:, :6, :3, 3]
        J = np.concatenate([np.cross(z, arms), z], axis=2).transpose(0, 2, 1)
        q += (np.linalg.pinv(J) @ off[:, :, None])[:, :, 0]
    worst = int(np.abs(off).max(axis=1).argmax())
    raise ReachError(
        f"an arm with this table cannot bring its flange to pose {worst + 1} of {len(q)}: "
        f"{np.abs(off[worst]).max():.1g} m or rad are left. It is near a singularity: move the part or turn the tool."
    )


def _pose_errors(T: Array, T_wanted: Array) -> Array:
    """Displacement [m] and rotation vector [rad] from poses (n, 4, 4) to others, base axes, shape (n, 6)."""
    turn = Rotation.from_matrix(T_wanted[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([T_wanted[:, :3, 3] - T[:, :3, 3], turn], axis=1)
