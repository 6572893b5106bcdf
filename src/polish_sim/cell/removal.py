"""Preston's law on the pad's pressure: pressure x sliding speed x time at every node (nodes, motion -> exposure; 8a).

The pad is the elastic foundation of ``contact``, seen from the part: a node presses the spring whose foot it is, by the
distance to the pad's face along its normal. Each step's field is scaled so that it carries the exact force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.pad_motion import PadMotion
from polish_sim.cell.pressed_nodes import PressedNodes
from polish_sim.planning.quality.point_grid import PointGrid, build_point_grid

Array = NDArray[np.float64]

CELL = 0.35
"""Side of the cells nodes are looked up by, in pad radii."""
FACING = 0.1
"""Least cosine between a node's normal and the pad's axis for the pad to press on it [-]."""


class Removed(NamedTuple):
    """What a pad did to some nodes."""

    exposure: Array
    """Integral of pressure x sliding speed at each node [N/m], shape (n,)."""
    gained: Array
    """Exposure summed over all nodes, step by step [N m], shape (k,)."""
    carried: Array
    """Mean force of the field along the pad's axis before it was scaled [N], shape (k,); zero: no node was touched."""


def expose_nodes(nodes: PressedNodes, motion: PadMotion, pad_radius: float, stiffness: float) -> Removed:
    """Carry the pad over the nodes.

    Args:
        nodes: Nodes of the real part.
        motion: Steps of the pad, in the same frame.
        pad_radius: [m]
        stiffness: Of the whole disc pressed flat [N/m].

    Returns:
        What it took off, but for the wear coefficient.
    """
    grid = build_point_grid(nodes.positions, CELL * pad_radius)
    # Neighbours in space are neighbours in memory.
    order = grid.items
    sorted_nodes = PressedNodes(*(np.ascontiguousarray(column[order]) for column in nodes))
    found = _carry(sorted_nodes, motion, grid, pad_radius, stiffness / (math.pi * pad_radius**2))
    exposure = np.empty(len(order))
    exposure[order] = found[0]
    return Removed(exposure, found[1], found[2])


@njit(cache=True, error_model="numpy")
def _carry(nodes: PressedNodes, motion: PadMotion, grid: PointGrid, radius: float, bedding: float):  # type: ignore[no-untyped-def]
    count = len(motion.times)
    exposure, gained, carried = np.zeros(len(nodes.areas)), np.zeros(count), np.zeros(count)
    touched, dose = np.empty(len(nodes.areas), np.int64), np.empty(len(nodes.areas))
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(count):
        axis = motion.axes[k]
        for d in range(3):
            # Feet lie beside the face by their depth; a tenth of the radius covers that.
            reach = radius * (math.sqrt(max(1.0 - axis[d] * axis[d], 0.0)) + 0.1)
            least, most = motion.centers[k, d] - reach - grid.low[d], motion.centers[k, d] + reach - grid.low[d]
            low[d] = max(math.floor(least / grid.cell), 0)
            high[d] = min(math.floor(most / grid.cell), grid.size[d] - 1) + 1
        if low[2] >= high[2]:
            continue
        number, total = 0, 0.0
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                row = (i * grid.size[1] + j) * grid.size[2]
                for q in range(grid.first[row + low[2]], grid.first[row + high[2]]):
                    force, power = _press_node(nodes, motion, q, k, radius, bedding)
                    if force > 0.0:
                        total += force
                        touched[number], dose[number] = q, power
                        number += 1
        carried[k] = total
        for t in range(number):
            work = dose[t] * motion.impulses[k] / total
            gained[k] += work
            exposure[touched[t]] += work / nodes.areas[touched[t]]
    return exposure, gained, carried


@njit(cache=True, error_model="numpy", inline="always")
def _press_node(nodes, motion, q, k, radius, bedding):  # type: ignore[no-untyped-def]
    """Force on a node along the pad's axis [N], and force along the node's normal x sliding speed [W]."""
    ax, ay, az = motion.axes[k, 0], motion.axes[k, 1], motion.axes[k, 2]
    rx = nodes.positions[q, 0] - motion.centers[k, 0]
    ry = nodes.positions[q, 1] - motion.centers[k, 1]
    rz = nodes.positions[q, 2] - motion.centers[k, 2]
    height = rx * ax + ry * ay + rz * az
    nx, ny, nz = nodes.normals[q, 0], nodes.normals[q, 1], nodes.normals[q, 2]
    facing = nx * ax + ny * ay + nz * az
    if height <= 0.0 or facing <= FACING:
        return 0.0, 0.0
    # The spring whose foot the node is: straight below it, along the part's normal.
    depth = height / facing
    sx, sy, sz = rx - depth * nx, ry - depth * ny, rz - depth * nz
    if sx * sx + sy * sy + sz * sz >= radius * radius:
        return 0.0, 0.0
    wx, wy, wz = motion.turning[k, 0], motion.turning[k, 1], motion.turning[k, 2]
    vx = motion.velocities[k, 0] + wy * sz - wz * sy
    vy = motion.velocities[k, 1] + wz * sx - wx * sz
    vz = motion.velocities[k, 2] + wx * sy - wy * sx
    along = vx * nx + vy * ny + vz * nz
    vx, vy, vz = vx - along * nx, vy - along * ny, vz - along * nz
    # The spring's share of the disc is the node's area over the cosine; of its force the cosine acts along the axis.
    force = bedding * depth * nodes.areas[q]
    return force, force / facing * math.sqrt(vx * vx + vy * vy + vz * vz)
