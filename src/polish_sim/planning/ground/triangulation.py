"""The region as one fine conforming triangulation (Region -> where distances are looked up and areas
summed)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, joined, next_corners, norms, running_sums
from polish_sim.errors import PlanError
from polish_sim.geometry import Surface
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.topology import counting_order, facets_at_edges, label_within

MAX_TRIANGLES = 1_500_000
ALIKE = 1.0 + 1e-9  #: Lengths that differ by less are equal: rounding must not decide how patches are split
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
        return each_once(half_edges(self.triangles), len(self.vertices))

    @cached_property
    def border(self) -> Indices:
        """Directed edges with a triangle on their left only, shape (b, 2)."""
        return half_edges(self.triangles)[(facets_at_edges(self.triangles) == 1).T.ravel()]

    @cached_property
    def around(self) -> tuple[Indices, Indices]:
        """Triangles vertex by vertex: where those around each vertex begin, (n + 1,), and they, (3 m,)."""
        counts = np.bincount(self.triangles.ravel(), minlength=len(self.vertices))
        members = counting_order(self.triangles.ravel(), len(self.vertices)) // 3
        return running_sums(counts), members.astype(np.int64)

    @cached_property
    def vertex_areas(self) -> Array:
        """A third of the area of every triangle around a vertex [m^2], shape (n,)."""
        return self._around_vertices(self.areas)

    def part_areas(self, facets: int) -> Array:
        """The same, counting only triangles on the surface's first facets [m^2], shape (n,)."""
        return self._around_vertices(np.where(self.owners < facets, self.areas, 0.0))

    def _around_vertices(self, areas: Array) -> Array:
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
    wanted = 2.0 * float(surface.facet_areas.sum()) / (0.5 * longest_edge) ** 2
    if wanted > 4 * MAX_TRIANGLES:
        raise PlanError(
            f"the region ({surface.facet_areas.sum() * 1e4:.4g} cm^2) is too large for so fine a step-over: "
            f"triangles of {longest_edge * 1e3:.3g} mm would be needed. Set a larger step-over or a smaller "
            "region."
        )
    owners = np.arange(len(surface.faces))
    corners = np.broadcast_to(np.eye(3), (len(owners), 3, 3))
    triangles = surface.faces.astype(np.int64)
    vertices = surface.vertices.copy()
    for _ in range(MOST_ROUNDS):
        long = _long_edges(vertices, triangles, longest_edge)
        if not long.any() or len(triangles) > 2 * MAX_TRIANGLES:
            break
        # Corner by corner, so that of the two triangles at an edge the one of the lower corner evaluates its
        # middle.
        corner, row = np.nonzero(long)
        ends = np.stack([triangles[row, corner], triangles[row, (corner + 1) % 3]])
        keys = ends.min(axis=0) * len(vertices) + ends.max(axis=0)
        _, first, which = np.unique(keys, return_index=True, return_inverse=True)
        split = np.full(triangles.shape, -1)
        split[row, corner] = len(vertices) + which
        row, corner = row[first], corner[first]
        weights = 0.5 * (corners[row, corner] + corners[row, (corner + 1) % 3])
        added = surface.evaluate(owners[row].astype(np.int32), weights)
        vertices = np.concatenate([vertices, added.positions])
        triangles, corners, owners = _split(triangles, corners, owners, split, vertices)
    return _finish(surface, vertices, triangles, corners, owners)


def half_edges(triangles: Indices) -> Indices:
    """Edges from corner k to k + 1, all first ones, then all second ones, then all third ones, (3 m, 2)."""
    return np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])


def each_once(edges: Indices, count: int) -> Indices:
    """Edges (k, 2) between ``count`` vertices without doubles, whichever way they run, in order, shape (e,
    2)."""
    ends = np.sort(edges, axis=1)
    keys = np.sort(ends[:, 0] * count + ends[:, 1])  # np.unique hashes, which takes longer
    return np.stack(np.divmod(keys[np.diff(keys, prepend=-1) > 0], count), axis=1)


def _long_edges(vertices: Array, triangles: Indices, longest_edge: float) -> Bools:
    """Whether the edge from corner k to k + 1 of each triangle is longer than asked for, shape (3, m)."""
    limit2 = (longest_edge * ALIKE) ** 2
    sides = (vertices[triangles[:, (k + 1) % 3]] - vertices[triangles[:, k]] for k in range(3))
    return np.stack([np.einsum("ij,ij->i", side, side) > limit2 for side in sides])


def _split(
    triangles: Indices, corners: Array, owners: Indices, split: Indices, vertices: Array
) -> tuple[Indices, Array, Indices]:
    """Replace each triangle by 1, 2, 3 or 4 according to which of its edges get a middle."""
    many = (split >= 0).sum(axis=1)
    kept = many == 0
    out = [(triangles[kept], corners[kept], owners[kept])]
    for number, pieces in ((1, _split_one), (2, _split_two), (3, _split_three)):
        rows = np.flatnonzero(many == number)
        # Turn each triangle so that its split edges stand first.
        lead = split[rows] >= 0
        turn = (
            np.argmax(lead & ~np.roll(lead, 1, axis=1), axis=1)
            if number < 3
            else np.zeros(len(rows), dtype=int)
        )
        order = (turn[:, None] + np.arange(3)) % 3
        ids = np.concatenate(
            [np.take_along_axis(triangles[rows], order, 1), np.take_along_axis(split[rows], order, 1)], axis=1
        )
        where = np.take_along_axis(corners[rows], order[:, :, None], 1)
        where = np.concatenate([where, 0.5 * (where + next_corners(where))], axis=1)
        for piece in pieces(ids, vertices):
            out.append(
                (
                    np.take_along_axis(ids, piece, 1),
                    np.take_along_axis(where, piece[:, :, None], 1),
                    owners[rows],
                )
            )
    return tuple(joined(out))  # type: ignore[return-value]


def _rows(ids: Indices, *picks: tuple[int, int, int]) -> list[Indices]:
    return [np.tile(pick, (len(ids), 1)) for pick in picks]


def _split_one(ids: Indices, vertices: Array) -> list[Indices]:
    return _rows(ids, (0, 3, 2), (3, 1, 2))


def _split_two(ids: Indices, vertices: Array) -> list[Indices]:
    """Cut off the corner between both split edges; cut the rest along its shorter diagonal."""
    one = norms(vertices[ids[:, 0]] - vertices[ids[:, 4]])
    other = norms(vertices[ids[:, 2]] - vertices[ids[:, 3]])
    first = (one <= ALIKE * other)[:, None]
    corner, a, b = _rows(ids, (3, 1, 4), (0, 3, 4), (0, 4, 2))
    c, d = _rows(ids, (0, 3, 2), (3, 4, 2))
    return [corner, np.where(first, a, c), np.where(first, b, d)]


def _split_three(ids: Indices, vertices: Array) -> list[Indices]:
    return _rows(ids, (0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))


def _finish(
    surface: Surface, vertices: Array, triangles: Indices, corners: Array, owners: Indices
) -> Triangulation:
    """Normals from one triangle around each vertex, areas of the flat triangles."""
    place = np.zeros(len(vertices), dtype=np.int64)
    place[triangles.ravel()[::-1]] = np.arange(triangles.size)[::-1]
    found = surface.evaluate(owners[place // 3].astype(np.int32), corners[place // 3, place % 3])
    _, areas = facet_normals(vertices, triangles)
    return Triangulation(found.positions, found.normals, triangles, areas, owners)
