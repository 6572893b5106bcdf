"""Preston's law on the pad's pressure: pressure x sliding speed x time at every node (nodes, motion -> exposure; 8a).

The pad is the elastic foundation of ``contact``, with a spring under every node instead of its hundred. Its depth is
taken along the pad's axis and leant by the node's normal, which is the distance to the surface but for terms of second
order, and which, unlike it, does not fade out towards the part's edges. Each step's field is scaled so that it carries
the exact force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.cell.pad_motion import PadMotion
from polish_sim.cell.pressed_nodes import PressedNodes
from polish_sim.planning.quality.point_grid import build_point_grid

Array = NDArray[np.float64]

CELL = 0.35
"""Side of the cells nodes are looked up by, in pad radii."""
FACING = 0.1
"""Least cosine between a node's normal and the pad's axis for the pad to press on it [-]."""
DEEPEST = 0.5
"""How far up its axis a pad finds nodes, in its radii."""


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
def _carry(nodes, motion, grid, radius, bedding):  # type: ignore[no-untyped-def]
    exposure, gained, carried = np.zeros(len(nodes.areas)), np.zeros(len(motion.times)), np.zeros(len(motion.times))
    under, force, power = np.empty(len(nodes.areas), np.int64), np.empty(len(nodes.areas)), np.empty(len(nodes.areas))
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(len(motion.times)):
        center, axis = motion.centers[k], motion.axes[k]
        for d in range(3):
            # A disc's half width, and as far up the axis as a pad can be pressed in.
            reach = radius * math.sqrt(max(1.0 - axis[d] * axis[d], 0.0)) + DEEPEST * radius * abs(axis[d])
            low[d] = max(math.floor((center[d] - reach - grid.low[d]) / grid.cell), 0)
            high[d] = min(math.floor((center[d] + reach - grid.low[d]) / grid.cell), grid.size[d] - 1) + 1
        if low[2] >= high[2]:
            continue
        number = 0
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                row = (i * grid.size[1] + j) * grid.size[2]
                first, last = grid.first[row + low[2]], grid.first[row + high[2]]
                number = _find_under(nodes.positions, nodes.normals, first, last, center, axis, radius, under, number)
        _press_nodes(
            nodes.positions, nodes.normals, nodes.areas, center, axis, motion.velocities[k], motion.turning[k],
            bedding, under, number, force, power,
        )  # fmt: skip
        total = 0.0
        for t in range(number):
            total += force[t]
        carried[k] = total
        if total > 0.0:
            for t in range(number):
                work = power[t] * motion.impulses[k] / total
                gained[k] += work
                exposure[under[t]] += work / nodes.areas[under[t]]
    return exposure, gained, carried


@njit(cache=True, error_model="numpy", forceinline=True)
def _find_under(positions, normals, first, last, center, axis, radius, under, number):  # type: ignore[no-untyped-def]
    """List the nodes that stand over the pad's face and look at it; returns how many are listed."""
    cx, cy, cz, ax, ay, az = center[0], center[1], center[2], axis[0], axis[1], axis[2]
    for q in range(first, last):
        rx, ry, rz = positions[q, 0] - cx, positions[q, 1] - cy, positions[q, 2] - cz
        height = rx * ax + ry * ay + rz * az
        beside = rx * rx + ry * ry + rz * rz - height * height
        facing = normals[q, 0] * ax + normals[q, 1] * ay + normals[q, 2] * az
        under[number] = q
        number += int(height > 0.0 and beside < radius * radius and facing > FACING)
    return number


@njit(cache=True, error_model="numpy", forceinline=True)
def _press_nodes(  # type: ignore[no-untyped-def]
    positions, normals, areas, center, axis, velocity, turning, bedding, under, number, force, power
):
    """Force on each node along the pad's axis [N], and force along the part's normal x sliding speed [W]."""
    cx, cy, cz, ax, ay, az = center[0], center[1], center[2], axis[0], axis[1], axis[2]
    ux, uy, uz, wx, wy, wz = velocity[0], velocity[1], velocity[2], turning[0], turning[1], turning[2]
    for t in range(number):
        q = under[t]
        nx, ny, nz = normals[q, 0], normals[q, 1], normals[q, 2]
        rx, ry, rz = positions[q, 0] - cx, positions[q, 1] - cy, positions[q, 2] - cz
        height, facing = rx * ax + ry * ay + rz * az, nx * ax + ny * ay + nz * az
        # The spring under the node, at the pad's face: as deep as the part is thick there, across its surface; its
        # share of the disc is the node's shadow.
        push = bedding * height * facing * areas[q] * facing
        sx, sy, sz = rx - height * ax, ry - height * ay, rz - height * az
        vx, vy, vz = ux + wy * sz - wz * sy, uy + wz * sx - wx * sz, uz + wx * sy - wy * sx
        along = vx * nx + vy * ny + vz * nz
        vx, vy, vz = vx - along * nx, vy - along * ny, vz - along * nz
        force[t] = push * facing
        power[t] = push * math.sqrt(vx * vx + vy * vy + vz * vz)
