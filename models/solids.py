"""Closed triangle meshes of the workpieces: a sampled top face, walls and a flat bottom at z = 0.

The bottom edge is chamfered, as on a real blank, so that the top is the part's largest smooth face.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.models.shapes import Shape

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]

CHAMFER = 2e-3
"""Width and height of the bottom edge's chamfer [m]."""


class Solid(NamedTuple):
    """A closed mesh with outward triangles."""

    vertices: Array
    """Points [m], shape (n, 3)."""
    faces: Triangles
    """Vertex numbers, counter-clockwise seen from outside, shape (m, 3)."""


class Grid(NamedTuple):
    """A triangulated piece of the plane around the origin."""

    xy: Array
    """Points [m], shape (n, 2)."""
    triangles: Triangles
    """Vertex numbers, counter-clockwise, shape (m, 3)."""
    border: NDArray[np.int64]
    """Vertex numbers of the outline, counter-clockwise, shape (k,)."""


def disc_grid(radius: float, spacing: float) -> Grid:
    """Rings of nearly equilateral triangles: ring i holds 6 i points.

    Args:
        radius: Radius of the disc [m].
        spacing: Wanted distance between rings [m].

    Returns:
        The grid.
    """
    rings = max(1, round(radius / spacing))
    xy, triangles = [np.zeros((1, 2))], []
    start_inside = 0
    for i in range(1, rings + 1):
        start = 1 + 3 * i * (i - 1)
        angle = np.arange(6 * i) * (2 * np.pi / (6 * i))
        xy.append(radius * i / rings * np.column_stack([np.cos(angle), np.sin(angle)]))
        sector, step = np.divmod(np.arange(6 * i), i)
        outer, outer_next = start + np.arange(6 * i), start + (np.arange(6 * i) + 1) % (6 * i)
        inner = start_inside + (sector * (i - 1) + step) % max(1, 6 * (i - 1))
        triangles.append(np.stack([outer, outer_next, inner], axis=1))
        between = step < i - 1
        inner_next = start_inside + (sector * (i - 1) + step + 1) % max(1, 6 * (i - 1))
        triangles.append(np.stack([inner, outer_next, inner_next], axis=1)[between])
        start_inside = start
    return Grid(np.vstack(xy), np.vstack(triangles), start_inside + np.arange(6 * rings))


def rectangle_grid(size_x: float, size_y: float, spacing: float) -> Grid:
    """A rectangular grid whose squares are cut along alternating diagonals.

    Args:
        size_x: Length along x [m].
        size_y: Length along y [m].
        spacing: Wanted side of a square [m].

    Returns:
        The grid.
    """
    nx, ny = round(size_x / spacing), round(size_y / spacing)
    return lines_grid(
        np.linspace(-size_x / 2, size_x / 2, nx + 1), np.linspace(-size_y / 2, size_y / 2, ny + 1)
    )


def lines_grid(x: Array, y: Array) -> Grid:
    """A rectangular grid of unequal spacing, its cells cut along alternating diagonals.

    Args:
        x: Where its lines cross the x axis, rising [m], shape (nx + 1,).
        y: Where its lines cross the y axis, rising [m], shape (ny + 1,).

    Returns:
        The grid.
    """
    nx, ny = len(x) - 1, len(y) - 1
    number = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    even = (np.add.outer(np.arange(nx), np.arange(ny)) % 2 == 0)[..., None]
    first = np.where(even, np.stack([a, b, c], axis=-1), np.stack([a, b, d], axis=-1))
    second = np.where(even, np.stack([a, c, d], axis=-1), np.stack([b, c, d], axis=-1))
    xy = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    border = np.concatenate([number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1]])
    return Grid(xy, np.concatenate([first, second]).reshape(-1, 3), border)


def extrude(shape: Shape, grid: Grid) -> Solid:
    """The solid between a shape's top face and the plane z = 0.

    Args:
        shape: The top face.
        grid: Where it is sampled; its outline becomes the walls.

    Returns:
        The closed solid.
    """
    top = np.column_stack([grid.xy, shape.evaluate(grid.xy).height])
    edge = grid.xy[grid.border]
    inset = edge * (1.0 - CHAMFER / np.abs(edge).max(axis=0))
    k, n = len(edge), len(top)
    wall = np.column_stack([edge, np.full(k, CHAMFER)])
    foot = np.column_stack([inset, np.zeros(k)])
    rows = [grid.border, n + np.arange(k), n + k + np.arange(k)]
    centre = n + 2 * k
    fan = np.stack([np.roll(rows[2], -1), rows[2], np.full(k, centre)], axis=1)
    faces = np.vstack([grid.triangles, strip(rows[1], rows[0]), strip(rows[2], rows[1]), fan])
    return Solid(np.vstack([top, wall, foot, np.zeros((1, 3))]), faces)


def revolve(profile: Array, segments: int) -> Solid:
    """The solid swept by a closed profile around the z axis.

    Args:
        profile: Corners (r, z) with r > 0 [m], clockwise in the (r, z) plane, shape (k, 2).
        segments: Number of steps around.

    Returns:
        The closed solid.
    """
    k = len(profile)
    angle = np.arange(segments) * (2 * np.pi / segments)
    r, z = profile[:, 0], np.broadcast_to(profile[:, 1], (segments, k))
    vertices = np.stack([np.outer(np.cos(angle), r), np.outer(np.sin(angle), r), z], axis=-1).reshape(-1, 3)
    number = np.arange(segments * k).reshape(segments, k)
    faces = np.vstack([strip(number[:, (j + 1) % k], number[:, j]) for j in range(k)])
    return Solid(vertices, faces)


def strip(lower: NDArray[np.int64], upper: NDArray[np.int64]) -> Triangles:
    """A closed band of triangles between two rings of vertices, outward if they run counter-clockwise.

    Args:
        lower: Vertex numbers of the lower ring, shape (k,).
        upper: Those above them, shape (k,).

    Returns:
        The triangles.
    """
    lower_next, upper_next = np.roll(lower, -1), np.roll(upper, -1)
    return np.vstack(
        [np.stack([lower, lower_next, upper_next], axis=1), np.stack([lower, upper_next, upper], axis=1)]
    )
