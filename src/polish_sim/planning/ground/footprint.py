"""A region flat, as it is seen from where it looks, and how wide it is that way (Region -> Footprint)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from polish_sim.geometry import Region
from polish_sim.spatial import perpendicular, unit

Array = NDArray[np.float64]


class Footprint(NamedTuple):
    """A region's vertices seen along its up, and its widths square to each side of their convex hull."""

    frame: Array
    """Columns: the picture's two axes in the work frame, shape (3, 2); how they are turned means nothing."""
    points: Array
    """The vertices in the picture [m], shape (n, 2)."""
    ways: Array
    """Unit directions square to the hull's sides, in the picture, shape (k, 2)."""
    widths: Array
    """The region's width along each of them [m], shape (k,); the least of all widths is among them."""


def footprint(region: Region) -> Footprint:
    """Look at a region along its up.

    Args:
        region: The region.

    Returns:
        The picture; a region that is a line in it has one width, zero.
    """
    first = perpendicular(region.up)
    frame = np.stack([first, np.cross(region.up, first)], axis=1)
    flat = region.surface.vertices @ frame
    try:
        corners = flat[ConvexHull(flat).vertices]
    except QhullError:
        return Footprint(frame, flat, np.array([[1.0, 0.0]]), np.zeros(1))
    # The narrowest strip around a polygon lies along one of its sides.
    sides = unit(np.roll(corners, -1, axis=0) - corners)
    ways = np.stack([-sides[:, 1], sides[:, 0]], axis=1)
    return Footprint(frame, flat, ways, np.ptp(corners @ ways.T, axis=0))
