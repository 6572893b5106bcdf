"""Flat plates with round holes: a rectangular grid opened around each hole and woven to its rim."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.models.shapes import Shape
from polish_sim.models.solids import CHAMFER, Grid, Solid, rectangle_grid, strip

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAME = 1e-9
"""Points nearer than this are one [m]."""


class Hole(NamedTuple):
    """A round hole in a grid."""

    x: float
    """Middle [m], on a corner of the grid."""
    y: float
    radius: float
    """[m]."""
    room: float
    """Half the side of the square of grid cells that makes way [m], a multiple of the grid's spacing."""


class PunchedGrid(NamedTuple):
    """A triangulated rectangle with holes."""

    grid: Grid
    """Points, triangles and outline."""
    rims: tuple[Ints, ...]
    """Vertex numbers of each hole's rim, counter-clockwise seen from above."""


def punched_grid(size_x: float, size_y: float, spacing: float, holes: tuple[Hole, ...]) -> PunchedGrid:
    """A rectangular grid with round holes.

    Args:
        size_x: Length along x [m].
        size_y: Length along y [m].
        spacing: Wanted side of a grid square [m].
        holes: The holes; their squares lie inside the rectangle and apart from each other.

    Returns:
        The grid.
    """
    plain = rectangle_grid(size_x, size_y, spacing)
    middles = plain.xy[plain.triangles].mean(axis=1)
    kept = np.ones(len(middles), dtype=bool)
    for hole in holes:
        kept &= np.abs(middles - [hole.x, hole.y]).max(axis=1) > hole.room
    xy, triangles, rims = [plain.xy], [plain.triangles[kept]], []
    for hole in holes:
        start = sum(len(part) for part in xy)
        rings = _rings(hole, spacing)
        number = start + np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
        xy.append(rings.reshape(-1, 2))
        triangles += [strip(number[i + 1], number[i]) for i in range(len(number) - 1)]
        rims.append(number[0])
    return _merged(np.vstack(xy), np.vstack(triangles), plain.border, tuple(rims))


def punched_solid(shape: Shape, punched: PunchedGrid) -> Solid:
    """The plate between a top face and the plane z = 0, its outline chamfered at the bottom.

    Args:
        shape: The top face.
        punched: Where it is sampled, and its holes.

    Returns:
        The closed solid.
    """
    grid = punched.grid
    top = np.column_stack([grid.xy, shape.evaluate(grid.xy).height])
    below = np.column_stack([grid.xy, np.zeros(len(top))])
    edge = grid.xy[grid.border]
    below[grid.border, :2] = edge - CHAMFER * np.where(
        np.abs(edge) == np.abs(edge).max(axis=0), np.sign(edge), 0.0
    )
    wall = np.column_stack([edge, np.full(len(edge), CHAMFER)])
    n = len(top)
    middle = 2 * n + np.arange(len(edge))
    sides = [strip(middle, grid.border), strip(n + grid.border, middle)]
    sides += [strip(rim, n + rim) for rim in punched.rims]
    faces = np.vstack([grid.triangles, n + grid.triangles[:, ::-1], *sides])
    return Solid(np.vstack([top, below, wall]), faces)


def _rings(hole: Hole, spacing: float) -> Array:
    """Points from the rim of a hole to the square around it, shape (rings, k, 2)."""
    cells = round(2.0 * hole.room / spacing)
    along = (np.arange(cells) / cells * 2.0 - 1.0) * hole.room
    ends = np.full(cells, hole.room)
    square = np.vstack(
        [
            np.column_stack([along, -ends]),
            np.column_stack([ends, along]),
            np.column_stack([-along, ends]),
            np.column_stack([-ends, -along]),
        ]
    )
    angle = -0.75 * np.pi + np.arange(4 * cells) * (0.5 * np.pi / cells)
    rim = hole.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    steps = max(round((1.2 * hole.room - hole.radius) / spacing), 1)
    share = np.linspace(0.0, 1.0, steps + 1)[:, None, None]
    return np.array([hole.x, hole.y]) + (1.0 - share) * rim + share * square


def _merged(xy: Array, triangles: Ints, border: Ints, rims: tuple[Ints, ...]) -> PunchedGrid:
    """Make points at the same place one and drop those no triangle uses."""
    used = np.unique(triangles)
    _, first, same = np.unique(
        np.round(xy[used] / SAME).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    number = np.full(len(xy), -1)
    number[used] = same.ravel()
    return PunchedGrid(
        Grid(xy[used[first]], number[triangles], number[border]), tuple(number[rim] for rim in rims)
    )
