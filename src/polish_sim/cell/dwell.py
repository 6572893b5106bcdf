"""A pad pressed at rest: what it takes off every node in a second (nodes, poses -> sparse rates), and where a
part that lies a little aside would let it sink (fields, places -> places).

For the rates the pad, its pressure and its sliding are those of ``removal``, quasi-static: at each place the
pad is pressed in along its axis until its field carries the force. Times dwell the rates are the exposure,
which is therefore linear in it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from polish_sim.arrays import Array, Bools, directions_at, perpendicular, running_sums
from polish_sim.cell.contact import Pad, RealPart, build_pad, press_pad
from polish_sim.cell.real_part import PartFields, place_part
from polish_sim.cell.removal import CELL, DEEPEST, PressedNodes, _find_near, _press_nodes, _room_for
from polish_sim.config import PadConfig
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, kernel
from polish_sim.planning.points import build_point_grid

#: Newton's steps for the depth; the field grows faster than linearly, so each comes nearer
ROUNDS = 20
CLOSE = 1e-9  #: Depth to which it is found [m]


class PadPoses(NamedTuple):
    """A pad on its way, in the nodes' frame; k places."""

    tips: Array  #: Tool points, not pressed in [m], shape (k, 3)
    axes: Array  #: Unit pad axis, from the part to the tool, shape (k, 3)
    velocities: Array  #: Of the tool point [m/s], shape (k, 3)
    turning: Array  #: Angular velocity of pad and spindle [rad/s], shape (k, 3)
    forces: Array  #: Along the axis [N], shape (k,)


class Dwelling(NamedTuple):
    """What the pad does at each of k places."""

    rates: csr_array  #: Pressure x sliding speed at every node [N/(m s)], shape (k, nodes)
    depths: Array  #: How deep it is pressed in [m], shape (k,)


def exposure_rates(
    nodes: PressedNodes, poses: PadPoses, pad_radius: float, stiffness: float, slide: float = 0.0
) -> Dwelling:
    """Press a pad whose whole disc has ``stiffness`` [N/m] at every place; ``slide`` [m/s] as of
    `expose_nodes`.

    Where nothing carries the force it has no rates, and is as deep as a pad can be.
    """
    grid = build_point_grid(nodes.positions, CELL * pad_radius)
    ordered = PressedNodes(*(np.ascontiguousarray(column[grid.items]) for column in nodes))
    bedding = stiffness / (math.pi * pad_radius**2)
    starts = running_sums(_count(ordered, poses, grid, pad_radius))
    numbers, rates = np.zeros(starts[-1], dtype=np.int64), np.zeros(starts[-1])
    depths = _fill(ordered, poses, grid, pad_radius, bedding, slide, starts, numbers, rates)
    shape = len(poses.tips), len(nodes.areas)
    return Dwelling(csr_array((rates, grid.items[numbers], starts), shape=shape), depths)


@njit
def _count(nodes, poses, grid, radius):  # type: ignore[no-untyped-def]
    found, under = np.empty(len(poses.tips), np.int64), np.empty(len(nodes.areas), np.int64)
    for k in range(len(found)):
        deepest = DEEPEST * radius
        found[k] = _find_near(
            nodes, _sunk(poses, k, deepest), poses.axes[k], grid, radius, 2.0 * deepest, under
        )
    return found


@kernel
def _sunk(poses, k, depth):  # type: ignore[no-untyped-def]
    return poses.tips[k] - depth * poses.axes[k]


