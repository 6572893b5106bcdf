"""Where the pad runs into the part beside what it polishes, as into a pocket's wall (path, whole part -> places)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import PadConfig
from polish_sim.errors import place_in_mm
from polish_sim.geometry import Surface
from polish_sim.planning.quality.exposure import rows_apart
from polish_sim.planning.quality.located import PathOnSurface
from polish_sim.planning.quality.standing_above import Discs, standing_above
from polish_sim.planning.toolpath import arc_length

Array = NDArray[np.float64]

APART = 0.25
"""The pad is looked at so many of its radii apart along the path."""
LAYER = 1.0
"""What stands higher above the pad's face than so many of its radii does not belong to a wall beside it."""
RIM_POINTS = 32
RINGS = (0.25, 0.5, 0.75, 1.0)
"""Where on the pad its own place's hollow and the tool's tilt are looked at."""


class PadInPart(NamedTuple):
    """Tool points at which the pad's disc is in the part."""

    positions: Array
    """[m], shape (k, 3)."""
    depths: Array
    """How deep it is [m], shape (k,)."""
    reaches: Array
    """How much further away from there the tool point would have to be [m], shape (k,)."""
    lengths: Array
    """Length of the path each stands for [m], shape (k,)."""
    pad_radius: float
    """[m]."""

    @property
    def max_m(self) -> float:
        """Deepest [m]; 0 if the pad is nowhere in the part."""
        return float(self.depths.max(initial=0.0))

    @property
    def length_m(self) -> float:
        """Length of the path on which the pad is in the part [m]."""
        return float(self.lengths.sum())

    @property
    def figures(self) -> dict[str, Any]:
        """For metrics.json; the place is empty if the pad is nowhere in the part."""
        at = self.positions[self.depths.argmax()].tolist() if len(self.depths) else []
        return {"pad_in_part_max_m": self.max_m, "pad_in_part_length_m": self.length_m, "pad_in_part_at_m": at}


def find_pad_in_part(on: PathOnSurface, part: Surface, pad: PadConfig) -> PadInPart:
    """Carry the pad's disc along the path and look for what of the part stands above its face.

    The pad yields as far as the force presses it, F / k, and over a hollow place or tilted as far as that place's
    curvatures and the tilt make it: what stands no higher than both together is polished, not run into, nor is what
    the pad is in no deeper than it yields. A place more hollow than the pad counts with the pad's radius;
    `measure_pad_reach` tells of it.

    Args:
        on: The path on its region.
        part: The whole part.
        pad: The pad.

    Returns:
        Where the pad is in the part.
    """
    s = arc_length(on.positions)
    rows = rows_apart(on, s, APART * pad.radius_m)
    yields = on.forces[rows] / pad.stiffness_n_m
    lows = _own_heights(on, rows, pad.radius_m) + yields
    discs = Discs(on.positions[rows], on.axes[rows], lows, lows + LAYER * pad.radius_m, pad.radius_m)
    found = standing_above(part, discs)
    way = np.where(np.diff(on.stretch_of[rows]) == 0, np.diff(s[rows]), 0.0)
    lengths = 0.5 * (np.append(way, 0.0) + np.append(0.0, way))
    hit = found.depths > yields
    return PadInPart(discs.middles[hit], found.depths[hit], found.reaches[hit], lengths[hit], pad.radius_m)


def _own_heights(on: PathOnSurface, rows: NDArray[np.int64], radius: float) -> Array:
    """How high the place under the pad stands above its face by its curvatures and the tool's tilt [m], (n,)."""
    second = np.cross(on.normals[rows], on.principal[rows])
    lean = on.axes[rows] / (on.axes[rows] * on.normals[rows]).sum(axis=1, keepdims=True)
    tilt, beside = ((lean * way).sum(axis=1)[:, None] for way in (on.principal[rows], second))
    bend = np.maximum(on.curvatures[rows], -1.0 / radius)
    angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
    highest = np.zeros(len(rows))
    for ring in RINGS:
        x, y = ring * radius * np.cos(angle), ring * radius * np.sin(angle)
        height = tilt * x + beside * y - 0.5 * (bend[:, :1] * x**2 + bend[:, 1:] * y**2)
        highest = np.maximum(highest, height.max(axis=1))
    return highest


def pad_in_part_warning(figures: Mapping[str, Any]) -> str:
    """The figures as a sentence with the worst place; empty if the pad is nowhere in the part."""
    deepest = figures.get("pad_in_part_max_m", 0.0)
    if deepest <= 0.0:
        return ""
    length, place = figures["pad_in_part_length_m"], place_in_mm(np.array(figures["pad_in_part_at_m"]))
    return f"the pad runs up to {1e3 * deepest:.3g} mm into the part over {length:.3g} m of the path, worst at {place}"
