"""The part where it is at this instant, and the pad's contact with it on every body it acts on (layer 8a)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.carrying import add_carried_speed, carry_part, see_tool
from polish_sim.cell.contact import press_pad
from polish_sim.cell.kernel import CellKernel
from polish_sim.cell.part_motion import move_part
from polish_sim.cell.spindle import SPIN, pull_of_imbalance

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def place_part(cell: CellKernel, t: float) -> None:
    """Place the part for this instant: where the flange of a robot that carries it is, and by its own motion."""
    e, flange = cell.engine, cell.carrier.flange_body
    if cell.carrier.present > 0.0:
        carry_part(
            cell.carrier, e.xmat[flange].reshape((3, 3)), e.xpos[flange], e.xanchor, e.xaxis, e.qpos, e.qvel,
            cell.part, cell.motion, e.dt,
        )  # fmt: skip
    move_part(cell.motion, t, e.dt, cell.part.position)
    if cell.carrier.present > 0.0:
        add_carried_speed(cell.carrier, e.xpos[flange], cell.part.position, cell.motion.velocity)
        slip = cell.scratch[0]
        for i in range(3):
            slip[i] = cell.part.position[i] - cell.motion.place[i]
        see_tool(cell.carrier, e.xmat[flange].reshape((3, 3)), e.xpos[flange], e.site_xpos[e.tool_site], slip)


@njit(cache=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
def press_on_part(cell: CellKernel) -> None:
    """Contact of the pad and pull of the imbalance at this instant, applied to the head; the exact contact wrench."""
    e, scratch, wrench, moving = cell.engine, cell.scratch, cell.wrench, cell.motion.velocity
    center, tool, head = e.site_xpos[e.pad_site], e.site_xpos[e.tool_site], e.head_body
    R_base_pad = e.site_xmat[e.pad_site].reshape((3, 3))
    velocity, force, torque, moment, turning_on = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    turning, com = e.cvel[head, 0:3], e.subtree_com[e.root_body]
    rx, ry, rz = center[0] - com[0], center[1] - com[1], center[2] - com[2]
    velocity[0] = e.cvel[head, 3] + turning[1] * rz - turning[2] * ry - moving[0]
    velocity[1] = e.cvel[head, 4] + turning[2] * rx - turning[0] * rz - moving[1]
    velocity[2] = e.cvel[head, 5] + turning[0] * ry - turning[1] * rx - moving[2]
    # Of the pad against the part, which may turn as well.
    spin, origin = cell.motion.turning, cell.part.position
    rx, ry, rz = center[0] - origin[0], center[1] - origin[1], center[2] - origin[2]
    velocity[0] -= spin[1] * rz - spin[2] * ry
    velocity[1] -= spin[2] * rx - spin[0] * rz
    velocity[2] -= spin[0] * ry - spin[1] * rx
    for i in range(3):
        turning_on[i] = turning[i] - spin[i]
    press_pad(cell.pad, cell.part, cell.spindle.state[SPIN], R_base_pad, center, velocity, turning_on, force, torque)
    _moment_at(force, torque, center, e.xipos[head], moment)
    for i in range(3):
        e.xfrc_applied[head, i] = force[i]
        e.xfrc_applied[head, 3 + i] = moment[i]
    if cell.carrier.present > 0.0:
        held = cell.carrier.part_body
        _moment_at(force, torque, center, e.xipos[held], moment)
        for i in range(3):
            e.xfrc_applied[held, i] = -force[i]
            e.xfrc_applied[held, 3 + i] = -moment[i]
    _moment_at(force, torque, center, tool, moment)
    R = e.site_xmat[e.tool_site]
    for i in range(3):
        wrench[i] = -(R[i] * force[0] + R[3 + i] * force[1] + R[6 + i] * force[2])
        wrench[3 + i] = -(R[i] * moment[0] + R[3 + i] * moment[1] + R[6 + i] * moment[2])
    pull_of_imbalance(cell.spindle, e.xmat[head], e.xfrc_applied[head])


@njit(cache=True, error_model="numpy", forceinline=True)
def _moment_at(force: Array, torque: Array, old_point: Array, new_point: Array, out: Array) -> None:
    """Move a torque from one reference point to another."""
    rx, ry, rz = old_point[0] - new_point[0], old_point[1] - new_point[1], old_point[2] - new_point[2]
    out[0] = torque[0] + ry * force[2] - rz * force[1]
    out[1] = torque[1] + rz * force[0] - rx * force[2]
    out[2] = torque[2] + rx * force[1] - ry * force[0]
