"""Whether the tool runs into the part on its way through the air (moves -> depths)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry import Surface
from polish_sim.geometry.distance.signed_distance import signed_distances

Array = NDArray[np.float64]

RIM_POINTS = 24


def rim_depths(surface: Surface, positions: Array, axes: Array, radius: float) -> Array:
    """How deep the middle or the rim of the pad's face stands in the part.

    Args:
        surface: The part.
        positions: Tool points [m], shape (n, 3).
        axes: Unit tool axes, shape (n, 3).
        radius: The pad's [m]; 0 looks at the tool point only.

    Returns:
        Depths [m], 0 where it is clear, shape (n,).
    """
    points = positions[:, None]
    if radius > 0.0:
        first = _beside(surface, axes)
        second = np.cross(axes, first)
        angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
        rim = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        points = np.concatenate([points, points + radius * rim], axis=1)
    depth = -signed_distances(surface, points.reshape(-1, 3)).reshape(points.shape[:2])
    return np.asarray(np.maximum(depth, 0.0).max(axis=1))


def _beside(surface: Surface, axes: Array) -> Array:
    """Unit vectors square to axes (n, 3) that turn with the part, as the coordinate axes would not."""
    ways = surface.vertices[:3] - surface.vertices.mean(axis=0)
    square = np.cross(axes[:, None], ways)
    size = np.linalg.norm(square, axis=2)
    # The first that is long enough: rounding does not choose among equals.
    chosen = (size > 0.5 * size.max(axis=1, keepdims=True)).argmax(axis=1)
    rows = np.arange(len(axes))
    return np.asarray(square[rows, chosen] / size[rows, chosen][:, None])
