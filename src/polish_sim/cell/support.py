"""Where a pad has a hold, and where a part that lies a little aside would let it sink (fields, places ->
places).

At an edge the depth that carries the force is not a smooth function of the place: what the pad pushes aside
it no longer presses on, and a little further out nothing holds it. One part played in the cell says nothing
of one that is displaced to the other side. So the pad is pressed at rest, to all sides of every place.
"""

from __future__ import annotations

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.cell.contact import Pad, RealPart, build_pad, press_pad
from polish_sim.cell.real_part import PartFields, place_part
from polish_sim.config import PadConfig
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, kernel
from polish_sim.spatial import perpendicular

SIDES = 8  #: Directions in which the part may lie aside
SINKS = 0.001  #: Deeper than where the drawn part carries it a pad must not sink [m]
STEP = 5e-4  #: Between the depths that are looked at [m]


@kernel
def _carries(pad: Pad, part: RealPart, frame: Array, middle: Array, depth: float, force: float) -> bool:
    """Whether a pad of a pose ``frame`` (3, 3), ``middle`` (3,) pressed in by a ``depth`` carries a force."""
    still, pushed, torque, place = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
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
    deepest: float,
) -> Bools:
    """Where a pad would sink by more than `SINKS` on a part that lies up to ``aside`` [m] to any side, shape
    (n,).

    Args:
        fields: Distances of the drawn part, work frame.
        config: The pad.
        positions: Tool points on the part, work frame [m], shape (n, 3).
        axes: Unit tool axes from the part to the tool, shape (n, 3).
        force: Force to carry at each [N], shape (n,).
        aside: How far the part may lie aside [m].
        deepest: How deep the part is modelled [m]; what does not carry the force by then lets the pad sink.
    """
    part, pad = place_part(fields, np.eye(4), np.eye(4), axes[0]), build_pad(config)
    across = perpendicular(axes)
    frames = np.ascontiguousarray(np.stack([across, np.cross(-axes, across), -axes], axis=2))
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)
    shifts = aside * np.column_stack([np.cos(angles), np.sin(angles)])
    sinks = np.empty(len(axes), bool)
    _note_sinking(pad, part, frames, positions, force, shifts, round(deepest / STEP), sinks)
    return sinks
