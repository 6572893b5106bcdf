"""Whether the tool runs into the part on its way through the air (moves -> depths)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry import ClosestPoints, Surface
from polish_sim.spatial import unit

Array = NDArray[np.float64]

RIM_POINTS = 24
BEHIND = 0.3
"""Cosine: a point is inside when it lies behind its foot at least this squarely; beside an open border it is not."""
ON_EDGE = 1e-7
"""A foot with a barycentric coordinate below this is on an edge."""


def heights(surface: Surface, points: Array) -> Array:
    """Distance from the part [m], negative inside it.

    Args:
        surface: The part.
        points: Points [m], shape (n, 3).

    Returns:
        Signed distances, shape (n,).
    """
    foot = surface.closest(points)
    offset = points - foot.positions
    away = np.linalg.norm(offset, axis=1)
    behind = (offset * foot.normals).sum(axis=1) < -BEHIND * away
    # Behind one facet of an edge or a corner is not yet inside: outside a sharp edge it is so too.
    rows = np.flatnonzero(behind & (foot.barycentric.min(axis=1) < ON_EDGE))
    if len(rows):
        facing = _facing(surface, ClosestPoints(*(column[rows] for column in foot)))
        behind[rows] = (offset[rows] * facing).sum(axis=1) < 0.0
    return np.where(behind, -away, away)


def _facing(surface: Surface, foot: ClosestPoints) -> Array:
    """Where an edge or a corner looks: the sum of the normals of its facets, weighted by their angles, (n, 3).

    A point with such a foot is outside just when it lies on that side (Baerentzen and Aanaes, 2005).
    """
    edge = (foot.barycentric.argmin(axis=1) + 1) % 3
    across = surface.neighbours[foot.facets, edge]
    there = surface.neighbour_edges[foot.facets, edge]
    rows = np.arange(len(edge))
    weights = np.zeros((len(edge), 3))
    weights[rows, there] = foot.barycentric[rows, (edge + 1) % 3]
    weights[rows, (there + 1) % 3] = foot.barycentric[rows, edge]
    other = surface.evaluate(np.maximum(across, 0), weights).normals
    facing = foot.normals + np.where((across >= 0)[:, None], other, 0.0)
    at_corner = foot.barycentric.max(axis=1) > 1.0 - ON_EDGE
    corners = surface.faces[foot.facets, foot.barycentric.argmax(axis=1)]
    for corner in np.unique(corners[at_corner]):
        facing[at_corner & (corners == corner)] = _corner_facing(surface, int(corner))
    return np.asarray(facing)


def _corner_facing(surface: Surface, corner: int) -> Array:
    """Sum of the normals of the facets around a vertex, weighted by their angles there, shape (3,)."""
    facets, place = np.nonzero(surface.faces == corner)
    ahead, back = (surface.vertices[surface.faces[facets, (place + k) % 3]] - surface.vertices[corner] for k in (1, 2))
    square = np.cross(ahead, back)
    angle = np.arctan2(np.linalg.norm(square, axis=1), (ahead * back).sum(axis=1))
    return np.asarray((angle[:, None] * unit(square)).sum(axis=0))


def rim_depths(surface: Surface, positions: Array, axes: Array, radius: float) -> Array:
    """How deep the middle or the rim of the pad's face stands in the part.

    Args:
        surface: The part.
        positions: Tool points [m], shape (n, 3).
        axes: Unit tool axes, shape (n, 3).
        radius: The pad's [m]; 0 looks at the tool point only.

    Returns:
        Depths [m], 0 where it is clear, shape (n,).
    """
    points = positions[:, None]
    if radius > 0.0:
        first = _beside(surface, axes)
        second = np.cross(axes, first)
        angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
        rim = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        points = np.concatenate([points, points + radius * rim], axis=1)
    depth = -heights(surface, points.reshape(-1, 3)).reshape(points.shape[:2])
    return np.asarray(np.maximum(depth, 0.0).max(axis=1))


def _beside(surface: Surface, axes: Array) -> Array:
    """Unit vectors square to axes (n, 3) that turn with the part, as the coordinate axes would not."""
    ways = surface.vertices[:3] - surface.vertices.mean(axis=0)
    square = np.cross(axes[:, None], ways)
    size = np.linalg.norm(square, axis=2)
    # The first that is long enough: rounding does not choose among equals.
    chosen = (size > 0.5 * size.max(axis=1, keepdims=True)).argmax(axis=1)
    rows = np.arange(len(axes))
    return np.asarray(square[rows, chosen] / size[rows, chosen][:, None])
