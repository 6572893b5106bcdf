"""Whether a path made elsewhere lies on a part at all, and if not, why (ToolPath, Surface -> offsets, refusal)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.errors import PlanError
from polish_sim.geometry import PartMesh, Surface
from polish_sim.planning.quality.located import with_points_between
from polish_sim.planning.toolpath import ToolPath

UNITS = {"1000 times": 1e3, "25.4 times": 25.4, "10 times": 10.0}
EVEN = 0.2
"""A path is pressed in if its depth stays within this share of the median ..."""
MOSTLY = 0.6
"""... along this share of it."""
SLACK, LEAST_SHARE = 0.1, 0.3
"""In the right unit a path runs at most this share of the part's size beyond it, and measures at least that share."""


class Offset(NamedTuple):
    """How the points in contact lie to the part."""

    feet: Array
    """Closest points of the part [m], shape (n, 3)."""
    heights: Array
    """Along the tool axis [m], positive outside, shape (n,)."""
    sideways: Array
    """Across it [m], shape (n,): beyond the part's edge the pad hangs over, which is no fault of height."""
    outward: float
    """Share of the points whose tool axis points out of the part."""


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
    found = surface.closest(points)
    gap = points - found.positions
    heights = (gap * axes).sum(axis=1)
    outward = float(((axes * found.normals).sum(axis=1) > 0.0).mean()) if len(axes) else 0.0
    return Offset(found.positions, heights, np.linalg.norm(gap - heights[:, None] * axes, axis=1), outward)


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
    middle = float(np.median(offset.heights))
    highest, furthest = float(np.abs(offset.heights).max()), float(offset.sideways.max())
    if highest <= height and furthest <= sideways:
        if offset.outward < 0.5:
            todo = _other_unit(mesh, path) or "Turn the axes round (-i, -j, -k)."
            raise PlanError(
                f"the tool axis points into '{mesh.name}' along {100.0 * (1.0 - offset.outward):.0f}% of the path, "
                f"wanted: from the part to the tool, as CLDATA. {todo}"
            )
        return
    away = (
        f"the path does not lie on '{mesh.name}': along the tool axis it is {1e3 * offset.heights.min():+.2f} to "
        f"{1e3 * offset.heights.max():+.2f} mm off the surface (median {1e3 * middle:+.2f} mm, allowed "
        f"{1e3 * height:g} mm), sideways up to {1e3 * furthest:.1f} mm. "
    )
    even = np.abs(offset.heights - middle) < EVEN * abs(middle)
    raise PlanError(away + (_other_unit(mesh, path) or _reason(mesh, path, middle, float(even.mean()))))


def _other_unit(mesh: PartMesh, path: ToolPath) -> str:
    """Advice if the path would fit the part in place and size in another unit; else empty."""
    box = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
    points = path.positions_work[path.process]
    own = np.stack([points.min(axis=0), points.max(axis=0)])
    size = float(np.ptp(box, axis=0).max())
    for text, factor in UNITS.items():
        for scale, larger, smaller in ((factor, "part", "path"), (1.0 / factor, "path", "part")):
            beyond = max(float((box[0] - scale * own[0]).max()), float((scale * own[1] - box[1]).max()))
            if beyond < SLACK * size and scale * float(np.ptp(own, axis=0).max()) > LEAST_SHARE * size:
                return (
                    f"The {larger} is about {text} as large as the {smaller}: another unit? "
                    "Give it in mm, or set --units."
                )
    return ""


def _reason(mesh: PartMesh, path: ToolPath, middle: float, even: float) -> str:
    if even > MOSTLY:
        side = "pressed in already" if middle < 0.0 else "lifted off"
        return f"It is {side} by {1e3 * abs(middle):.2f} mm along most of it: give the path on the surface itself."
    sizes = _extent(path), np.ptp(mesh.vertices, axis=0)
    own, part = (" x ".join(f"{1e3 * value:.0f}" for value in size) for size in sizes)
    return f"It measures {own} mm, the part {part} mm: made on another part, or in another frame?"


def _extent(path: ToolPath) -> Array:
    """Size of the path in contact along x, y and z [m], shape (3,)."""
    return np.asarray(np.ptp(path.positions_work[path.process], axis=0))
