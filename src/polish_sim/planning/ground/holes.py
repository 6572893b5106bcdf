"""Small holes the pad runs over, closed by smooth patches, so that turns run straight on (Region -> Region)."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices
from polish_sim.geometry import Region
from polish_sim.geometry.bezier import edge_control, edge_middle, into_plane, quadratic_normals
from polish_sim.geometry.surface import Surface, boundary_loops, build_surface
from polish_sim.geometry.topology import find_adjacency
from polish_sim.spatial import unit


class Bridged(NamedTuple):
    """A region without its small holes."""

    region: Region
    """The region; facets after its own ones close holes and lie on no part of the part."""
    facets: int
    """Number of facets that are the part's."""
    holes: int
    """Number of holes closed."""


class _Rim(NamedTuple):
    """Border edges around a hole, in order: from corner ``edge`` of ``facet`` to the next corner."""

    facet: Indices
    edge: Indices


def bridge_holes(region: Region, widest: float) -> Bridged:
    """Close the holes a pad bridges.

    Args:
        region: What is to be polished.
        widest: Diameter up to which holes are closed [m].

    Returns:
        The region with the holes closed; the same region if there are none.
    """
    surface = region.surface
    rims = [rim for rim in _rims(surface) if _diameter(surface, rim) <= widest]
    if not rims or len(rims) == len(region.boundary_loops):
        return Bridged(region, len(surface.faces), 0)
    for rim in rims:
        surface = _close(surface, rim)
    loops = boundary_loops(surface)
    return Bridged(replace(region, surface=surface, boundary_loops=loops), len(region.surface.faces), len(rims))


def _rims(surface: Surface) -> list[_Rim]:
    """Every border loop as edges in order, the surface on the left."""
    facets, edges = np.nonzero(surface.neighbours < 0)
    starts = surface.faces[facets, edges]
    by_start = {int(v): (int(f), int(e)) for v, f, e in zip(starts, facets, edges, strict=True)}
    rims = []
    while by_start:
        here = next(iter(by_start))
        loop = []
        while here in by_start:
            facet, edge = by_start.pop(here)
            loop.append((facet, edge))
            here = int(surface.faces[facet, (edge + 1) % 3])
        if len(loop) >= 3 and here == int(surface.faces[loop[0]]):
            rims.append(_Rim(*np.array(loop, dtype=np.int64).T))
    return rims


def _diameter(surface: Surface, rim: _Rim) -> float:
    points = surface.control[rim.facet, rim.edge]
    return 2.0 * float(np.linalg.norm(points - points.mean(axis=0), axis=1).max())


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
    return edge_control(start, end, unit(into_plane(chord, start_normal)), unit(into_plane(chord, end_normal)))
