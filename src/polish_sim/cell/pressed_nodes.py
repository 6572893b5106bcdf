"""Nodes on the real part under the pad's way, fine enough to sum its pressure up (Region, RealPart -> nodes; layer 8a).

The region is one conforming triangulation; what lies beside it and is pressed all the same is cut into small pieces.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.cell.contact import RealPart
from polish_sim.cell.real_part import FACING, Touch
from polish_sim.geometry import Region, Surface
from polish_sim.geometry.distance.distance_field import DistanceField
from polish_sim.geometry.distance.field_lookup import look_up
from polish_sim.geometry.features import facet_normals
from polish_sim.planning.ground.triangulation import Triangulation, triangulate

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

EDGE = 0.08
"""Longest edge of the nodes' triangles in pad radii; they lie about 0.6 of it apart."""
ACROSS_BORDER = 0.5
MOST_NODES = 300_000
REACH = 1.1
"""Surfaces this many pad radii from the path are not under the pad."""
ROUNDS = 8
ON_SURFACE = 1e-6  # distance at which a node lies on a surface [m]
ALIKE = 0.3  # least cosine between the drawing's normal and the real one for a step along it [-]
EDGE_TURN = 0.9  # further apart than this cosine the real normal is an edge's: the drawing's is taken [-]
_WHOLE = 1.0 - 1e-9


class PressedNodes(NamedTuple):
    """Nodes on the real part, in its own work frame; the region's come first."""

    positions: Array
    """[m], shape (n, 3)"""
    normals: Array
    """Unit outward normals of the real surface, shape (n, 3); zero: the pad cannot meet this node."""
    areas: Array
    """Area each stands for [m^2], shape (n,)."""


class Nodes(NamedTuple):
    """The region's triangles and all nodes."""

    mesh: Triangulation
    """Of the nominal region; its vertices are the first nodes."""
    pressed: PressedNodes


def place_nodes(surface: Surface, region: Region, part: RealPart, touch: Touch, edge: float = EDGE) -> Nodes:
    """Spread nodes over the region and over what else the pad comes to, and put them on the real part.

    Args:
        surface: The whole nominal surface.
        region: The polished part of it.
        part: The real part; what it differs by from the drawing is found along the drawing's normals.
        touch: Where the pad goes.
        edge: Longest edge of the triangles in pad radii.

    Returns:
        The nodes.
    """
    area = float(region.surface.facet_areas.sum())
    longest = max(edge * touch.pad_radius, math.sqrt(4.0 * area / MOST_NODES))
    mesh = triangulate(region.surface, longest)
    beside = surroundings(surface, region, touch, longest)
    own = on_real_part(part.field, mesh.vertices, mesh.normals)
    others = on_real_part(part.field, beside.positions, beside.normals)
    met = others[1].any(axis=1)
    positions, normals = (np.concatenate([a, b[met]]) for a, b in zip(own, others, strict=True))
    return Nodes(mesh, PressedNodes(positions, normals, np.concatenate([mesh.vertex_areas, beside.areas[met]])))


def surroundings(surface: Surface, region: Region, touch: Touch, longest: float) -> PressedNodes:
    """Middles of small triangles of the nominal surface outside the region that the pad can come to."""
    tree = cKDTree(touch.positions)
    whole = np.bincount(region.facets, region.surface.facet_areas, len(surface.faces)) >= _WHOLE * surface.facet_areas
    _, nearest = tree.query(surface.vertices[surface.faces].mean(axis=1))
    turned, _ = facet_normals(surface.vertices, surface.faces)
    facing = np.einsum("ij,ij->i", turned, touch.axes[nearest]) > FACING
    facets = np.flatnonzero(~whole & facing)
    corners = np.broadcast_to(np.eye(3), (len(facets), 3, 3))
    # Of a facet the region's border cuts a piece is in or out as its middle is: smaller ones are more exact.
    cut = np.isin(np.arange(len(surface.faces)), region.facets)
    limits = np.where(cut, ACROSS_BORDER * longest, longest)
    done: list[tuple[Ints, Array]] = []
    while len(facets):
        places = surface.vertices[surface.faces[facets]]
        points = np.einsum("kca,kad->kcd", corners, places)
        sides = np.linalg.norm(points - np.roll(points, -1, axis=1), axis=2)
        away, _ = tree.query(points.mean(axis=1))
        near = away < REACH * touch.pad_radius + sides.max(axis=1)
        small = near & (sides.max(axis=1) <= limits[facets])
        done.append((facets[small], corners[small]))
        rows = np.flatnonzero(near & ~small)
        facets, corners = np.repeat(facets[rows], 2), _halved(corners[rows], sides[rows].argmax(axis=1))
    owners = np.concatenate([f for f, _ in done]) if done else np.empty(0, np.int64)
    shares = np.concatenate([c for _, c in done]) if done else np.empty((0, 3, 3))
    if not len(owners):
        return PressedNodes(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    areas = surface.facet_areas[owners] * np.abs(np.linalg.det(shares))
    positions, normals = surface.evaluate(owners.astype(np.int32), shares.mean(axis=1))
    outside = np.ones(len(owners), dtype=bool)
    on_cut = cut[owners]
    if on_cut.any():
        closest = region.surface.closest(positions[on_cut]).positions
        outside[on_cut] = np.linalg.norm(closest - positions[on_cut], axis=1) > ON_SURFACE
    return PressedNodes(positions[outside], normals[outside], areas[outside])


def _halved(corners: Array, longest: Ints) -> Array:
    """Both halves of triangles cut through the middle of their longest edge, shape (2 k, 3, 3)."""
    turned = np.take_along_axis(corners, ((longest[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
    a, b, c = turned[:, 0], turned[:, 1], turned[:, 2]
    middle = 0.5 * (a + b)
    return np.stack([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)], axis=1).reshape(-1, 3, 3)


def on_real_part(field: DistanceField, positions: Array, normals: Array) -> tuple[Array, Array]:
    """Move nodes of the drawing along its normals onto the real surface.

    Args:
        field: Signed distance of the real part.
        positions: Nodes of the drawing [m], shape (n, 3).
        normals: Unit normals there, shape (n, 3).

    Returns:
        Positions [m] and unit normals on the real surface, each (n, 3); a normal is zero where there is none.
    """
    found, slopes = positions.copy(), np.zeros_like(positions)
    _project(field, np.ascontiguousarray(normals), found, slopes)
    return found, slopes


@njit(cache=True, error_model="numpy")
def _project(field, normals, positions, slopes):  # type: ignore[no-untyped-def]
    """Newton's method along each normal; across it where the surface has turned away, as on a step's wall."""
    nodes, per_metre = field.bricks.reshape(-1), 1.0 / field.spacing
    for i in range(len(positions)):
        x, y, z = positions[i]
        nx, ny, nz = normals[i]
        for _ in range(ROUNDS):
            d, gx, gy, gz = look_up(field, nodes, per_metre, x, y, z)
            along = gx * nx + gy * ny + gz * nz
            if along > ALIKE:
                x, y, z = x - d / along * nx, y - d / along * ny, z - d / along * nz
            else:
                x, y, z = x - d * gx, y - d * gy, z - d * gz
        d, gx, gy, gz = look_up(field, nodes, per_metre, x, y, z)
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        if size > 0.0 and abs(d) < 0.1 * field.spacing and gx * nx + gy * ny + gz * nz > 0.0:
            positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
            if gx * nx + gy * ny + gz * nz > EDGE_TURN * size:
                nx, ny, nz = gx / size, gy / size, gz / size
            slopes[i, 0], slopes[i, 1], slopes[i, 2] = nx, ny, nz
