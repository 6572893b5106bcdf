"""An arm as its host computes it: tool pose and axes from joint angles and a table of Denavit-Hartenberg parameters."""

from __future__ import annotations

from typing import Annotated

from polish_sim.arrays import Array
from polish_sim.kernels import Matrix4, Record, Vector3, kernel
from polish_sim.motion.kinematics import advance_frame, joint_rows


class HostArm(Record):
    """An arm by a table; where axes and end are is written by ``read_encoders``, world frame."""

    table: Annotated[Array, (6, 5)]  #: As `joint_rows`
    T_world_base: Matrix4  #: Where the arm stands
    T_flange_end: Matrix4  #: Its end, tool or flange itself
    anchors: Annotated[Array, (6, 3)]  #: A point on each joint's axis [m]
    axes: Annotated[Array, (6, 3)]  #: Unit axes
    place: Vector3  #: The end [m]
    turn: Annotated[Array, (9,)]  #: Rotation of the end, row by row
    frame: Annotated[Array, (3, 4)]  #: Work array


def build_host_arm(table: Array, T_world_base: Array, T_flange_end: Array) -> HostArm:
    """A host that computes with a table, (4, 6), for an arm at ``T_world_base`` with its end at ``T_flange_end``."""
    return HostArm(joint_rows(table), T_world_base, T_flange_end)


@kernel
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
