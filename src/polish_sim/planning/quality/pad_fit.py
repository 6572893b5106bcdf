"""Places more hollow than the pad is round (surface, pad -> PadReach)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.geometry import Surface
from polish_sim.geometry.topology import label_pieces

QUARTERS = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0], [2.0, 2.0, 2.0]]) / 6.0
"""Middles of the four quarters of a facet, barycentric."""


class HollowPlace(NamedTuple):
    """A connected place the pad cannot touch."""

    position: Array  #: Where it is tightest [m], shape (3,)
    area_m2: float
    radius_m: float  #: Radius of curvature there [m]


class PadReach(NamedTuple):
    """The parts of a region a pad cannot touch."""

    area_m2: float
    hollow: Array  #: Share of each facet that is too hollow, shape (m,)
    tightness: Array  #: Pad radius over each facet's smallest radius of curvature, negative hollow, shape (m,)
    places: tuple[HollowPlace, ...]  #: Connected places, largest first


def measure_pad_reach(surface: Surface, facets: int, radius: float) -> PadReach:
    """Find where the surface is hollow in any direction with a radius smaller than the pad's: area and places.

    A disc that touches such a place with its middle would have to bend further than its own radius. Facets after the
    first ``facets`` close holes.
    """
    smallest = np.stack([_smallest_curvature(surface, facets, weights) for weights in QUARTERS], axis=1)
    hollow = (smallest * radius < -1.0).mean(axis=1)
    areas = surface.facet_areas[:facets] * hollow
    label, count = _pieces(surface, hollow > 0.0)
    places = []
    middle = np.full((1, 3), 1.0 / 3.0)
    for number in range(count):
        rows = np.flatnonzero(label == number)
        tight = rows[int(smallest[rows].min(axis=1).argmin())]
        position = surface.evaluate(np.array([tight], dtype=np.int32), middle).positions[0]
        places.append(HollowPlace(position, float(areas[rows].sum()), float(-1.0 / smallest[tight].min())))
    places.sort(key=lambda place: -place.area_m2)
    return PadReach(float(areas.sum()), hollow, radius * smallest.min(axis=1), tuple(places))


def _smallest_curvature(surface: Surface, facets: int, weights: Array) -> Array:
    """Smaller principal curvature at one place of every facet [1/m], shape (m,)."""
    a, b, c, d, e, f = np.tensordot(weights, surface.shape[:facets], axes=(0, 1)).T  # diagonal, then the others
    trace = a + b + c
    square = a * a + b * b + c * c + 2.0 * (d * d + e * e + f * f)
    # Of a symmetric operator in the tangent plane: k1 + k2 and k1^2 + k2^2.
    return np.asarray(0.5 * trace - np.sqrt(np.maximum(0.5 * square - 0.25 * trace * trace, 0.0)))


def _pieces(surface: Surface, hollow: Bools) -> tuple[Indices, int]:
    """Connected piece of each hollow facet, -1 elsewhere, (m,), and their number."""
    label = np.full(len(hollow), -1, dtype=np.int64)
    number = np.cumsum(hollow) - 1
    across = surface.neighbours[: len(hollow)]
    joined = hollow[:, None] & (across >= 0) & (across < len(hollow)) & hollow[np.clip(across, 0, len(hollow) - 1)]
    one, edge = np.nonzero(joined)
    ends = number[one], number[across[one, edge]]
    size = int(hollow.sum())
    if size == 0:
        return label, 0
    count, label[hollow] = label_pieces(np.column_stack(ends), size)
    return label, count
