"""A curve on the surface held as a dense ordered point set with normals: what turns and lines are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, dots, foot_on_chord, into_plane, running_sums, spans_at, unit
from polish_sim.geometry import ClosestPoints, Surface
from polish_sim.planning.toolpath import arc_length

# Equal-distance stepping on a surface (paper 1, section 1.2, fig. 4): the one primitive all turns are built
# from.

ITERATIONS = 20
TOLERANCE_M = 1e-11


def step_on_surface(
    surface: Surface, start: Array, normals: Array, directions: Array, distance: Array | float
) -> ClosestPoints:
    """From points P (n, 3) on the surface go along ``directions`` (n, 3) to the points at a Euclidean
    distance S [m].

    The end point lies in the plane spanned by direction t and normal n of the start, at P + a t + h n with
    a^2 + h^2 = S^2; Newton's method finds the height h at which it meets the surface. Directions have any
    length and any normal part. Where the surface ends before S its closest border point is the end; zero
    distances stay.
    """
    step = np.broadcast_to(distance, (len(start),))
    tangents = unit(into_plane(directions, normals))
    height = np.zeros(len(start))
    foot = None
    for _ in range(ITERATIONS):
        along = np.sqrt(np.maximum(step**2 - height**2, 0.0))
        trial = start + along[:, None] * tangents + height[:, None] * normals
        foot = surface.closest(trial, None if foot is None else foot.facets)
        error = dots(trial - foot.positions, foot.normals)  # signed height of the trial above the surface
        if np.abs(error).max(initial=0.0) < TOLERANCE_M:
            break
        # How fast that gap changes when the trial swings along the circle of radius S.
        swing = normals - (height / np.maximum(along, 1e-12))[:, None] * tangents
        rate = dots(swing, foot.normals)
        update = error / np.where(np.abs(rate) < 0.2, np.copysign(0.2, rate), rate)
        height = np.clip(height - update, -0.95 * step, 0.95 * step)
    assert foot is not None
    return foot


def interpolated(positions: Array, normals: Array, knots: Array, where: Array) -> tuple[Array, Array]:
    """Positions [m] and unit normals, (n, 3) each, at places (n,) among growing ``knots`` of a polyline."""
    index = spans_at(knots, where)
    span = knots[index + 1] - knots[index]
    share = ((where - knots[index]) / np.where(span > 0.0, span, 1.0))[:, None]
    return (
        positions[index] + share * (positions[index + 1] - positions[index]),
        unit(normals[index] + share * (normals[index + 1] - normals[index])),
    )


class Nearest(NamedTuple):
    """Nearest points of a curve."""

    s: Array  #: Arc length of the foot [m], shape (n,)
    positions: Array  #: Foot on the chord [m], shape (n, 3)
    normals: Array  #: Unit surface normal interpolated at the foot, shape (n, 3)
    distances: Array  #: Euclidean distance, inf beyond the limit asked for [m], shape (n,)
    curve: Indices  #: Which of several, shape (n,)


@dataclass(frozen=True, eq=False)
class Curve:
    """An open or closed polyline on the surface; closed ones run with the inside on the left."""

    positions: Array  #: Points [m], shape (n, 3); a closed curve does not repeat its first point
    normals: Array  #: Unit outward surface normals, shape (n, 3)
    closed: bool

    @cached_property
    def _knots(self) -> tuple[Array, Array, Array]:
        """Positions, normals and arc length with the first point repeated at the end of a closed curve."""
        rows = np.arange(len(self.positions) + self.closed) % len(self.positions)
        positions, normals = self.positions[rows], self.normals[rows]
        return positions, normals, arc_length(positions)

    @cached_property
    def tree(self) -> cKDTree:
        """Search tree over the curve's own points."""
        return cKDTree(self.positions)

    @property
    def length(self) -> float:
        """Length of all chords [m]."""
        return self._knots[2][-1]

    @property
    def knots(self) -> Array:
        """Arc length of the points, one more on a closed curve [m]."""
        return self._knots[2]

    def backwards(self) -> Curve:
        """The same curve run through the other way."""
        return Curve(self.positions[::-1], self.normals[::-1], self.closed)

    def even(self, spacing: float, least: int) -> Array:
        """Arc lengths all round a closed curve at equal steps, about a ``spacing`` [m], ``least`` of them or
        more."""
        return np.linspace(0.0, self.length, max(int(self.length / spacing), least), endpoint=False)

    def wrap(self, s: Array) -> Array:
        """Bring arc lengths into the curve's range: around a closed curve, to the ends of an open one."""
        return np.mod(s, self.length) if self.closed else np.clip(s, 0.0, self.length)

    def at(self, s: Array) -> tuple[Array, Array]:
        """Positions [m] and unit normals at arc lengths, each (n, 3)."""
        return interpolated(*self._knots, self.wrap(np.asarray(s, dtype=float)))

    def points(self, s: Array) -> Array:
        """Positions at arc lengths [m], shape (n, 3)."""
        return self.at(s)[0]

    def tangents(self, s: Array, reach: float) -> Array:
        """Unit tangents from a central difference over +-reach [m], shape (n, 3)."""
        return unit(self.points(s + reach) - self.points(s - reach))

    def between(self, first: float, last: float) -> Array:
        """Positions from one arc length to a later one, the curve's own points between them [m], (n, 3)."""
        knots = self.knots[:-1] if self.closed else self.knots
        turns = (
            np.arange(np.floor(first / self.length), np.floor(last / self.length) + 1)
            if self.closed
            else [0.0]
        )
        inner = np.concatenate([knots + turn * self.length for turn in turns])
        margin = 1e-6 * self.length
        inner = inner[(inner > first + margin) & (inner < last - margin)]
        return self.points(np.concatenate([[first], inner, [last]]))

    def along(self, s: float, way: float) -> Array:
        """Positions from an arc length on, over a way [m]; against the curve's direction if that is
        negative."""
        return self.between(s, s + way) if way >= 0.0 else self.between(s + way, s)[::-1]

    def near_chords(self, points: Array, index: Indices) -> tuple[Array, Array, Array, Array]:
        """Nearest points, to points (n, 3) [m], on the chords before and behind the curve's points ``index``
        (n,): arc lengths (n,), feet (n, 3), normals there, not normalised, (n, 3), and distances (n,)."""
        positions, normals, knots = self._knots
        both, last = np.stack([index - 1, index]), len(knots) - 2
        both = both % (last + 1) if self.closed else np.clip(both, 0, last)
        share, gap = foot_on_chord(points - positions[both], positions[both + 1] - positions[both])
        nearer = gap.argmin(axis=0), np.arange(len(points))
        at, along = both[nearer], share[nearer]
        s = knots[at] + along * (knots[at + 1] - knots[at])
        foot, normal = (
            column[at] + along[:, None] * (column[at + 1] - column[at]) for column in (positions, normals)
        )
        return s, foot, normal, gap[nearer]

    def nearest(self, points: Array, limit: float = np.inf) -> Nearest:
        """Nearest points of the curve, on its chords, to points (n, 3) [m]; beyond the limit [m] distances
        are inf."""
        return CurveSet([self]).nearest(points, limit)


@dataclass(frozen=True, eq=False)
class CurveSet:
    """Several curves, asked which of them is nearest."""

    curves: Sequence[Curve]

    @cached_property
    def _starts(self) -> Indices:
        return running_sums([len(curve.positions) for curve in self.curves])

    @cached_property
    def _tree(self) -> cKDTree:
        if len(self.curves) == 1:
            return self.curves[0].tree
        return cKDTree(np.concatenate([curve.positions for curve in self.curves]))

    def nearest(self, points: Array, limit: float = np.inf) -> Nearest:
        """Nearest points of the closest curve; distances beyond the limit [m] are inf."""
        distances, found = self._tree.query(points, distance_upper_bound=limit)
        which = np.searchsorted(self._starts, found, side="right") - 1
        s, foot, normal = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros((len(points), 3))
        for number, curve in enumerate(self.curves):
            rows = np.flatnonzero(which == number)
            near = curve.near_chords(points[rows], found[rows] - self._starts[number])
            s[rows], foot[rows], normal[rows], distances[rows] = near
        return Nearest(s, foot, unit(normal), distances, which)
