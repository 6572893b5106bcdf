"""Where a pad has a hold, and where a part that lies a little aside would let it sink (fields, places ->
places).

At an edge the depth that carries the force is not a smooth function of the place: what the pad pushes aside
it no longer presses on, and a little further out nothing holds it. One part played in the cell says nothing
of one that is displaced to the other side. So the pad is pressed at rest, to all sides of every place.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.cell.contact import Pad, RealPart, build_pad, press_pad
from polish_sim.cell.real_part import PartFields, place_part
from polish_sim.config import PadConfig
from polish_sim.kernels import kernel
from polish_sim.spatial import perpendicular

SIDES: Final = 8  #: Directions in which the part may lie aside
SINKS: Final = 0.001  #: Deeper than where the drawn part carries it a pad must not sink [m]
STEP: Final = 5e-4  #: Between the depths that are looked at [m]


@kernel
def _first_depth(
    pad: Pad, part: RealPart, frames: Array, middles: Array, force: Array, depths: Array, out: Array
) -> None:
    """The first of some depths (k,) [m] at which the pad carries a force (n,) [N], infinite for none, (n,).

    Poses before it is pressed in: ``frames`` (n, 3, 3), ``middles`` (n, 3) [m].
    """
    still, pushed, torque, place = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(len(middles)):
        out[i] = np.inf
        for depth in depths:
            for k in range(3):
                place[k] = middles[i, k] + depth * frames[i, k, 2]
            press_pad(pad, part, 0.0, frames[i], place, still, still, pushed, torque)
            if (
                -(pushed[0] * frames[i, 0, 2] + pushed[1] * frames[i, 1, 2] + pushed[2] * frames[i, 2, 2])
                >= force[i]
            ):
                out[i] = depth
                break


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
    depths = np.arange(1, round(deepest / STEP) + 1) * STEP
    shifts = [np.zeros_like(axes)]
    for angle in 2.0 * np.pi / SIDES * np.arange(SIDES):
        shifts.append(aside * (np.cos(angle) * frames[:, :, 0] + np.sin(angle) * frames[:, :, 1]))
    lowest = np.empty((len(shifts), len(axes)))
    for first, shift in zip(lowest, shifts, strict=True):
        _first_depth(pad, part, frames, positions + shift, force, depths, first)
    return np.asarray(~(lowest.max(axis=0) <= lowest[0] + SINKS) | np.isinf(lowest[0]))
