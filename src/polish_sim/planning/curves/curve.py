"""A curve on the surface held as a dense ordered point set with normals: what turns and lines are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curves.near_chords import near_chords
from polish_sim.spatial import unit

Array = NDArray[np.float64]
SAME = 1e-9
"""Distances that differ by less than this share are the same."""


class Nearest(NamedTuple):
    """Nearest points of a curve."""

    s: Array
    """Arc length of the foot [m], shape (n,)."""
    positions: Array
    """Foot on the chord [m], shape (n, 3)."""
    normals: Array
    """Unit surface normal interpolated at the foot, shape (n, 3)."""
    distances: Array
    """Euclidean distance, inf beyond the limit asked for [m], shape (n,)."""


@dataclass(frozen=True, eq=False)
class Curve:
    """An open or closed polyline on the surface; closed ones run with the inside on the left."""

    positions: Array
    """Points [m], shape (n, 3); a closed curve does not repeat its first point."""
    normals: Array
    """Unit outward surface normals, shape (n, 3)."""
    closed: bool

    @cached_property
    def _knots(self) -> tuple[Array, Array, Array]:
        """Positions, normals and arc length with the first point repeated at the end of a closed curve."""
        rows = np.arange(len(self.positions) + self.closed) % len(self.positions)
        positions, normals = self.positions[rows], self.normals[rows]
        chords = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        return positions, normals, np.concatenate([[0.0], np.cumsum(chords)])

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over the curve's own points."""
        return cKDTree(self.positions)

    @property
    def length(self) -> float:
        """Length of all chords [m]."""
        return float(self._knots[2][-1])

    @property
    def knots(self) -> Array:
        """Arc length of the points, one more on a closed curve [m]."""
        return self._knots[2]

    def backwards(self) -> Curve:
        """The same curve run through the other way."""
        return Curve(self.positions[::-1], self.normals[::-1], self.closed)

    def wrap(self, s: Array) -> Array:
        """Bring arc lengths into the curve's range: around a closed curve, to the ends of an open one."""
        return np.mod(s, self.length) if self.closed else np.clip(s, 0.0, self.length)

    def at(self, s: Array) -> tuple[Array, Array]:
        """Positions [m] and unit normals at arc lengths, each (n, 3)."""
        positions, normals, knots = self._knots
        where = self.wrap(np.asarray(s, dtype=float))
        index = np.clip(np.searchsorted(knots, where, side="right") - 1, 0, len(knots) - 2)
        span = knots[index + 1] - knots[index]
        share = ((where - knots[index]) / np.where(span > 0.0, span, 1.0))[:, None]
        return (
            positions[index] + share * (positions[index + 1] - positions[index]),
            unit(normals[index] + share * (normals[index + 1] - normals[index])),
        )

    def tangents(self, s: Array, reach: float) -> Array:
        """Unit tangents from a central difference over +-reach [m], shape (n, 3)."""
        return unit(self.at(s + reach)[0] - self.at(s - reach)[0])

    def between(self, first: float, last: float) -> tuple[Array, Array]:
        """Positions and normals from one arc length to a later one, the curve's own points between them."""
        knots = self.knots[:-1] if self.closed else self.knots
        turns = np.arange(np.floor(first / self.length), np.floor(last / self.length) + 1) if self.closed else [0.0]
        inner = np.concatenate([knots + turn * self.length for turn in turns])
        margin = 1e-6 * self.length
        inner = inner[(inner > first + margin) & (inner < last - margin)]
        return self.at(np.concatenate([[first], inner, [last]]))

    def nearest(self, points: Array, limit: float = np.inf) -> Nearest:
        """Nearest point of the curve, on its chords.

        Args:
            points: Where from [m], shape (n, 3).
            limit: Do not look further than this [m].

        Returns:
            Feet and distances; beyond the limit the distance is inf and the foot is meaningless.
        """
        both, order = self.tree.query(points, k=2, distance_upper_bound=limit)
        # Of two points equally far away the first, whichever rounding puts nearer.
        tie = np.isfinite(both[:, 1]) & (both[:, 1] < (1.0 + SAME) * both[:, 0])
        distances, index = both[:, 0], np.where(tie, order.min(axis=1), order[:, 0])
        found = np.isfinite(distances)
        s, foot, normal = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros((len(points), 3))
        s[found], foot[found], normal[found], distances[found] = self.near_point(points[found], index[found])
        return Nearest(s, foot, normal, distances)

    def near_point(self, points: Array, index: NDArray[np.int64]) -> Nearest:
        """Nearest points on the two chords that meet in the curve's own points of these numbers, (n,)."""
        s, foot, normal, gap = near_chords(*self._knots, len(self.positions), self.closed, points, index)
        return Nearest(s, foot, unit(normal), gap)
