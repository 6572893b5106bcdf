"""A region made ready to be planned on: piece by piece, small holes closed, finely triangulated (Region -> Ground)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from polish_sim.arrays import Array
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import Region
from polish_sim.geometry.cut import Clipped
from polish_sim.geometry.regions.patches import join
from polish_sim.planning.ground.holes import bridge_holes
from polish_sim.planning.ground.triangulation import Triangulation, triangulate
from polish_sim.spatial import perpendicular, unit

EDGES_PER_STEPOVER = 3.0


class Piece(NamedTuple):
    """A connected component, its small holes closed."""

    region: Region
    mesh: Triangulation
    """Its fine triangulation."""
    part_facets: int
    """Number of facets that are the part's; those after them close holes."""


class Ground(NamedTuple):
    """A region made ready to be planned on."""

    region: Region
    """The region, its small holes closed."""
    mesh: Triangulation
    """Its fine triangulation."""
    part_facets: int
    """Number of facets that are the part's; those after them close holes."""
    holes: int
    """Number of holes closed."""
    pieces: tuple[Piece, ...]
    """Its connected components, the largest first; a pattern covers one at a time."""


def prepare_ground(region: Region, plan: PlanConfig) -> Ground:
    """Close small holes and triangulate finely enough to tell turns apart.

    Raises:
        PlanError: The region, or a piece of it, has no border, or the step-over is not positive or larger than it.
    """
    size = float(np.linalg.norm(np.diff(region.surface.bounds, axis=0)))
    if not 0.0 < plan.stepover_m < size:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm does not fit: it must be positive and smaller than the "
            f"region, which measures {size * 1e3:.4g} mm across. Set another step-over."
        )
    pieces, holes = [], 0
    for component in region.components():
        if not component.boundary_loops:
            raise PlanError(
                "the region is closed all round, a path needs a border to start from. "
                "Choose a region that looks one way, e.g. 'top', or a box."
            )
        bridged = bridge_holes(component, plan.bridge_m)
        mesh = triangulate(bridged.region.surface, plan.stepover_m / EDGES_PER_STEPOVER)
        pieces.append(Piece(bridged.region, mesh, bridged.facets))
        holes += bridged.holes
    if len(pieces) == 1:
        return Ground(*pieces[0], holes, tuple(pieces))
    return _together(region, pieces, holes)


def _together(region: Region, pieces: Sequence[Piece], holes: int) -> Ground:
    """Ground of several pieces: their surfaces and triangles side by side, facets that close holes last."""
    surfaces = [piece.region.surface for piece in pieces]
    firsts = np.cumsum([0] + [len(surface.faces) for surface in surfaces])
    own = [first + np.arange(piece.part_facets) for first, piece in zip(firsts, pieces, strict=False)]
    added = [np.arange(a + piece.part_facets, b) for a, b, piece in zip(firsts, firsts[1:], pieces, strict=False)]
    order = np.concatenate([*own, *added])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    beside = join([Clipped(surface, np.arange(len(surface.faces), dtype=np.int32)) for surface in surfaces]).surface
    joined = Region(
        surface=beside.restrict(order.astype(np.int32)),
        facets=np.concatenate([piece.region.facets[: piece.part_facets] for piece in pieces]),
        boundary_loops=tuple(loop for piece in pieces for loop in piece.region.boundary_loops),
        area_m2=sum(piece.region.area_m2 for piece in pieces),
        up=region.up,
    )
    meshes = [piece.mesh for piece in pieces]
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    mesh = Triangulation(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]),
        areas=np.concatenate([mesh.areas for mesh in meshes]),
        owners=place[np.concatenate([mesh.owners + first for mesh, first in zip(meshes, firsts, strict=False)])],
    )
    return Ground(joined, mesh, sum(piece.part_facets for piece in pieces), holes, tuple(pieces))


# A region flat, as it is seen from where it looks, and how wide it is that way (Region -> Footprint).


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
