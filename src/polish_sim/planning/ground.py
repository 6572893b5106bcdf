"""A region made ready for planning: small holes closed by smooth patches, continued past its border for a pad
whose middle leaves the part, finely triangulated (Region -> Ground)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    crosses,
    dots,
    into_plane,
    joined,
    next_corners,
    norms,
    plane_axes,
    running_sums,
    unit,
)
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import Region
from polish_sim.geometry.bezier import edge_along, edge_middle, quadratic_normals
from polish_sim.geometry.cut import ALIKE, CutFacets, find_edges, halve_edges, whole_facets
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.surface import Surface, build_surface, join_surfaces
from polish_sim.geometry.topology import (
    counting_order,
    facets_at_edges,
    find_adjacency,
    label_within,
    trace_border,
)


def bridge_holes(region: Region, widest: float) -> tuple[Region, int]:
    """Close the holes of a region a pad bridges, up to the diameter ``widest`` [m], and count them.

    Facets after its own ones close holes and lie on no part of the part.
    """
    surface = region.surface
    loops = [loop.T for loop in trace_border(surface.adjacency)]
    rims = [rim for rim in loops if _diameter(surface.control[tuple(rim)]) <= widest]
    if len(rims) == len(loops):
        return region, 0
    for rim in rims:
        surface = _close(surface, *rim)
    return replace(region, surface=surface), len(rims)


def _diameter(points: Array) -> float:
    return 2.0 * norms(points - points.mean(axis=0)).max()


def _close(surface: Surface, facet: Indices, edge: Indices) -> Surface:
    """Add a fan of patches around the middle of a hole, tangent to the surface at its rim: edges from corner
    ``edge`` of ``facet`` to the next corner, in order."""
    ahead = (edge + 1) % 3
    first, second = surface.control[facet, edge], surface.control[facet, ahead]
    first_normal = unit(surface.normal_control[facet, edge])
    second_normal = unit(surface.normal_control[facet, ahead])
    middle, middle_normal = _middle(first, first_normal)
    count = len(first)
    middles, middle_normals = np.tile(middle, (count, 1)), np.tile(middle_normal, (count, 1))
    # Corners run against the rim: second, first, middle.
    corners = np.stack([second, first, middles], axis=1)
    inwards = edge_along(first, middles, first_normal, middle_normals)
    outwards = edge_along(middles, second, middle_normals, second_normal)
    along = surface.control[facet, 3 + edge]
    bends = surface.shape[facet, ahead], surface.shape[facet, edge]
    centre = np.full(count, len(surface.vertices))
    return _with_facets(
        surface,
        np.stack([surface.faces[facet, ahead], surface.faces[facet, edge], centre], axis=1),
        vertices=middle[None],
        control=np.concatenate([corners, np.stack([along, inwards, outwards], axis=1)], axis=1),
        normal_control=quadratic_normals(
            corners, np.stack([second_normal, first_normal, middle_normals], axis=1)
        ),
        shape=np.stack([*bends, np.tile(bends[1].mean(axis=0), (count, 1))], axis=1),
    )


def _with_facets(surface: Surface, faces: Indices, **more: Array) -> Surface:
    """A surface with more vertices behind its own, and facets whose edges are not smooth; ``more``: vertices
    and control values by the names a surface has for its own."""
    more["smooth"] = np.zeros((len(faces), 3), dtype=bool)
    whole = {name: np.concatenate([getattr(surface, name), added]) for name, added in more.items()}
    together = np.concatenate([surface.faces, faces]).astype(np.int32)
    return build_surface(faces=together, adjacency=find_adjacency(together), **whole)


def _middle(points: Array, normals: Array) -> tuple[Array, Array]:
    """Middle of a hole: mean of the Hermite curves' mid-points between rim points half the rim apart."""
    across = np.roll(np.arange(len(points)), -(len(points) // 2))
    normal = unit(normals.mean(axis=0))
    chords = points[across] - points
    start, end = unit(into_plane(chords, normals)), unit(into_plane(chords, normals[across]))
    halfway = edge_middle(points, points[across], start, end)
    return halfway.mean(axis=0), normal


EDGES_PER_STEPOVER = 3.0


@dataclass(frozen=True, eq=False)
class Ground:
    """A region made ready to be planned on."""

    region: Region  #: The region, its small holes closed
    mesh: Triangulation  #: Its fine triangulation
    of_part: Bools  #: Facets that are the part's, not those that close its holes or continue it, shape (m,)
    holes: int  #: Number of holes closed
    parts: tuple[Ground, ...] = ()

    @property
    def pieces(self) -> tuple[Ground, ...]:
        """Its connected components, the largest first; a pattern covers one at a time."""
        return self.parts or (self,)

    @cached_property
    def triangle_areas(self) -> Array:
        """Areas of the triangles, 0 where they are not the part's [m^2], shape (t,)."""
        return np.where(self.of_part[self.mesh.owners], self.mesh.areas, 0.0)

    @cached_property
    def part_areas(self) -> Array:
        """What of the part each vertex stands for: a third of the triangles around it [m^2], shape (v,)."""
        return self.mesh.at_vertices(self.triangle_areas)


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
    parts = []
    for component in region.components():
        if not component.surface.is_open:
            raise PlanError(
                "the region is closed all round, a path needs a border to start from. "
                "Choose a region that looks one way, e.g. 'top', or a box."
            )
        bridged, holes = bridge_holes(component, plan.bridge_m)
        ground = with_skirt(bridged, plan.overrun_m)
        mesh = triangulate(ground.surface, plan.stepover_m / EDGES_PER_STEPOVER)
        of_part = np.arange(len(ground.surface.faces)) < len(component.surface.faces)
        parts.append(Ground(ground, mesh, of_part, holes))
    return parts[0] if len(parts) == 1 else _together(region, parts)


def _together(region: Region, parts: Sequence[Ground]) -> Ground:
    """Ground of several pieces: their surfaces and triangles side by side."""
    regions, meshes = [part.region for part in parts], [part.mesh for part in parts]
    surfaces = [part.surface for part in regions]
    whole = Region(
        surface=join_surfaces(surfaces),
        facets=np.concatenate([part.facets for part in regions]),
        area_m2=sum(part.area_m2 for part in regions),
        up=region.up,
    )
    facets = running_sums([len(surface.faces) for surface in surfaces])[:-1]
    vertices = running_sums([len(mesh.vertices) for mesh in meshes])[:-1]
    columns = joined(
        (mesh.vertices, mesh.normals, mesh.triangles + vertex, mesh.areas, mesh.owners + facet)
        for mesh, vertex, facet in zip(meshes, vertices, facets, strict=True)
    )
    of_part = np.concatenate([part.of_part for part in parts])
    return Ground(whole, Triangulation(*columns), of_part, sum(part.holes for part in parts), tuple(parts))


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
    frame = np.stack(plane_axes(region.up), axis=1)
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
    for loop in trace_border(surface.adjacency):
        facet, edge = loop.T
        surface = _continued(surface, facet, edge, width)
    return replace(region, surface=surface)


def _continued(surface: Surface, facet: Indices, edge: Indices, width: float) -> Surface:
    """Add two flat facets beyond each edge of one loop of the border."""
    ahead = (edge + 1) % 3
    inner, normals = surface.control[facet, edge], unit(surface.normal_control[facet, edge])
    outer = inner + width * _outwards(inner, normals)
    here, there = surface.faces[facet, edge], surface.faces[facet, ahead]
    count = len(surface.vertices)
    out = count + np.arange(len(facet))
    after = np.roll(out, -1)
    faces = np.concatenate([np.stack([there, here, out], axis=1), np.stack([there, out, after], axis=1)])
    places = np.concatenate([surface.vertices, outer])
    upright = np.empty((len(surface.vertices) + len(out), 3))
    upright[here], upright[out] = normals, normals
    corners = places[faces]
    middles = 0.5 * (corners + next_corners(corners))
    middles[: len(out), 0] = surface.control[facet, 3 + edge]
    bend, ahead_bend = surface.shape[facet, edge], surface.shape[facet, ahead]
    return _with_facets(
        surface,
        faces,
        vertices=outer,
        control=np.concatenate([corners, middles], axis=1),
        normal_control=quadratic_normals(corners, upright[faces]),
        shape=np.concatenate(
            [np.stack([ahead_bend, bend, bend], axis=1), np.stack([ahead_bend, bend, ahead_bend], axis=1)]
        ),
    )


def _outwards(points: Array, normals: Array) -> Array:
    """Away from the surface at the corners of a border (n, 3) with the surface on its left, shape (n, 3).

    At a corner it is longer, so that both sides are continued equally far.
    """
    along = unit(np.roll(points, -1, axis=0) - points)
    sides = unit(crosses(along, normals))
    before = np.roll(sides, 1, axis=0)
    middle = unit(sides + before)
    return middle / np.maximum(dots(middle, sides)[:, None], SHARPEST)


MAX_TRIANGLES = 1_500_000
#: Every round halves the longest edges; patches that do not fit each other end the splitting here
MOST_ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangles no longer than a chosen edge, their vertices exactly on the surface."""

    vertices: Array  #: Points on the surface [m], shape (n, 3)
    normals: Array  #: Unit outward normals, shape (n, 3)
    triangles: Indices  #: Vertex indices, counter-clockwise from outside, shape (m, 3)
    areas: Array  #: Areas [m^2], shape (m,)
    owners: Indices  #: Facet of the surface each triangle lies on, shape (m,)

    @cached_property
    def edges(self) -> Indices:
        """Every edge once, shape (e, 2)."""
        return find_edges(self.triangles).ends

    @cached_property
    def border(self) -> Indices:
        """Directed edges with a triangle on their left only, shape (b, 2)."""
        ends = np.stack([self.triangles, next_corners(self.triangles)], axis=2).swapaxes(0, 1)
        return ends[(facets_at_edges(self.triangles) == 1).T]

    @cached_property
    def around(self) -> tuple[Indices, Indices]:
        """Triangles vertex by vertex: where those around each vertex begin, (n + 1,), and they, (3 m,)."""
        counts = np.bincount(self.triangles.ravel(), minlength=len(self.vertices))
        members = counting_order(self.triangles.ravel(), len(self.vertices)) // 3
        return running_sums(counts), members.astype(np.int64)

    @cached_property
    def vertex_areas(self) -> Array:
        """A third of the area of every triangle around a vertex [m^2], shape (n,)."""
        return self.at_vertices(self.areas)

    def at_vertices(self, areas: Array) -> Array:
        """A third of the areas of triangles (t,) around each vertex [m^2], shape (n,)."""
        weights = np.repeat(areas / 3.0, 3)
        return np.asarray(np.bincount(self.triangles.ravel(), weights=weights, minlength=len(self.vertices)))

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over the vertices."""
        return cKDTree(self.vertices)

    def components(self, inside: Bools) -> tuple[int, Indices]:
        """Connected pieces of a set of vertices: their number and each vertex's piece, -1 outside, (n,)."""
        return label_within(self.edges, inside)


def triangulate(surface: Surface, longest_edge: float) -> Triangulation:
    """Split the patches of a surface without gaps until no edge is longer than ``longest_edge`` [m].

    Raises:
        PlanError: It would need too many triangles.
    """
    wanted = 2.0 * surface.facet_areas.sum() / (0.5 * longest_edge) ** 2
    if wanted > 4 * MAX_TRIANGLES:
        raise PlanError(
            f"the region ({surface.facet_areas.sum() * 1e4:.4g} cm^2) is too large for so fine a step-over: "
            f"triangles of {longest_edge * 1e3:.3g} mm would be needed. Set a larger step-over or a smaller "
            "region."
        )
    cut, vertices = whole_facets(surface, np.arange(len(surface.faces), dtype=np.int32)), surface.vertices
    for _ in range(MOST_ROUNDS):
        long = _long_edges(vertices, cut.faces, longest_edge)
        if not long.any() or len(cut.faces) > 2 * MAX_TRIANGLES:
            break
        cut, vertices = halve_edges(surface, cut, vertices, long)
    return _finish(surface, vertices, cut)


def _long_edges(vertices: Array, triangles: Indices, longest_edge: float) -> Bools:
    """Whether the edge from corner k to k + 1 of each triangle is longer than asked for, shape (m, 3)."""
    limit2 = (longest_edge * ALIKE) ** 2
    sides = (vertices[triangles[:, (k + 1) % 3]] - vertices[triangles[:, k]] for k in range(3))
    return np.stack([np.einsum("ij,ij->i", side, side) > limit2 for side in sides], axis=1)


def _finish(surface: Surface, vertices: Array, cut: CutFacets) -> Triangulation:
    """Normals from one triangle around each vertex, areas of the flat triangles."""
    triangles, owners = cut.faces, cut.parents.astype(np.int64)
    place = np.zeros(len(vertices), dtype=np.int64)
    place[triangles.ravel()[::-1]] = np.arange(triangles.size)[::-1]
    found = surface.evaluate(owners[place // 3], cut.barycentric[place // 3, place % 3])
    _, areas = facet_normals(vertices, triangles)
    return Triangulation(found.positions, found.normals, triangles, areas, owners)
