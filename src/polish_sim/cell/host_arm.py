"""An arm as the host computes it: what the encoders say by a table that need not be the built arm's.

The engine moves the arm as it is. A host knows its joint angles and a table, and takes from them where the end is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.kernel_cache import njit
from polish_sim.motion.kinematics import NOMINAL, advance_frame, joint_rows


class HostArm(NamedTuple):
    """A table at work. Arrays are written by ``read_encoders``; world frame."""

    present: float
    """1 if the host computes with it; 0: the arm is as the host's table says, the engine's own poses are taken."""
    table: Array
    """As `joint_rows`, shape (6, 5)."""
    T_world_base: Array
    """Where the arm stands, shape (4, 4)."""
    T_flange_end: Array
    """Its end, tool or flange itself, shape (4, 4)."""
    anchors: Array
    """A point on each joint's axis [m], shape (6, 3)."""
    axes: Array
    """Unit axes, shape (6, 3)."""
    place: Array
    """The end [m], shape (3,)."""
    turn: Array
    """Rotation of the end, row by row, shape (9,)."""
    frame: Array
    """Work array, shape (3, 4)."""


def no_host_arm() -> HostArm:
    """The arm is as its table says."""
    return build_host_arm(NOMINAL, np.eye(4), np.eye(4))._replace(present=0.0)


def build_host_arm(table: Array, T_world_base: Array, T_flange_end: Array) -> HostArm:
    """A host that computes with a table.

    Args:
        table: The table it believes in, shape (4, 6).
        T_world_base: Where the arm stands, shape (4, 4).
        T_flange_end: Its end on the flange, shape (4, 4).
    """
    return HostArm(
        1.0, joint_rows(table),
        np.array(T_world_base), np.array(T_flange_end), np.zeros((6, 3)), np.zeros((6, 3)), np.zeros(3), np.zeros(9),
        np.zeros((3, 4)),
    )  # fmt: skip


@njit(cache=True, error_model="numpy", forceinline=True)
def read_encoders(arm: HostArm, q: Array, first: int) -> None:
    """Where axes and end are with joint angles ``q[first : first + 6]`` [rad], by the host's table."""
    T = arm.frame
    for i in range(3):
        for j in range(4):
            T[i, j] = arm.T_world_base[i, j]
    for k in range(6):
        for i in range(3):
            arm.anchors[k, i], arm.axes[k, i] = T[i, 3], T[i, 2]
        advance_frame(T, arm.table[k], q[first + k])
    E = arm.T_flange_end
    for i in range(3):
        arm.place[i] = T[i, 3] + T[i, 0] * E[0, 3] + T[i, 1] * E[1, 3] + T[i, 2] * E[2, 3]
        for j in range(3):
            arm.turn[3 * i + j] = T[i, 0] * E[0, j] + T[i, 1] * E[1, j] + T[i, 2] * E[2, j]
