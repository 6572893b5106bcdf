"""Lines of equal value of a field on a triangulation, as ordered point lists (vertex values -> polylines)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
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


def level_lines(mesh: Triangulation, values: Array, level: float, among: Ints | None = None) -> list[LevelLine]:
    """Trace the lines on which a field interpolated over the triangles has a value.

    Args:
        mesh: The triangulation.
        values: Field at the vertices, shape (n,).
        level: The value; vertices exactly on it count as lower.
        among: Triangles to look at, shape (k,); all if not given.

    Returns:
        Closed lines, and open ones that end at the border.
    """
    triangles = mesh.triangles if among is None else mesh.triangles[among]
    found = values[triangles]
    finite = found[np.isfinite(found)]
    flags = found > level + ROUNDING * float(finite.max(initial=level) - finite.min(initial=level))
    crossed = (flags[:, 0] != flags[:, 1]) | (flags[:, 1] != flags[:, 2])
    if not crossed.any():
        return []
    triangles, flags = triangles[crossed], flags[crossed]
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
    order, ends, heads = _walk(start, end, count)
    lines = np.split(order, ends[:-1])
    return [(line, k >= heads) for k, line in enumerate(lines) if len(line) >= 3]


@njit(cache=True, error_model="numpy")
def _walk(start, end, count):  # type: ignore[no-untyped-def]
    """All points in the order of the lines they form, where each line ends in it, and how many lines are open."""
    follower, leaders = np.full(count, -1, np.int64), np.zeros(count, np.int64)
    for k in range(len(start)):
        follower[start[k]] = end[k]
        leaders[end[k]] += 1
    seen = np.zeros(count, np.bool_)
    order, ends = np.empty(count, np.int64), np.empty(count, np.int64)
    points, lines, heads = 0, 0, 0
    for k in range(count + len(start)):
        # Lines that begin somewhere come before those that do not.
        here = k if k < count else start[k - count]
        if seen[here] or (k < count and leaders[k] > 0):
            continue
        while here >= 0 and not seen[here]:
            seen[here] = True
            order[points] = here
            points += 1
            here = follower[here]
        ends[lines] = points
        lines += 1
        heads += k < count
    return order[:points], ends[:lines], heads
