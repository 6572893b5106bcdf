"""What of a part stands above the face of a disc put on it (part, discs -> how far it reaches into their outline).

Only the flat triangles between the patches' corners are looked at: a wall is found however thin it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.geometry import Surface
from polish_sim.geometry.bvh import box_distance2
from polish_sim.spatial import perpendicular

Array = NDArray[np.float64]


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
    """Distance from the axis of what of a triangle lies between two heights [m]; inf if nothing does."""
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
