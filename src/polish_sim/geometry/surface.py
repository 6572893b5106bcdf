"""The smooth surface of a part: closest point, normal, curvature (quadratic Bezier triangles -> answers)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    Ints,
    boxes_of,
    by_slices,
    crosses,
    dots,
    in_groups,
    into_plane,
    norms,
    plane_axes,
    summed,
    turned,
    unit,
)
from polish_sim.geometry.bezier import blend, edge_points, patch_areas
from polish_sim.geometry.closest import BoxTree, SearchRoom, build_box_tree, closest_points
from polish_sim.geometry.jets import unpack
from polish_sim.geometry.topology import Adjacency, facet_links, label_pieces, trace_border


class SurfacePoints(NamedTuple):
    """Points on a surface."""

    positions: Array  #: Positions [m], shape (n, 3)
    normals: Array  #: Unit normals, outward, continuous across smooth edges, shape (n, 3)


class ClosestPoints(NamedTuple):
    """Closest points on a surface."""

    positions: Array  #: Positions [m], shape (n, 3)
    normals: Array  #: Unit normals, outward, shape (n, 3)
    facets: Ints  #: Patches they lie on, shape (n,)
    barycentric: Array  #: Barycentric coordinates u, v, w, shape (n, 3)


class Curvature(NamedTuple):
    """Principal curvatures, positive = convex seen from outside."""

    k1: Array  #: Larger one [1/m], shape (n,)
    k2: Array  #: Smaller one [1/m], shape (n,)
    directions: Array  #: Unit direction of k1, shape (n, 3)


class SourcePatches(NamedTuple):
    """How patches bend; shared by a surface and the surfaces made of some of its facets."""

    normal_control: Array  #: Quadratic normal field, not normalised, shape (p, 6, 3)
    shapes: Array  #: Shape operators at smooth vertices [1/m], packed, shape (k, 6)
    corners: Ints  #: Smooth vertex of each corner, shape (p, 3)


@dataclass(frozen=True, eq=False)
class Surface:
    """Quadratic Bezier triangles, one per facet, with smooth normals and shape operators."""

    source: SourcePatches
    rows: Ints  #: Patch of the source each facet is, shape (m,)
    vertices: Array  #: Vertices [m], shape (n, 3)
    faces: Ints  #: Vertex indices, shape (m, 3)
    control: Array  #: Control points [m], shape (m, 6, 3); order as in :mod:`bezier`
    neighbours: Ints  #: Facet across each edge, -1 at borders, shape (m, 3)
    neighbour_edges: Ints  #: Which edge of that facet it is, shape (m, 3)
    smooth: Bools  #: Edges across which the normal is continuous, shape (m, 3)

    @property
    def normal_control(self) -> Array:
        """Quadratic normal field, not normalised, shape (m, 6, 3)."""
        return self.source.normal_control[self.rows]

    @property
    def shape(self) -> Array:
        """Shape operators at the corners [1/m], packed, shape (m, 3, 6)."""
        return self._shapes(slice(None))

    def _shapes(self, facets: Any) -> Array:
        return self.source.shapes[self.source.corners[self.rows[facets]]]

    @property
    def adjacency(self) -> Adjacency:
        """Neighbours across the edges."""
        return Adjacency(self.neighbours, self.neighbour_edges)

    @cached_property
    def tree(self) -> BoxTree:
        """Boxes over the patches, for closest points; grown when first asked for."""
        return build_box_tree(self.control)

    def free_tree(self) -> None:
        """Free the memory of the tree; it is built again when asked for."""
        vars(self).pop("tree", None)

    @cached_property
    def middle(self) -> Array:
        """Mean of the vertices [m], shape (3,)."""
        return self.vertices.mean(axis=0)

    @cached_property
    def radius(self) -> float:
        """Radius of the ball around the middle that holds all vertices [m]."""
        return norms(self.vertices - self.middle).max()

    @cached_property
    def facet_areas(self) -> Array:
        """Areas of the patches [m^2], shape (m,)."""
        return by_slices(patch_areas, self.control)

    @cached_property
    def normal_sum(self) -> Array:
        """Sum of the normals at the facets' middles, weighted by the patches' areas [m^2], shape (3,)."""
        normals = self.closest(self.vertices[self.faces].mean(axis=1)).normals
        return (self.facet_areas[:, None] * normals).sum(axis=0)

    @cached_property
    def vertex_normal_sums(self) -> Array:
        """Sums of the patches' normals weighted by their angles at each vertex, zero at borders, shape (n,
        3)."""
        total = summed(self.faces, by_slices(_corner_normals, self.control), len(self.vertices))
        facet, edge = np.nonzero(self.neighbours < 0)
        total[self.faces[facet, edge]] = 0.0
        total[self.faces[facet, (edge + 1) % 3]] = 0.0
        return total

    @property
    def bounds(self) -> Array:
        """Corners of the bounding box of the control points [m], shape (2, 3)."""
        low, high = boxes_of(self.control)
        return np.stack([low.min(axis=0), high.max(axis=0)])

    @property
    def is_open(self) -> bool:
        """Whether the surface has a border."""
        return bool((self.neighbours < 0).any())

    def evaluate(self, facets: Ints | Indices, barycentric: Array) -> SurfacePoints:
        """Positions and normals at facets (n,) and barycentric coordinates (n, 3)."""
        facets = np.ascontiguousarray(facets, dtype=np.int32)
        barycentric = np.ascontiguousarray(barycentric, dtype=np.float64)
        normals = blend(self.source.normal_control, self.rows[facets], barycentric)
        return SurfacePoints(blend(self.control, facets, barycentric), unit(normals))

    def closest(self, points: Array, hint: Ints | None = None) -> ClosestPoints:
        """Closest point of the surface to each of some points (n, 3) [m] in the work frame.

        ``hint`` (n,) names facets that may be close; it saves time, never changes the answer.
        """
        points = np.array(points, np.float64, order="C").reshape(-1, 3)  # a frozen array compiles anew
        hints = np.full(len(points), -1, dtype=np.int32) if hint is None else np.asarray(hint, dtype=np.int32)
        facets, barycentric = closest_points(self.control, self.tree, SearchRoom(), points, hints)
        positions, normals = self.evaluate(facets, barycentric)
        return ClosestPoints(positions, normals, facets, barycentric)

    def shape_operators(self, facets: Ints, barycentric: Array) -> Array:
        """Shape operators S, dn = S dx, in the tangent plane [1/m], shape (n, 3, 3)."""
        packed = np.einsum("nc,ncs->ns", barycentric, self._shapes(facets))
        normals = self.evaluate(facets, barycentric).normals
        project = np.eye(3) - normals[:, :, None] * normals[:, None, :]
        return project @ unpack(packed) @ project

    def curvature(self, facets: Ints, barycentric: Array) -> Curvature:
        """Principal curvatures at facets (n,) and barycentric coordinates (n, 3)."""
        operators = self.shape_operators(facets, barycentric)
        normals = self.evaluate(facets, barycentric).normals
        first, second = plane_axes(normals)
        a = np.einsum("ni,nij,nj->n", first, operators, first)
        b = np.einsum("ni,nij,nj->n", first, operators, second)
        c = np.einsum("ni,nij,nj->n", second, operators, second)
        angle = 0.5 * np.arctan2(2.0 * b, a - c)
        spread = np.hypot(0.5 * (a - c), b)
        return Curvature(0.5 * (a + c) + spread, 0.5 * (a + c) - spread, turned(first, second, angle))

    def normal_curvature(self, facets: Ints, barycentric: Array, directions: Array) -> Array:
        """Normal curvature along directions (n, 3) [1/m], shape (n,); positive = convex, sphere +1/R."""
        operators = self.shape_operators(facets, barycentric)
        normals = self.evaluate(facets, barycentric).normals
        tangents = into_plane(directions, normals)
        length2 = np.maximum(dots(tangents, tangents), 1e-300)
        return np.einsum("ni,nij,nj->n", tangents, operators, tangents) / length2

    def restrict(self, facets: Ints | Indices) -> Surface:
        """The part of the surface made of these facets (k,); facet i of it is ``facets[i]`` of this one."""
        used = np.bincount(self.faces.ravel(), minlength=len(self.vertices)) > 0
        if used.all() and np.array_equal(facets, np.arange(len(self.faces))):
            return self  # as it is: surfaces are not changed, and fine ones take memory
        number = np.full(len(self.faces) + 1, -1, dtype=np.int32)
        number[facets] = np.arange(len(facets), dtype=np.int32)
        neighbours = number[self.neighbours[facets]]
        used, compact = np.unique(self.faces[facets], return_inverse=True)
        inside = neighbours >= 0
        return build_on(
            self.source,
            self.rows[facets],
            self.vertices[used],
            compact.reshape(-1, 3).astype(np.int32),
            self.control[facets],
            neighbours,
            np.where(inside, self.neighbour_edges[facets], -1).astype(np.int32),
            self.smooth[facets] & inside,
        )


def build_surface(
    vertices: Array, faces: Ints, control: Array, normal_control: Array, shape: Array, adjacency: Adjacency,
    smooth: Bools,
) -> Surface:  # fmt: skip
    """Put a surface together, ``shape`` its shape operators at the corners, packed, (m, 3, 6)."""
    corners = np.arange(faces.size, dtype=np.int32)
    source = SourcePatches(normal_control, shape.reshape(-1, 6), corners.reshape(-1, 3))
    return build_on(source, corners[: len(faces)], vertices, faces, control, *adjacency, smooth)


def build_on(source: SourcePatches, *fields: NDArray[Any]) -> Surface:
    """Put a surface together of its other ``fields`` in their order: make its arrays read-only."""
    arrays: Any = (_frozen(array) for array in fields)
    return Surface(SourcePatches(*(_frozen(array) for array in source)), *arrays)


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array


def join_surfaces(surfaces: Sequence[Surface]) -> Surface:
    """Put surfaces into one, unconnected, facets and vertices in their order; one alone stays as it is."""
    if len(surfaces) == 1:
        return surfaces[0]
    joined = {
        name: np.concatenate([getattr(surface, name) for surface in surfaces])
        for name in ("vertices", "control", "normal_control", "shape", "smooth")
    }
    first_vertex = np.cumsum([0, *(len(surface.vertices) for surface in surfaces[:-1])])
    first_facet = np.cumsum([0, *(len(surface.faces) for surface in surfaces[:-1])])
    faces = [surface.faces + first for surface, first in zip(surfaces, first_vertex, strict=True)]
    links = [
        np.where(s.neighbours >= 0, s.neighbours + n, -1) for s, n in zip(surfaces, first_facet, strict=True)
    ]
    edges = np.concatenate([surface.neighbour_edges for surface in surfaces])
    adjacency = Adjacency(np.concatenate(links).astype(np.int32), edges)
    return build_surface(faces=np.concatenate(faces).astype(np.int32), adjacency=adjacency, **joined)


def border_edges(surface: Surface) -> list[Indices]:
    """The border of a surface loop by loop, (k, 2) each, rows of (facet, edge) with the surface to the left
    seen from outside; piece by piece, of each the outer loop first, the one that encloses the largest area
    seen from where that looks largest."""
    loops = trace_border(surface.adjacency)
    piece = connected_facets(surface)
    areas = np.array([enclosed(surface.control[tuple(loop.T)]) for loop in loops])
    # Holes of one size keep their order, however rounding has it.
    sizes = np.round(areas / areas.max(initial=1e-300), 6)
    order = sorted(range(len(loops)), key=lambda at: (piece[loops[at][0, 0]], -sizes[at]))
    return [loops[at] for at in order]


def connected_facets(surface: Surface, passable: Bools | None = None) -> Ints:
    """Number of the connected piece each facet belongs to, shape (m,); the largest piece is 0.

    Pieces hang together across the ``passable`` edges (m, 3); None for all.
    """
    count, labels = label_pieces(facet_links(surface.adjacency, passable), len(surface.faces))
    areas = np.bincount(labels, weights=surface.facet_areas, minlength=count)
    # Pieces of one area keep their order, however rounding has it.
    order = np.argsort(-np.round(areas / areas.max(initial=1e-300), 6), kind="stable")
    rank = np.empty(count, dtype=np.int32)
    rank[order] = np.arange(count)
    return rank[labels]


def enclosed(loop: Array) -> float:
    """Largest area a closed loop (p, 3) encloses from any side it is seen from [m^2]; it may repeat its first
    point."""
    spokes = loop - loop[0]
    return 0.5 * float(np.linalg.norm(crosses(spokes, np.roll(spokes, -1, axis=0)).sum(axis=0)))


def _corner_normals(control: Array) -> Array:
    """Normals of patches at their corners, as long as the angle there, shape (m, 3, 3)."""
    corners = control[:, :3]
    ahead = control[:, 3:] - corners
    behind = np.roll(control[:, 3:], 1, axis=1) - corners
    cross = crosses(ahead, behind)
    size = norms(cross)
    angle = np.arctan2(size, dots(ahead, behind))
    return cross * (angle / np.maximum(size, 1e-300))[:, :, None]


def along_edges(
    surface: Surface, edges: Indices, chord_error: float, longest: float = np.inf
) -> tuple[Array, Array]:
    """Divide edges (k, 2), rows of (facet, edge), into pieces no longer than ``longest`` [m], no further from
    the curve than ``chord_error``: where they begin and end [m], (n, 3) each."""
    facet, edge = edges.T
    start, end = surface.control[facet, edge], surface.control[facet, (edge + 1) % 3]
    control = surface.control[facet, 3 + edge]
    sagitta = 0.5 * norms(control - 0.5 * (start + end))
    parts = np.maximum(np.ceil(norms(end - start) / longest), np.ceil(np.sqrt(sagitta / chord_error)))
    parts = np.maximum(parts, 1.0).astype(np.int64)
    at, step = in_groups(parts)
    places = (((step + k) / parts[at])[:, None] for k in (0, 1))
    first, last = (edge_points(start[at], control[at], end[at], place) for place in places)
    return first, last