@njit
def _fill(nodes, poses, grid, radius, bedding, slide, starts, numbers, rates):  # type: ignore[no-untyped-def]
    under, force, power = _room_for(nodes)
    depths = np.empty(len(starts) - 1)
    for k in range(len(depths)):
        axis = poses.axes[k]
        deepest = DEEPEST * radius
        number = _find_near(nodes, _sunk(poses, k, deepest), axis, grid, radius, 2.0 * deepest, under)
        depth = depths[k - 1] if k > 0 else deepest
        for _ in range(ROUNDS):
            carried = slope = 0.0
            for t in range(number):
                q = under[t]
                height = depth
                facing = 0.0
                for d in range(3):
                    height += (nodes.positions[q, d] - poses.tips[k, d]) * axis[d]
                    facing += nodes.normals[q, d] * axis[d]
                if height > 0.0:
                    spring = bedding * nodes.areas[q] * facing**3
                    carried, slope = carried + spring * height, slope + spring
            # Out of reach of the part the pad is sought from the deepest place.
            step = (carried - poses.forces[k]) / slope if slope > 0.0 else depth - deepest
            depth -= step
            if abs(step) < CLOSE:
                break
        depths[k] = depth
        center = _sunk(poses, k, depth)
        _press_nodes(
            nodes, center, axis, poses.velocities[k], poses.turning[k], bedding, slide, under, number, force,
            power,
        )  # fmt: skip
        carried = 0.0
        for t in range(number):
            carried += max(force[t], 0.0)
        for t in range(number):
            numbers[starts[k] + t] = under[t]
            if force[t] > 0.0 and depth < deepest:
                rates[starts[k] + t] = power[t] * poses.forces[k] / carried / nodes.areas[under[t]]
    return depths


# At an edge the depth that carries the force is not a smooth function of the place: what the pad pushes aside
# it no longer presses on, and a little further out nothing holds it. One part played in the cell says nothing
# of one that is displaced to the other side. So the pad is pressed to all sides of every place.

SIDES = 8  #: Directions in which the part may lie aside
SINKS = 0.001  #: Deeper than where the drawn part carries it a pad must not sink [m]
STEP = 5e-4  #: Between the depths that are looked at [m]


@kernel
def _carries(pad: Pad, part: RealPart, frame: Array, middle: Array, depth: float, force: float) -> bool:
    """Whether a pad of a pose ``frame`` (3, 3), ``middle`` (3,) pressed in by a ``depth`` carries a force."""
    still = np.zeros(3)
    pushed = np.zeros(3)
    torque = np.zeros(3)
    place = np.zeros(3)
    for k in range(3):
        place[k] = middle[k] + depth * frame[k, 2]
    press_pad(pad, part, 0.0, frame, place, still, still, pushed, torque)
    return -dot(pushed, frame[:, 2]) >= force


@njit
def _note_sinking(
    pad: Pad, part: RealPart, frames: Array, middles: Array, force: Array, shifts: Array, depths: int,
    out: Bools,
) -> None:  # fmt: skip
    """`would_sink` of poses before they are pressed in; ``shifts`` (sides, 2) along x and y of each [m]."""
    aside = np.zeros(3)
    for i in range(len(middles)):
        first = 1
        while first <= depths and not _carries(pad, part, frames[i], middles[i], first * STEP, force[i]):
            first += 1
        out[i] = first > depths
        for j in range(len(shifts)):
            for k in range(3):
                aside[k] = middles[i, k] + shifts[j, 0] * frames[i, k, 0] + shifts[j, 1] * frames[i, k, 1]
            # Mostly the deepest carries it.
            depth = min(first + round(SINKS / STEP), depths)
            while depth > 0 and not _carries(pad, part, frames[i], aside, depth * STEP, force[i]):
                depth -= 1
            out[i] = out[i] or depth == 0


def would_sink(
    fields: PartFields,
    config: PadConfig,
    positions: Array,
    axes: Array,
    force: Array,
    aside: float,
) -> Bools:
    """Where a pad would sink by more than `SINKS` on a part that lies up to ``aside`` [m] to any side, shape
    (n,). What does not carry the force as deep as the part is modelled lets it sink.

    Args:
        fields: Distances of the drawn part, work frame.
        config: The pad.
        positions: Tool points on the part, work frame [m], shape (n, 3).
        axes: Unit tool axes from the part to the tool, shape (n, 3).
        force: Force to carry at each [N], shape (n,).
        aside: How far the part may lie aside [m].
    """
    part, pad = place_part(fields, np.eye(4), np.eye(4), axes[0]), build_pad(config)
    across = perpendicular(axes)
    frames = np.ascontiguousarray(np.stack([across, np.cross(-axes, across), -axes], axis=2))
    angles = 2.0 * np.pi * np.arange(SIDES) / SIDES
    shifts = aside * directions_at(angles)
    sinks = np.empty(len(axes), bool)
    _note_sinking(pad, part, frames, positions, force, shifts, round(fields.near.band / STEP), sinks)
    return sinks
