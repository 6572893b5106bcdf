"""A region made ready for planning: small holes closed by smooth patches, continued past its border for a pad
whose middle leaves the part, finely triangulated (Region -> Ground)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from polish_sim.arrays import Array, Indices, next_corners, norms, running_sums
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import Region
from polish_sim.geometry.bezier import edge_control, edge_middle, quadratic_normals
from polish_sim.geometry.cut import Clipped
from polish_sim.geometry.regions.patches import join
from polish_sim.geometry.surface import Surface, boundary_loops, build_surface, trace_border
from polish_sim.geometry.topology import find_adjacency
from polish_sim.planning.ground.triangulation import Triangulation, triangulate
from polish_sim.spatial import into_plane, perpendicular, unit


class Bridged(NamedTuple):
    """A region without its small holes."""

    region: Region  #: The region; facets after its own ones close holes and lie on no part of the part
    facets: int  #: Number of facets that are the part's
    holes: int  #: Number of holes closed


class _Rim(NamedTuple):
    """Border edges around a hole, in order: from corner ``edge`` of ``facet`` to the next corner."""

    facet: Indices
    edge: Indices


def bridge_holes(region: Region, widest: float) -> Bridged:
    """Close the holes of a region a pad bridges, up to the diameter ``widest`` [m]."""
    surface = region.surface
    rims = [_Rim(*np.array(loop, dtype=np.int64).T) for loop in trace_border(surface)]
    rims = [rim for rim in rims if _diameter(surface, rim) <= widest]
    if not rims or len(rims) == len(region.boundary_loops):
        return Bridged(region, len(surface.faces), 0)
    for rim in rims:
        surface = _close(surface, rim)
    loops = boundary_loops(surface)
    return Bridged(
        replace(region, surface=surface, boundary_loops=loops), len(region.surface.faces), len(rims)
    )


def _diameter(surface: Surface, rim: _Rim) -> float:
    points = surface.control[rim.facet, rim.edge]
    return 2.0 * float(norms(points - points.mean(axis=0)).max())


def _close(surface: Surface, rim: _Rim) -> Surface:
    """Add a fan of patches around the middle of a hole, tangent to the surface at its rim."""
    ahead = (rim.edge + 1) % 3
    first, second = surface.control[rim.facet, rim.edge], surface.control[rim.facet, ahead]
    first_normal = unit(surface.normal_control[rim.facet, rim.edge])
    second_normal = unit(surface.normal_control[rim.facet, ahead])
    middle, middle_normal = _middle(first, first_normal)
    count = len(first)
    middles, middle_normals = np.tile(middle, (count, 1)), np.tile(middle_normal, (count, 1))
    # Corners run against the rim: second, first, middle.
    corners = np.stack([second, first, middles], axis=1)
    corner_normals = np.stack([second_normal, first_normal, middle_normals], axis=1)
    inwards = _edge_point(first, middles, first_normal, middle_normals)
    outwards = _edge_point(middles, second, middle_normals, second_normal)
    along = surface.control[rim.facet, 3 + rim.edge]
    shape_first, shape_second = surface.shape[rim.facet, rim.edge], surface.shape[rim.facet, ahead]
    shape_middle = np.tile(shape_first.mean(axis=0), (count, 1))
    centre = len(surface.vertices)
    ids = surface.faces[rim.facet]
    rows = np.arange(count)
    fan = np.stack([ids[rows, ahead], ids[rows, rim.edge], np.full(count, centre)], axis=1)
    faces = np.concatenate([surface.faces, fan]).astype(np.int32)
    adjacency = find_adjacency(faces)
    smooth = np.concatenate([surface.smooth, np.zeros((count, 3), dtype=bool)])
    return build_surface(
        vertices=np.concatenate([surface.vertices, middle[None]]),
        faces=faces,
        control=np.concatenate(
            [surface.control, np.concatenate([corners, np.stack([along, inwards, outwards], axis=1)], axis=1)]
        ),
        normal_control=np.concatenate([surface.normal_control, quadratic_normals(corners, corner_normals)]),
        shape=np.concatenate([surface.shape, np.stack([shape_second, shape_first, shape_middle], axis=1)]),
        adjacency=adjacency,
        smooth=smooth,
    )


def _middle(points: Array, normals: Array) -> tuple[Array, Array]:
    """Middle of a hole: mean of the Hermite curves' mid-points between rim points half the rim apart."""
    across = np.roll(np.arange(len(points)), -(len(points) // 2))
    normal = unit(normals.mean(axis=0)[None])[0]
    chords = points[across] - points
    start, end = unit(into_plane(chords, normals)), unit(into_plane(chords, normals[across]))
    halfway = edge_middle(points, points[across], start, end)
    return halfway.mean(axis=0), normal


def _edge_point(start: Array, end: Array, start_normal: Array, end_normal: Array) -> Array:
    """Control point of the curve between two points along the surface (paper 1, eq. 3, 4)."""
    chord = end - start
    return edge_control(
        start, end, unit(into_plane(chord, start_normal)), unit(into_plane(chord, end_normal))
    )


EDGES_PER_STEPOVER = 3.0


class Piece(NamedTuple):
    """A connected component, its small holes closed."""

    region: Region
    mesh: Triangulation  #: Its fine triangulation
    part_facets: int  #: Number of facets that are the part's; those after them close holes


class Ground(NamedTuple):
    """A region made ready to be planned on."""

    region: Region  #: The region, its small holes closed
    mesh: Triangulation  #: Its fine triangulation
    part_facets: int  #: Number of facets that are the part's; those after them close holes
    holes: int  #: Number of holes closed
    pieces: tuple[Piece, ...]  #: Its connected components, the largest first; a pattern covers one at a time


def prepare_ground(region: Region, plan: PlanConfig) -> Ground:
    """Close small holes and triangulate finely enough to separate the turns.

    Raises:
        PlanError: The region, or a piece of it, has no border, or the step-over is not positive or larger
            than it.
    """
    size = np.linalg.norm(np.diff(region.surface.bounds, axis=0))
    if not 0.0 < plan.stepover_m < size:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm does not fit: it must be positive and smaller "
            f"than the region, which measures {size * 1e3:.4g} mm across. Set another step-over."
        )
    pieces = []
    holes = 0
    for component in region.components():
        if not component.boundary_loops:
            raise PlanError(
                "the region is closed all round, a path needs a border to start from. "
                "Choose a region that looks one way, e.g. 'top', or a box."
            )
        bridged = bridge_holes(component, plan.bridge_m)
        ground = with_skirt(bridged.region, plan.overrun_m)
        mesh = triangulate(ground.surface, plan.stepover_m / EDGES_PER_STEPOVER)
        pieces.append(Piece(ground, mesh, bridged.facets))
        holes += bridged.holes
    if len(pieces) == 1:
        return Ground(*pieces[0], holes, tuple(pieces))
    return _together(region, pieces, holes)


def _together(region: Region, pieces: Sequence[Piece], holes: int) -> Ground:
    """Ground of several pieces: their surfaces and triangles side by side, facets that close holes last."""
    surfaces = [piece.region.surface for piece in pieces]
    firsts = running_sums([len(surface.faces) for surface in surfaces])
    own = [first + np.arange(piece.part_facets) for first, piece in zip(firsts, pieces, strict=False)]
    added = [
        np.arange(a + piece.part_facets, b) for a, b, piece in zip(firsts, firsts[1:], pieces, strict=False)
    ]
    order = np.concatenate([*own, *added])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    beside = join(
        [Clipped(surface, np.arange(len(surface.faces), dtype=np.int32)) for surface in surfaces]
    ).surface
    joined = Region(
        surface=beside.restrict(order.astype(np.int32)),
        facets=np.concatenate([piece.region.facets[: piece.part_facets] for piece in pieces]),
        boundary_loops=tuple(loop for piece in pieces for loop in piece.region.boundary_loops),
        area_m2=sum(piece.region.area_m2 for piece in pieces),
        up=region.up,
    )
    meshes = [piece.mesh for piece in pieces]
    starts = running_sums([len(mesh.vertices) for mesh in meshes])
    mesh = Triangulation(
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        triangles=np.concatenate(
            [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
        ),
        areas=np.concatenate([mesh.areas for mesh in meshes]),
        owners=place[
            np.concatenate([mesh.owners + first for mesh, first in zip(meshes, firsts, strict=False)])
        ],
    )
    return Ground(joined, mesh, sum(piece.part_facets for piece in pieces), holes, tuple(pieces))


# A region flat, as it is seen from where it looks, and how wide it is that way (Region -> Footprint).


class Footprint(NamedTuple):
    """A region's vertices seen along its up, and its widths square to each side of their convex hull."""

    #: Columns: the picture's two axes in the work frame, shape (3, 2); how they are turned means nothing
    frame: Array
    points: Array  #: The vertices in the picture [m], shape (n, 2)
    ways: Array  #: Unit directions square to the hull's sides, in the picture, shape (k, 2)
    #: The region's width along each of them [m], shape (k,); the least of all widths is among them
    widths: Array


def footprint(region: Region) -> Footprint:
    """Look at a region along its up; one that is a line in this picture has one width, zero."""
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


#: Least cosine of half the turn at a corner of the border that is continued to a point [-]
SHARPEST = 0.6


def with_skirt(region: Region, width: float) -> Region:
    """Continue a region past its border by ``width`` [m], straight ahead in its tangent planes; with 0
    it stays as it is.

    The facets added come last and lie on no part of the part; its area stays that of the part.
    """
    if not width:
        return region
    surface = region.surface
    for loop in trace_border(surface):
        facet, edge = np.array(loop, dtype=np.int64).T
        surface = _continued(surface, facet, edge, width)
    return replace(region, surface=surface, boundary_loops=boundary_loops(surface))


def _continued(surface: Surface, facet: Indices, edge: Indices, width: float) -> Surface:
    """Add two flat facets beyond each edge of one loop of the border."""
    ahead = (edge + 1) % 3
    inner, normals = surface.control[facet, edge], unit(surface.normal_control[facet, edge])
    outer = inner + width * _outwards(inner, normals)
    count, first = len(facet), len(surface.vertices)
    here, there = surface.faces[facet, edge], surface.faces[facet, ahead]
    out = first + np.arange(count)
    after = np.roll(out, -1)
    faces = np.concatenate([np.stack([there, here, out], axis=1), np.stack([there, out, after], axis=1)])
    places, upright = np.concatenate([surface.vertices, outer]), np.empty((first + count, 3))
    upright[here], upright[out] = normals, normals
    corners = places[faces]
    middles = 0.5 * (corners + next_corners(corners))
    middles[:count, 0] = surface.control[facet, 3 + edge]
    bend, ahead_bend = surface.shape[facet, edge], surface.shape[facet, ahead]
    return build_surface(
        vertices=places,
        faces=(joined := np.concatenate([surface.faces, faces]).astype(np.int32)),
        control=np.concatenate([surface.control, np.concatenate([corners, middles], axis=1)]),
        normal_control=np.concatenate([surface.normal_control, quadratic_normals(corners, upright[faces])]),
        shape=np.concatenate([surface.shape, np.stack([ahead_bend, bend, bend], axis=1),
                              np.stack([ahead_bend, bend, ahead_bend], axis=1)]),
        adjacency=find_adjacency(joined),
        smooth=np.concatenate([surface.smooth, np.zeros((2 * count, 3), dtype=bool)]),
    )  # fmt: skip


def _outwards(points: Array, normals: Array) -> Array:
    """Away from the surface at the corners of a border (n, 3) with the surface on its left, shape (n, 3).

    At a corner it is longer, so that both sides are continued equally far.
    """
    along = unit(np.roll(points, -1, axis=0) - points)
    sides = unit(np.cross(along, normals))
    before = np.roll(sides, 1, axis=0)
    middle = unit(sides + before)
    return middle / np.maximum((middle * sides).sum(axis=1, keepdims=True), SHARPEST)
