"""Places too hollow for the pad, and where it runs into the part beside the region, as into a pocket's wall."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.config import PadConfig
from polish_sim.errors import place_in_mm
from polish_sim.geometry import Surface
from polish_sim.geometry.closest import box_distance2
from polish_sim.geometry.topology import label_pieces
from polish_sim.kernel_cache import njit
from polish_sim.planning.quality.coverage import rows_apart
from polish_sim.planning.quality.located import PathOnSurface
from polish_sim.planning.toolpath import arc_length
from polish_sim.spatial import perpendicular

QUARTERS = np.array([[4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0], [2.0, 2.0, 2.0]]) / 6.0
"""Middles of the four quarters of a facet, barycentric."""


class HollowPlace(NamedTuple):
    """A connected place the pad cannot touch."""

    position: Array
    """Where it is tightest [m], shape (3,)."""
    area_m2: float
    radius_m: float
    """Radius of curvature there [m]."""


class PadReach(NamedTuple):
    """The parts of a region a pad cannot touch."""

    area_m2: float
    hollow: Array
    """Share of each facet that is too hollow, shape (m,)."""
    tightness: Array
    """Pad radius over the smallest radius of curvature of each facet, negative hollow, below -1 out of reach, (m,)."""
    places: tuple[HollowPlace, ...]
    """Connected places, largest first."""


def measure_pad_reach(surface: Surface, facets: int, radius: float) -> PadReach:
    """Find where the surface is hollow in any direction with a radius smaller than the pad's.

    A disc that touches such a place with its middle would have to bend further than its own radius.

    Args:
        surface: The region's surface.
        facets: Number of its first facets that are the part's; the others close holes.
        radius: Of the pad [m].

    Returns:
        Area and places.
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


class Discs(NamedTuple):
    """Discs and the layer above each in which nothing of the part may be."""

    middles: Array
    """[m], shape (n, 3)."""
    axes: Array
    """Unit vectors away from the part, shape (n, 3)."""
    lows: Array
    """Where the layer begins above the disc's plane [m], shape (n,)."""
    highs: Array
    """And where it ends [m], shape (n,)."""
    radius: float
    """[m]."""


class Intrusion(NamedTuple):
    """What is in the layers; zeros where there is nothing."""

    depths: Array
    """How deep a disc stands in the part [m], shape (n,): behind the plane of a face, beside or below its edge."""
    reaches: Array
    """How far the part reaches into a disc from its rim [m]: so far the disc would have to move aside, shape (n,)."""


def standing_above(part: Surface, discs: Discs) -> Intrusion:
    """Find the faces of a part that stand in the layers above discs.

    Only the flat triangles between the patches' corners are tested: a wall is found however thin it is.

    Args:
        part: The whole part.
        discs: The discs.

    Returns:
        How far each disc is in the part.
    """
    across = perpendicular(discs.axes)
    frames = np.stack([across, np.cross(discs.axes, across), discs.axes], axis=1)
    depths, reaches = _look(part.control, part.tree, discs, np.ascontiguousarray(frames))
    return Intrusion(depths, reaches)


@njit(cache=True, error_model="numpy")
def _look(control, tree, discs, frames):  # type: ignore[no-untyped-def]
    count, radius = len(discs.middles), discs.radius
    depths, reaches = np.zeros(count), np.zeros(count)
    nodes, corner, layer, cut = np.empty(64, np.int32), np.empty((3, 3)), np.empty((6, 3)), np.empty((6, 3))
    for i in range(count):
        x, y, z = discs.middles[i]
        low, high = discs.lows[i], discs.highs[i]
        around2 = radius * radius + high * high
        nodes[0], top = 0, 1
        while top > 0:
            top -= 1
            node = nodes[top]
            if box_distance2(tree.low, tree.high, node, x, y, z) > around2:
                continue
            if _top_of_box(tree, node, discs.middles[i], discs.axes[i]) <= low:
                continue
            if tree.right[node] >= 0:
                nodes[top], nodes[top + 1] = tree.right[node], node + 1
                top += 2
                continue
            for k in range(tree.first[node], tree.first[node] + tree.size[node]):
                _seen_from(control[tree.items[k]], discs.middles[i], frames[i], corner)
                gap = _distance_in_layer(corner, low, high, layer, cut)
                if gap < radius:
                    reaches[i] = max(reaches[i], radius - gap)
                    depths[i] = max(depths[i], min(radius - gap, _depth_behind(corner, radius)))
    return depths, reaches


