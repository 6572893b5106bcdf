"""Marks on a part that are touched to find it: well apart, on what is to be worked on (layer 9)."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry import Region, Surface
from polish_sim.spatial import perpendicular, rotation_to_axis, transform

Array = NDArray[np.float64]

INSIDE: Final = 0.9
"""How far out from the middle, of the way to the edge: a pointer does not find an edge itself."""
NARROW: Final = 0.1
"""A region this narrow for its length tells no turn about it: the marks are then all over the part."""


def marks_on(region: Region, surface: Surface, count: int) -> Array:
    """Points far apart in directions evenly spread about the middle, with a tool that stands upon them.

    Args:
        region: What is to be worked on.
        surface: The whole part.
        count: Number of marks.

    Returns:
        T_work_tool, the tool's z axis into the part, shape (count, 4, 4).
    """
    for candidate in (region.surface, surface):
        points = candidate.vertices[np.unique(candidate.faces)]
        middle = points.mean(axis=0)
        _, widths, axes = np.linalg.svd(points - middle, full_matrices=False)
        if widths[1] > NARROW * widths[0]:
            break
    angle = 2.0 * np.pi * np.arange(count) / count
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ axes[:2]
    outmost = points[np.argmax((points - middle) @ directions.T, axis=0)]
    there = candidate.closest(middle + INSIDE * (outmost - middle))
    R = [rotation_to_axis(-normal[None], perpendicular(normal))[0] for normal in there.normals]
    return transform(np.stack(R), there.positions)
