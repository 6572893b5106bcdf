"""A region continued past its border, for a pad whose middle leaves the part (Region -> Region with a
skirt)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.geometry import Region
from polish_sim.geometry.bezier import quadratic_normals
from polish_sim.geometry.surface import Surface, boundary_loops, build_surface, trace_border
from polish_sim.geometry.topology import find_adjacency
from polish_sim.spatial import unit

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
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
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
