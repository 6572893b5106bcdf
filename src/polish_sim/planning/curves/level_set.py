"""Lines of equal value of a field on a triangulation, as ordered point lists (vertex values -> polylines)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.planning.ground.triangulation import Triangulation

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING = 1e-6
"""Vertices above the level by no more than this share of the values' range lie on it."""


class LevelLine(NamedTuple):
    """A piece of a level line, the higher values on its left."""

    positions: Array
    """Points on edges of the triangulation [m], shape (n, 3); a closed line does not repeat its first."""
    normals: Array
    """Surface normals, not normalised, shape (n, 3)."""
    vertices: Ints
    """A vertex with a higher value beside each point, shape (n,)."""
    closed: bool


def level_lines(mesh: Triangulation, values: Array, level: float) -> list[LevelLine]:
    """Trace the lines on which a field interpolated over the triangles has a value.

    Args:
        mesh: The triangulation.
        values: Field at the vertices, shape (n,).
        level: The value; vertices exactly on it count as lower.

    Returns:
        Closed lines, and open ones that end at the border.
    """
    finite = values[np.isfinite(values)]
    higher = values > level + ROUNDING * float(finite.max(initial=level) - finite.min(initial=level))
    a, b, c = (higher[mesh.triangles[:, k]] for k in range(3))
    crossed = np.flatnonzero((a != b) | (b != c))
    if len(crossed) == 0:
        return []
    triangles = mesh.triangles[crossed]
    flags = higher[triangles]
    rising = np.argmax(~flags & np.roll(flags, -1, axis=1), axis=1)
    falling = np.argmax(flags & ~np.roll(flags, -1, axis=1), axis=1)
    rows = np.arange(len(triangles))
    # Points lie on edges named (lower vertex, higher vertex); entering over the falling edge keeps higher left.
    enter = np.stack([triangles[rows, (falling + 1) % 3], triangles[rows, falling]], axis=1)
    leave = np.stack([triangles[rows, rising], triangles[rows, (rising + 1) % 3]], axis=1)
    count = len(mesh.vertices)
    start, end = (edge[:, 0] * count + edge[:, 1] for edge in (enter, leave))
    keys, index = np.unique(np.concatenate([start, end]), return_inverse=True)
    chains = _chain(index[: len(start)], index[len(start) :], len(keys))
    low, high = keys // count, keys % count
    share = np.clip((level - values[low]) / (values[high] - values[low]), 0.0, 1.0)[:, None]
    positions = mesh.vertices[low] + share * (mesh.vertices[high] - mesh.vertices[low])
    normals = mesh.normals[low] + share * (mesh.normals[high] - mesh.normals[low])
    return [LevelLine(positions[c], normals[c], high[c], closed) for c, closed in chains]


def _chain(start: Ints, end: Ints, count: int) -> list[tuple[Ints, bool]]:
    """Link directed segments between edge points into lines: open ones first, then closed ones."""
    follower = np.full(count, -1, dtype=np.int64)
    follower[start] = end
    has_leader = np.zeros(count, dtype=bool)
    has_leader[end] = True
    following: list[int] = follower.tolist()
    seen = [False] * count
    chains = []
    heads = np.flatnonzero(~has_leader).tolist()
    for head, closed in [(h, False) for h in heads] + [(k, True) for k in start.tolist()]:
        line, here = [], head
        while here >= 0 and not seen[here]:
            seen[here] = True
            line.append(here)
            here = following[here]
        if len(line) >= 3:
            chains.append((np.array(line), closed))
    return chains
