"""What is left of a region and how far it lies from the turns so far (Triangulation -> Front).

A vertex is looked at only when the turns come near it: until then a lower bound of its distance is kept, and vertices
wait in the order in which their bounds fall due. So all turns together cost little more than a few looks per vertex.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.planning.curves.offset_curve import CurveSet
from polish_sim.planning.ground.triangulation import Triangulation

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BEYOND = 0.6
"""Distances are exact up to this many step-overs beyond the next turn; edges are a third of one long."""
SCOUTS = 1.5
"""Bounds far away are looked up for one vertex in each cell of so many step-overs."""
FAR = 6.0
"""Vertices that only see turns on the other side of the part are thought to be so many step-overs away."""

Waiting = dict[int, list[Ints]]
"""Vertices by the number of the turn at which they are to be looked at."""


class Looked(NamedTuple):
    """The vertices near the turns so far."""

    rows: Ints
    """Those looked at, shape (k,)."""
    distances: Array
    """How far they are; lower bounds beyond the next turn [m], shape (k,)."""


class Front:
    """Distances of the vertices not covered yet, from turn to turn."""

    def __init__(self, mesh: Triangulation, first: float, stepover: float) -> None:
        count = len(mesh.vertices)
        self.mesh, self.first, self.stepover = mesh, first, stepover
        self.values = np.full(count, FAR * stepover)
        """Distances to the last turns [m]; 0 where covered, no less than FAR where nobody looked yet, (n,)."""
        self.which = np.full(count, -1)
        """The nearest of the last turns around, -1 where unknown, (n,)."""
        self._bounds = np.zeros(count)
        self._scouts = _scouts(mesh.vertices, SCOUTS * stepover)
        self._marks, self._mark = np.zeros(len(mesh.triangles), dtype=np.int64), 0

    def step(self, number: int) -> float:
        """Distance from turn to turn; of the first from the border [m]."""
        return self.stepover if number else self.first

    def look(self, rows: Ints, curves: CurveSet, number: int) -> Looked:
        """Bring the distances of vertices to the turns of a number up to date."""
        cap, reach = FAR * self.stepover, self.step(number) + BEYOND * self.stepover
        points = self.mesh.vertices[rows]
        distances = self._at_least(rows, curves)
        near = np.flatnonzero(distances < reach)
        which, feet = curves.nearest(points[near], cap)
        same_side = (feet.normals * self.mesh.normals[rows[near]]).sum(axis=1) > 0.0
        exact = np.isfinite(feet.distances)
        distances[near] = np.where(exact & same_side, feet.distances, cap)
        self.which[rows] = -1
        self.which[rows[near]] = np.where(exact & same_side, which, -1)
        self.values[rows] = np.minimum(distances, cap)
        self._bounds[rows] = distances + self._level(number)
        return Looked(rows, distances)

    def _at_least(self, rows: Ints, curves: CurveSet) -> Array:
        """Lower bounds of the distances of vertices to turns: those of their scouts less the ways to them [m]."""
        scouts, which = np.unique(self._scouts[rows], return_inverse=True)
        points = self.mesh.vertices
        away = np.linalg.norm(points[rows] - points[scouts][which], axis=1)
        return np.asarray(curves.at_least(points[scouts])[which] - away)

    def triangles_around(self, rows: Ints) -> Ints:
        """Triangles with a corner among vertices, each once."""
        self._mark += 1
        # In their own order, on which it depends where closed lines begin.
        return np.sort(_around(*self.mesh.around, rows, self._marks, self._mark))

    def put_off(self, rows: Ints, number: int, waiting: Waiting) -> None:
        """Let vertices wait until a turn later than this one comes near them."""
        turns = np.floor((self._bounds[rows] - self.first) / self.stepover - BEYOND).astype(np.int64) + 1
        for turn, group in _grouped(np.maximum(turns, number + 1), rows):
            waiting.setdefault(turn, []).append(group)

    def at_least(self, rows: Ints, number: int) -> Array:
        """Lower bounds of the distances of vertices to the turns of a number; exact near them [m]."""
        return np.asarray(self._bounds[rows] - self._level(number))

    def _level(self, number: int) -> float:
        """How far the turns of a number are from the border [m]."""
        return self.first + (number - 1) * self.stepover if number else 0.0


def _scouts(points: Array, size: float) -> Ints:
    """The first vertex in each cell of a grid, told to all in the cell, shape (n,)."""
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    counts = cells.max(axis=0) + 1
    keys = (cells[:, 0] * counts[1] + cells[:, 1]) * counts[2] + cells[:, 2]
    _, first, which = np.unique(keys, return_index=True, return_inverse=True)
    return np.asarray(first[which])


def all_rows(waiting: Waiting) -> Ints:
    """All vertices that wait, shape (n,)."""
    parts = [part for parts in waiting.values() for part in parts]
    return np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)


def _grouped(keys: Ints, rows: Ints) -> Iterator[tuple[int, Ints]]:
    order = np.argsort(keys, kind="stable")
    values, starts = np.unique(keys[order], return_index=True)
    ends = np.append(starts[1:], len(rows))[: len(starts)]
    for value, start, end in zip(values, starts, ends, strict=True):
        yield int(value), rows[order[start:end]]


def select_rows(waiting: Waiting, chosen: NDArray[np.bool_]) -> Waiting:
    """Those that wait among the chosen vertices, a mask of shape (n,)."""
    picked = {turn: [part[chosen[part]] for part in parts] for turn, parts in waiting.items()}
    return {turn: parts for turn, parts in picked.items() if any(len(part) for part in parts)}


@njit(cache=True, error_model="numpy")
def _around(starts, members, rows, marks, mark):  # type: ignore[no-untyped-def]
    """Triangles around vertices in order of the vertices; those found carry the mark."""
    most = 0
    for v in rows:
        most += starts[v + 1] - starts[v]
    found, count = np.empty(most, np.int64), 0
    for v in rows:
        for j in range(starts[v], starts[v + 1]):
            t = members[j]
            if marks[t] != mark:
                marks[t] = mark
                found[count] = t
                count += 1
    return found[:count]
