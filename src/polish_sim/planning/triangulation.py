"""The region as one fine conforming triangulation (Region -> where distances are looked up and areas
summed)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, next_corners, running_sums
from polish_sim.errors import PlanError
from polish_sim.geometry import Surface
from polish_sim.geometry.cut import ALIKE, CutFacets, find_edges, halve_edges, whole_facets
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.topology import counting_order, facets_at_edges, label_within

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
    found = surface.evaluate(owners[place // 3].astype(np.int32), cut.barycentric[place // 3, place % 3])
    _, areas = facet_normals(vertices, triangles)
    return Triangulation(found.positions, found.normals, triangles, areas, owners)
