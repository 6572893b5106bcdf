"""Tool poses along a path: z into the part, x along the feed or as steady as can be (ToolPath -> rotations)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import PlanError
from polish_sim.planning.toolpath import ToolPath
from polish_sim.spatial import rotation_to_axis, unit

Array = NDArray[np.float64]

ACROSS = 0.05
"""A feed direction whose part across the tool axis is smaller than this says nothing: the tool moves along its axis."""
STEEPEST = 0.99
"""The steady x axis must stay this far off every tool axis (cosine): 8 deg."""


def feed_frames(path: ToolPath) -> Array:
    """Tool frames with z into the part and x along the feed, the convention of ROS tool paths.

    Where the tool moves along its own axis (straight leads), x is that of the nearest point before that has one, at
    the start of the path that of the first.

    Args:
        path: The path.

    Returns:
        Rotations from tool to work frame, columns x, y, z, shape (n, 3, 3).
    """
    z = -path.axes_work
    feed = np.diff(path.positions_work, axis=0)
    feed = np.concatenate([feed, feed[-1:]])
    feed = unit(feed)
    across = feed - np.sum(feed * z, axis=1, keepdims=True) * z
    known = np.linalg.norm(across, axis=1) > ACROSS
    if not known.any():
        raise PlanError("the path runs along the tool axis only: no feed direction to turn the tool to.")
    # The last known row at or before each row; rows before the first take the first.
    source = np.maximum.accumulate(np.where(known, np.arange(len(z)), -1))
    source = np.where(source < 0, int(known.argmax()), source)
    x = across[source]
    x = unit(x - np.sum(x * z, axis=1, keepdims=True) * z)
    return np.stack([x, np.cross(z, x), z], axis=2)


def steady_frames(path: ToolPath) -> Array:
    """Tool frames with z into the part and x as near as can be to one of the work frame's axes.

    A round pad does not care how it is turned about its axis, but a robot's last joint does: with x along the feed
    every turn of a spiral would wind it once round.

    Args:
        path: The path.

    Returns:
        Rotations from tool to work frame, columns x, y, z, shape (n, 3, 3).

    Raises:
        PlanError: Tool axes point along all three axes of the work frame, so that no x axis is clear of them all.
    """
    along = np.abs(path.axes_work).max(axis=0)
    best = int(along.argmin())
    if along[best] > STEEPEST:
        raise PlanError(
            "tool axes point all around: along x, y and z of the work frame. One robot pass cannot reach that; "
            "plan a region that looks one way, e.g. --region top."
        )
    return rotation_to_axis(-path.axes_work, np.eye(3)[best])
