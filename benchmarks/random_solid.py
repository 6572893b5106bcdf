"""Closed meshes of random parts: top, pockets, walls, chamfered bottom; and what damages them (plane ->
solid)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.random_outline import PlaneMesh

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Height = Callable[[Array], Array]

CHAMFER = 0.25
"""Chamfer of the bottom edge in spacings: the top is the largest smooth face."""


class Solid(NamedTuple):
    """A closed mesh, and which of it is the top."""

    vertices: Array
    """(n, 3)."""
    faces: Ints
    """Outward, (m, 3); the top's first."""
    top: int
    """Number of facets of the top."""


def raise_solid(plane: PlaneMesh, height: Height, floors: list[float], spacing: float, noise: Array) -> Solid:
    """Give a plane mesh thickness.

    Args:
        plane: The part seen from above.
        height: Height of the top over points (n, 2).
        floors: Height of each pocket's floor.
        spacing: About the length of edges.
        noise: Added to the top's vertices, shape (n, 3).

    Returns:
        The solid, its bottom at z = 0.
    """
    count = len(plane.points)
    upper = np.column_stack([plane.points, height(plane.points)]) + noise
    layers, faces = [upper], [plane.triangles[plane.pocket == 0]]
    top = len(faces[0])
    for number, floor in enumerate(floors, start=1):
        triangles = plane.triangles[plane.pocket == number]
        offset = count * len(layers)
        layers.append(np.column_stack([plane.points, np.full(count, floor)]))
        rim = _rim(triangles)
        # Seen from the pocket its walls look inwards.
        faces += [triangles + offset, _walls(rim[:, ::-1], rim[:, ::-1] + offset)]
    rim = _rim(plane.triangles)
    chamfer = CHAMFER * spacing
    offset = count * len(layers)
    layers.append(np.column_stack([plane.points, np.full(count, chamfer)]))
    layers.append(np.column_stack([_inset(plane.points, rim, chamfer), np.zeros(count)]))
    faces += [_walls(rim, rim + offset), _walls(rim + offset, rim + offset + count)]
    faces.append(plane.triangles[:, ::-1] + offset + count)
    used, compact = np.unique(np.concatenate(faces), return_inverse=True)
    return Solid(np.concatenate(layers)[used], compact.reshape(-1, 3), top)


def _rim(triangles: Ints) -> Ints:
    """Directed edges with a triangle on the left only, (k, 2)."""
    half = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    size = int(half.max()) + 1
    return half[~np.isin(half[:, 0] * size + half[:, 1], half[:, 1] * size + half[:, 0])]


def _walls(above: Ints, below: Ints) -> Ints:
    """Two facets under each directed edge (k, 2)."""
    return np.concatenate(
        [
            np.stack([below[:, 0], below[:, 1], above[:, 1]], axis=1),
            np.stack([below[:, 0], above[:, 1], above[:, 0]], axis=1),
        ]
    )


def _inset(points: Array, rim: Ints, distance: float) -> Array:
    """Points with those of the rim moved inwards."""
    along = points[rim[:, 1]] - points[rim[:, 0]]
    inwards = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
    moved = points.copy()
    for end in (0, 1):
        np.add.at(moved, rim[:, end], 0.5 * distance * inwards)
    return moved


def add_slivers(plane: PlaneMesh, share: float, rng: np.random.Generator) -> PlaneMesh:
    """Split some triangles by a point very near to one of their edges."""
    many = int(share * len(plane.triangles))
    rows = rng.choice(len(plane.triangles), many, replace=False)
    weights = np.array([0.5, 0.49, 0.01])
    added = np.einsum("k,mkj->mj", weights, plane.points[plane.triangles[rows]])
    ids = len(plane.points) + np.arange(many)
    a, b, c = plane.triangles[rows].T
    kept = np.setdiff1d(np.arange(len(plane.triangles)), rows)
    pieces = [np.stack(corners, axis=1) for corners in ((a, b, ids), (b, c, ids), (c, a, ids))]
    return PlaneMesh(
        np.concatenate([plane.points, added]),
        np.concatenate([plane.triangles[kept], *pieces]),
        np.concatenate([plane.pocket[kept], *([plane.pocket[rows]] * 3)]),
    )


def _flipped(triangles: Array, top: int, rng: np.random.Generator) -> Array:
    out = triangles.copy()
    rows = rng.choice(len(out), max(len(out) // 20, 1), replace=False)
    out[rows] = out[rows, ::-1]
    return out


def _doubled(triangles: Array, top: int, rng: np.random.Generator) -> Array:
    return np.concatenate([triangles, triangles[rng.choice(len(triangles), 5)]])


def _holed(triangles: Array, top: int, rng: np.random.Generator) -> Array:
    return np.delete(triangles, rng.integers(top), axis=0)


def _split_on_one_side(triangles: Array, top: int, rng: np.random.Generator) -> Array:
    """A T-junction: a facet is halved, its neighbour is not."""
    row = int(rng.integers(top))
    a, b, c = triangles[row]
    middle = 0.5 * (a + b)
    return np.concatenate([np.delete(triangles, row, axis=0), [[a, middle, c], [middle, b, c]]])


DAMAGES: dict[str, Callable[[Array, int, np.random.Generator], Array]] = {
    "flipped facets": _flipped,
    "double facets": _doubled,
    "a small hole": _holed,
    "a T-junction": _split_on_one_side,
}
"""What may happen to the triangles (m, 3, 3) of a file, the top's first."""
