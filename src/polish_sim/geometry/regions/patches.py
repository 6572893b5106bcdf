"""Patches a tool path can cover: connected, and all of it seen from one side (cut surface -> patches)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from polish_sim.arrays import Array, Bools, Indices, crosses, dots, norms
from polish_sim.geometry.bezier import EDGE_MIDDLES
from polish_sim.geometry.cut import Clipped, clip, then
from polish_sim.geometry.surface import Surface, SurfacePoints, connected_facets
from polish_sim.geometry.topology import corner_fans

OPEN_ANGLE = np.radians(80.0)  #: A patch lies open when its normals are within this angle of their mean [rad]
_OPEN_SHARE = 0.995  #: This share of its area is enough
SHARP_ANGLE = np.radians(60.0)  #: The tool does not go over creases that bend more, unless asked to [rad]


def facing(surface: Surface) -> Array:
    """Mean normal times the share of the area it stands for, shape (3,): length 1 for a plane, 0 for a
    ball."""
    areas = surface.facet_areas
    return areas @ middle_points(surface).normals / max(areas.sum(), 1e-300)


def middle_points(surface: Surface) -> SurfacePoints:
    """The middle of each patch, with its normal, shapes (m, 3)."""
    count = len(surface.faces)
    return surface.evaluate(np.arange(count, dtype=np.int32), np.full((count, 3), 1.0 / 3.0))


def lies_open(surface: Surface) -> bool:
    """Whether all of a surface is seen from one side."""
    mean = facing(surface)
    length = np.linalg.norm(mean)
    if length < 1e-6:
        return False
    seen = middle_points(surface).normals @ (mean / length) > np.cos(OPEN_ANGLE)
    areas = surface.facet_areas
    return areas[seen].sum() >= _OPEN_SHARE * areas.sum()


def connected(kept: Clipped, passable: Bools | None = None) -> list[Clipped]:
    """Take a surface apart into connected pieces, the largest first; ``passable`` (m, 3) marks the edges that
    join."""
    piece = connected_facets(kept.surface, passable)
    order = np.argsort(piece, kind="stable")
    ends = np.cumsum(np.bincount(piece))
    if len(ends) == 1:
        return [kept]
    return [restricted(kept, facets) for facets in np.split(order, ends[:-1])]


def restricted(kept: Clipped, facets: Indices) -> Clipped:
    """Some of the facets kept."""
    return Clipped(kept.surface.restrict(facets), kept.parents[facets])


def coverable(kept: Clipped, up: Array) -> list[Clipped]:
    """Take a surface apart into patches that lie open.

    Pieces that are joined over gentle creases stay whole if they lie open; otherwise they are taken apart at
    every crease, and what still goes round is cut along lines where it looks as much to one side as to the
    next, of the six directions about ``up``.
    """
    patches: list[Clipped] = []
    for piece in connected(kept, _gentle_edges(kept.surface)):
        if lies_open(piece.surface):
            patches.append(piece)
            continue
        for smooth in connected(piece, piece.surface.smooth):
            patches += [smooth] if lies_open(smooth.surface) else _charts(smooth, up)
    return patches


def unpinch(surface: Surface) -> Surface:
    """Give each fan of facets around a vertex its own vertex, so that the border nowhere meets itself."""
    count, labels = corner_fans(surface.adjacency, surface.neighbours >= 0)
    if count == len(surface.vertices):
        return surface
    # Vertices keep their order; those of further fans follow their first one.
    _, first = np.unique(labels, return_index=True)
    rank = np.empty(count, dtype=np.int32)
    rank[np.argsort(surface.faces.ravel()[first], kind="stable")] = np.arange(count)
    faces = rank[labels]
    vertices = np.empty((count, 3))
    vertices[faces] = surface.vertices[surface.faces]
    vertices.setflags(write=False)
    faces.setflags(write=False)
    return replace(surface, vertices=vertices, faces=faces)


def _gentle_edges(surface: Surface) -> Bools:
    """Edges that are smooth or bend less than the sharp angle in their middle, shape (m, 3)."""
    count = len(surface.faces)
    facets = np.arange(count, dtype=np.int32)
    normals = [surface.evaluate(facets, np.tile(middle, (count, 1))).normals for middle in EDGE_MIDDLES]
    here = np.stack(normals, axis=1)
    beyond = here[surface.neighbours, surface.neighbour_edges]
    return (surface.neighbours >= 0) & (surface.smooth | (dots(here, beyond) > np.cos(SHARP_ANGLE)))


def _charts(kept: Clipped, up: Array) -> list[Clipped]:
    """Cut a smooth surface where it looks as much along one of six directions as along another."""
    axes = _six_directions(kept.surface, up)
    patches: list[Clipped] = []
    for axis in axes:
        chart = kept
        for other in axes:
            if abs(axis @ other) < 0.5 and len(chart.parents):
                chart = then(
                    chart, clip(chart.surface, chart.surface.normal_control @ (axis - other), on=1e-9)
                )
        if len(chart.parents):
            # What is left looks along the axis or against it.
            ahead = np.flatnonzero(middle_points(chart.surface).normals @ axis > 0.0)
            patches += connected(restricted(chart, ahead)) if len(ahead) else []
    return patches


def _six_directions(surface: Surface, up: Array) -> Array:
    """Up, down and the four sides most of the surface looks to, turning with the part, shape (6, 3)."""
    normals, areas = middle_points(surface).normals, surface.facet_areas
    level = normals - (normals @ up)[:, None] * up
    length = norms(level)
    first = (length > 0.5).argmax()
    right = level[first] / max(length[first], 1e-300)
    back = crosses(up, right)
    # Four sides look alike under a quarter turn: the mean of the fourfold angle says where they are.
    weights = areas * length
    turn = np.arctan2(level @ back, level @ right)
    four = np.sum(weights * np.exp(4j * turn))
    angle = np.angle(four) / 4.0 if abs(four) > 1e-3 * weights.sum() else 0.0
    one = np.cos(angle) * right + np.sin(angle) * back
    two = crosses(up, one)
    return np.array([up, -up, one, -one, two, -two])
