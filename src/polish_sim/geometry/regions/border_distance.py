"""How far a point of a surface is from its border, measured along the surface (Surface -> distances)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.geometry.surface import Surface

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

_SAMPLES_PER_REACH = 16.0
"""The border is sampled this densely, in shares of the distance of interest."""

_CHORD_ERROR = 1e-6
"""The sampled border is this close to the curved one [m]."""

_MOST_SAMPLES = 400_000

_ARCS = 4
"""Pieces of the way to the border that are taken for circular arcs."""

_NEAR = (0.6, 1.001)
"""Outside these shares of the distance of interest the straight distance, which is never too long, does."""

_FLAT = 5e-7
"""A surface is flat when it leaves a plane by less than this share of its size (float32 noise)."""


class BorderDistance(NamedTuple):
    """The border of a surface, ready to be asked for distances."""

    starts: Floats
    """Where short pieces of the border start [m], shape (b, 3)."""
    ends: Floats
    """Where they end [m], shape (b, 3)."""
    tree: cKDTree
    """Search tree over their middles."""
    reach: float
    """Distances about this are measured along the surface [m]."""
    flat: bool
    """Whether the surface is flat, and straight distances are all there is."""
    length: float
    """Length of the whole border [m]."""

    def at(self, points: Floats, surface: Surface) -> Floats:
        """Distances along the surface.

        The way is the straight line to the nearest point of the border, brought down to the surface at a few
        places between which it is an arc; its length differs from the shortest way's in higher order only.

        Args:
            points: Points on the surface [m], shape (n, 3).
            surface: The surface.

        Returns:
            Distances [m], shape (n,); far from the reach straight ones.
        """
        feet = self._nearest(points)
        distances = np.linalg.norm(points - feet, axis=1)
        low, high = _NEAR
        near = np.flatnonzero((distances > low * self.reach) & (distances < high * self.reach))
        if len(near) and not self.flat:
            distances[near] = _lengths_along(surface, feet[near], points[near])
        return np.asarray(distances)

    def straight(self, points: Floats) -> Floats:
        """Straight distances of points (n, 3) to the border [m], shape (n,)."""
        return np.asarray(np.linalg.norm(points - self._nearest(points), axis=1))

    def _nearest(self, points: Floats) -> Floats:
        """Nearest points of the border to points (n, 3) [m], shape (n, 3)."""
        count = min(3, len(self.starts))
        _, pieces = self.tree.query(points, k=count)
        pieces = np.asarray(pieces).reshape(len(points), count)
        start, along = self.starts[pieces], self.ends[pieces] - self.starts[pieces]
        share = ((points[:, None] - start) * along).sum(axis=2) / np.maximum((along**2).sum(axis=2), 1e-300)
        feet = start + np.clip(share, 0.0, 1.0)[..., None] * along
        best = np.linalg.norm(points[:, None] - feet, axis=2).argmin(axis=1)
        return np.asarray(feet[np.arange(len(points)), best])


def border_distance(surface: Surface, reach: float) -> BorderDistance:
    """Make the border of a surface ready.

    Args:
        surface: An open surface.
        reach: Distance of interest [m].

    Returns:
        What answers how far points are from the border.
    """
    facets, edges = np.nonzero(surface.neighbours < 0)
    a, b = surface.control[facets, edges], surface.control[facets, (edges + 1) % 3]
    c = surface.control[facets, 3 + edges]
    chord = np.linalg.norm(b - a, axis=1)
    sagitta = 0.5 * np.linalg.norm(c - 0.5 * (a + b), axis=1)
    spacing = max(reach / _SAMPLES_PER_REACH, float(chord.sum()) / _MOST_SAMPLES)
    parts = np.maximum(np.ceil(chord / spacing), np.ceil(np.sqrt(sagitta / _CHORD_ERROR)))
    parts = np.maximum(parts, 1.0).astype(np.int64)
    edge = np.repeat(np.arange(len(parts)), parts)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(parts) - parts, parts)
    starts, ends = (_on_curve(a[edge], c[edge], b[edge], (step + k) / parts[edge]) for k in (0, 1))
    return BorderDistance(
        starts=starts,
        ends=ends,
        tree=cKDTree(0.5 * (starts + ends)),
        reach=reach,
        flat=_is_flat(surface),
        length=float(np.linalg.norm(ends - starts, axis=1).sum()),
    )


def _is_flat(surface: Surface) -> bool:
    points = surface.control.reshape(-1, 3)
    normal = surface.evaluate(np.zeros(1, dtype=np.int32), np.full((1, 3), 1.0 / 3.0)).normals[0]
    return float(np.ptp(points @ normal)) < _FLAT * float(np.ptp(points, axis=0).max())


def _on_curve(a: Floats, c: Floats, b: Floats, share: Floats) -> Floats:
    t = share[:, None]
    return np.asarray((1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * c + t**2 * b)


def _lengths_along(surface: Surface, starts: Floats, ends: Floats) -> Floats:
    """Lengths of the straight lines brought down to the surface [m], shape (n,)."""
    share = np.linspace(0.0, 1.0, _ARCS + 1)[:, None, None]
    straight = (starts + share * (ends - starts)).reshape(-1, 3)
    foot = surface.closest(straight)
    places = foot.positions.reshape(_ARCS + 1, -1, 3)
    normals = foot.normals.reshape(_ARCS + 1, -1, 3)
    chords = places[1:] - places[:-1]
    length = np.linalg.norm(chords, axis=2)
    # On an arc the normals' difference along the chord is twice the sine of half its angle.
    turn = ((normals[1:] - normals[:-1]) * chords).sum(axis=2) / np.maximum(length, 1e-300)
    half = np.arcsin(np.clip(0.5 * turn, -0.9, 0.9))
    stretch = np.where(np.abs(half) < 1e-6, 1.0, half / np.where(half == 0.0, 1.0, np.sin(half)))
    return np.asarray((length * stretch).sum(axis=0))