@njit(cache=True, error_model="numpy")
def _top_of_box(tree, node, middle, axis):  # type: ignore[no-untyped-def]
    """Height of a box's highest corner above a disc's plane [m]."""
    height = 0.0
    for k in range(3):
        corner = tree.high[node, k] if axis[k] > 0.0 else tree.low[node, k]
        height += axis[k] * (corner - middle[k])
    return height


@njit(cache=True, error_model="numpy")
def _seen_from(patch, middle, frame, corner):  # type: ignore[no-untyped-def]
    """Write the corners of a patch in a disc's frame."""
    for a in range(3):
        for k in range(3):
            total = 0.0
            for j in range(3):
                total += frame[k, j] * (patch[a, j] - middle[j])
            corner[a, k] = total


@njit(cache=True, error_model="numpy")
def _distance_in_layer(corner, low, high, layer, cut):  # type: ignore[no-untyped-def]
    """Distance from the axis to the part of a triangle between two heights [m]; inf if there is none."""
    if max(corner[0, 2], corner[1, 2], corner[2, 2]) <= low or min(corner[0, 2], corner[1, 2], corner[2, 2]) >= high:
        return np.inf
    count = _cut_off(corner, 3, 1.0, low, layer)
    count = _cut_off(layer, count, -1.0, -high, cut)
    nearest2, left, right = np.inf, 0, 0
    for a in range(count):
        b = (a + 1) % count
        px, py = cut[a, 0], cut[a, 1]
        dx, dy = cut[b, 0] - px, cut[b, 1] - py
        t = min(max(-(px * dx + py * dy) / max(dx * dx + dy * dy, 1e-300), 0.0), 1.0)
        nearest2 = min(nearest2, (px + t * dx) ** 2 + (py + t * dy) ** 2)
        side = dx * py - dy * px
        left += side > 0.0
        right += side < 0.0
    if count >= 3 and (left == count or right == count):
        return 0.0
    return np.sqrt(nearest2)


@njit(cache=True, error_model="numpy")
def _cut_off(points, count, sign, limit, out):  # type: ignore[no-untyped-def]
    """Keep what of a polygon has sign * z > limit; returns its number of corners."""
    kept = 0
    for a in range(count):
        b = (a + 1) % count
        here, there = sign * points[a, 2] - limit, sign * points[b, 2] - limit
        if here > 0.0:
            for k in range(3):
                out[kept, k] = points[a, k]
            kept += 1
        if (here > 0.0) != (there > 0.0):
            t = here / (here - there)
            for k in range(3):
                out[kept, k] = points[a, k] + t * (points[b, k] - points[a, k])
            kept += 1
    return kept


@njit(cache=True, error_model="numpy")
def _depth_behind(corner, radius):  # type: ignore[no-untyped-def]
    """How deep the disc can be in the part at a face [m]: not deeper than the face is high, nor than its slope lets."""
    highest = max(corner[0, 2], corner[1, 2], corner[2, 2])
    ax, ay, az = corner[1, 0] - corner[0, 0], corner[1, 1] - corner[0, 1], corner[1, 2] - corner[0, 2]
    bx, by, bz = corner[2, 0] - corner[0, 0], corner[2, 1] - corner[0, 1], corner[2, 2] - corner[0, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-300)
    offset = (corner[0, 0] * nx + corner[0, 1] * ny + corner[0, 2] * nz) / size
    # The rim's deepest point behind the plane of a face that looks up or to the side, towards the disc.
    behind = radius * np.sqrt(nx * nx + ny * ny) / size + offset
    if nz >= -1e-9 * size and behind > 0.0:
        return min(highest, behind)
    return highest


