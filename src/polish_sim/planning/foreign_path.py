"""Whether a path made elsewhere lies on a part at all, and if not, why (ToolPath, Surface -> offsets, refusal)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import PlanError
from polish_sim.geometry import PartMesh, Surface
from polish_sim.planning.located import with_points_between
from polish_sim.planning.toolpath import ToolPath

Array = NDArray[np.float64]

UNITS = {"1000 times": 1e3, "25.4 times": 25.4, "10 times": 10.0}
EVEN = 0.2
"""A path is pressed in if its depth varies by less than this share of it."""


class Offset(NamedTuple):
    """How the points in contact lie to the part."""

    feet: Array
    """Closest points of the part [m], shape (n, 3)."""
    heights: Array
    """Along the tool axis [m], positive outside, shape (n,)."""
    sideways: Array
    """Across it [m], shape (n,): beyond the part's edge the pad hangs over, which is no fault of height."""


def offset_from(surface: Surface, path: ToolPath) -> Offset:
    """Measure how far the path in contact lies off a part.

    Args:
        surface: The whole part's surface.
        path: The path.

    Returns:
        The offsets.
    """
    path = with_points_between(path)
    points, axes = path.positions_work[path.process], path.axes_work[path.process]
    feet = surface.closest(points).positions
    gap = points - feet
    heights = (gap * axes).sum(axis=1)
    return Offset(feet, heights, np.linalg.norm(gap - heights[:, None] * axes, axis=1))


def check_on_part(offset: Offset, mesh: PartMesh, path: ToolPath, height: float, sideways: float) -> None:
    """Refuse a path that does not belong on a part.

    Args:
        offset: How it lies to the part.
        mesh: The part.
        path: The path.
        height: How far off the surface it may be along the tool axis [m].
        sideways: How far beyond the part's edge it may run [m].

    Raises:
        PlanError: It is further off; says by how much, and the likely reason.
    """
    if len(offset.heights) == 0:
        raise PlanError("the path has no points in contact. Mark points as 'process', or give x, y, z, i, j, k.")
    low, middle, high = np.percentile(offset.heights, [5.0, 50.0, 95.0])
    highest, furthest = float(np.abs(offset.heights).max()), float(offset.sideways.max())
    if highest <= height and furthest <= sideways:
        return
    away = (
        f"the path does not lie on '{mesh.name}': along the tool axis it is {1e3 * offset.heights.min():+.2f} to "
        f"{1e3 * offset.heights.max():+.2f} mm off the surface (median {1e3 * middle:+.2f} mm, allowed "
        f"{1e3 * height:g} mm), sideways up to {1e3 * furthest:.1f} mm. "
    )
    raise PlanError(away + _reason(mesh, path, float(middle), float(high - low), furthest, sideways))


def _reason(mesh: PartMesh, path: ToolPath, middle: float, spread: float, furthest: float, sideways: float) -> str:
    own = np.ptp(path.positions_work[path.process], axis=0)
    part = np.ptp(mesh.vertices, axis=0)
    ratio = float(own.max() / part.max())
    for text, factor in UNITS.items():
        if 0.3 < ratio / factor < 1.3:
            return f"It is about {text} as large as the part: another unit? Give the path in mm, or set --units."
        if 0.3 < ratio * factor < 1.3 and ratio < 0.2:
            return f"The part is about {text} as large as the path: another unit? Set --units."
    if furthest <= sideways and spread < EVEN * abs(middle):
        side = "pressed in already" if middle < 0.0 else "lifted off"
        return f"It is {side} by {1e3 * abs(middle):.2f} mm everywhere: give the path on the surface itself."
    size = " x ".join(f"{1e3 * value:.0f}" for value in own), " x ".join(f"{1e3 * value:.0f}" for value in part)
    return f"It measures {size[0]} mm, the part {size[1]} mm: made on another part, or in another frame?"