APART = 0.25
"""The pad is looked at so many of its radii apart along the path."""
LAYER = 1.0
"""What stands higher above the pad's face than so many of its radii does not belong to a wall beside it."""
RIM_POINTS = 32
RINGS = (0.25, 0.5, 0.75, 1.0)
"""Where on the pad its own place's hollow and the tool's tilt are looked at."""


class PadInPart(NamedTuple):
    """Tool points at which the pad's disc is in the part."""

    positions: Array
    """[m], shape (k, 3)."""
    depths: Array
    """How deep it is [m], shape (k,)."""
    reaches: Array
    """How much further away from there the tool point would have to be [m], shape (k,)."""
    lengths: Array
    """Length of the path each stands for [m], shape (k,)."""
    pad_radius: float
    """[m]."""

    @property
    def max_m(self) -> float:
        """Deepest [m]; 0 if the pad is nowhere in the part."""
        return float(self.depths.max(initial=0.0))

    @property
    def length_m(self) -> float:
        """Length of the path on which the pad is in the part [m]."""
        return float(self.lengths.sum())

    @property
    def figures(self) -> dict[str, Any]:
        """For metrics.json; the place is empty if the pad is nowhere in the part."""
        at = self.positions[self.depths.argmax()].tolist() if len(self.depths) else []
        return {"pad_in_part_max_m": self.max_m, "pad_in_part_length_m": self.length_m, "pad_in_part_at_m": at}


def find_pad_in_part(on: PathOnSurface, part: Surface, pad: PadConfig) -> PadInPart:
    """Carry the pad's disc along the path and look for what of the part stands above its face.

    The pad yields as far as the force presses it, F / k, and over a hollow place or tilted as far as that place's
    curvatures and the tilt make it: what stands no higher than both together is polished, not run into, nor is what
    the pad is in no deeper than it yields. A place more hollow than the pad counts with the pad's radius;
    `measure_pad_reach` reports it.

    Args:
        on: The path on its region.
        part: The whole part.
        pad: The pad.

    Returns:
        Where the pad is in the part.
    """
    s = arc_length(on.positions)
    rows = rows_apart(on, s, APART * pad.radius_m)
    yields = on.forces[rows] / pad.stiffness_n_m
    lows = _own_heights(on, rows, pad.radius_m) + yields
    discs = Discs(on.positions[rows], on.axes[rows], lows, lows + LAYER * pad.radius_m, pad.radius_m)
    found = standing_above(part, discs)
    way = np.where(np.diff(on.stretch_of[rows]) == 0, np.diff(s[rows]), 0.0)
    lengths = 0.5 * (np.append(way, 0.0) + np.append(0.0, way))
    hit = found.depths > yields
    return PadInPart(discs.middles[hit], found.depths[hit], found.reaches[hit], lengths[hit], pad.radius_m)


def _own_heights(on: PathOnSurface, rows: Indices, radius: float) -> Array:
    """How high the place under the pad stands above its face by its curvatures and the tool's tilt [m], (n,)."""
    second = np.cross(on.normals[rows], on.principal[rows])
    lean = on.axes[rows] / (on.axes[rows] * on.normals[rows]).sum(axis=1, keepdims=True)
    tilt, beside = ((lean * way).sum(axis=1)[:, None] for way in (on.principal[rows], second))
    bend = np.maximum(on.curvatures[rows], -1.0 / radius)
    angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
    highest = np.zeros(len(rows))
    for ring in RINGS:
        x, y = ring * radius * np.cos(angle), ring * radius * np.sin(angle)
        height = tilt * x + beside * y - 0.5 * (bend[:, :1] * x**2 + bend[:, 1:] * y**2)
        highest = np.maximum(highest, height.max(axis=1))
    return highest


def pad_in_part_warning(figures: Mapping[str, Any]) -> str:
    """The figures as a sentence with the worst place; empty if the pad is nowhere in the part."""
    deepest = figures.get("pad_in_part_max_m", 0.0)
    if deepest <= 0.0:
        return ""
    length, place = figures["pad_in_part_length_m"], place_in_mm(np.array(figures["pad_in_part_at_m"]))
    return f"the pad runs up to {1e3 * deepest:.3g} mm into the part over {length:.3g} m of the path, worst at {place}"
