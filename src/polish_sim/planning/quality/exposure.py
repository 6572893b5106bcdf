"""How long each place of a region is under the pad: its compressed disc carried along the path (path -> seconds).

The disc moves in straight steps. Over each, the time a place lies within the disc's edge (a quadratic) and above its
pressed-in face (a line) is an interval known in closed form, so the times are exact for straight paths.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.config import PadConfig
from polish_sim.planning.quality.located import PathOnSurface
from polish_sim.planning.quality.pad_depth import pad_depths
from polish_sim.planning.quality.point_grid import build_point_grid
from polish_sim.spatial import unit

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP = 0.1
"""Length of the pad's steps in pad radii."""
CORNER = np.radians(10.0)
"""Waypoints at which the path turns by more end a step [rad]."""
BALL = 1.05
"""Places further than this many pad radii from the pad's middle are not under it, however tall."""


class PadSteps(NamedTuple):
    """Straight steps of the pad."""

    start: Array
    """Middle of the pad on the surface, before [m], shape (n, 3)."""
    end: Array
    """And after, shape (n, 3)."""
    axes: Array
    """Unit tool axes, shape (n, 3)."""
    depths: Array
    """How deep the pad's face is pressed in at its middle [m], shape (n,)."""
    times: Array
    """How long each step takes [s], shape (n,)."""


def pad_steps(on: PathOnSurface, pad: PadConfig) -> PadSteps:
    """Cut the path in contact into steps of about a tenth of the pad's radius.

    Args:
        on: The path with its forces and feeds.
        pad: The pad.

    Returns:
        The steps.
    """
    length = np.linalg.norm(np.diff(on.positions, axis=0), axis=1)
    slowness = 0.5 * (1.0 / on.feeds[1:] + 1.0 / on.feeds[:-1])
    s, t = (np.concatenate([[0.0], np.cumsum(way)]) for way in (length, length * slowness))
    rows = rows_apart(on, s, STEP * pad.radius_m)
    tilts = np.stack([(on.axes * on.principal).sum(axis=1), (on.axes * _second(on)).sum(axis=1)], axis=1)
    depths = pad_depths(on.curvatures[rows], pad, on.forces[rows], tilts[rows])
    joined = on.stretch_of[rows[1:]] == on.stretch_of[rows[:-1]]
    a, b = rows[:-1][joined], rows[1:][joined]
    mean = 0.5 * (depths[:-1] + depths[1:])[joined]
    return PadSteps(on.positions[a], on.positions[b], unit(on.axes[a] + on.axes[b]), mean, t[b] - t[a])


def _second(on: PathOnSurface) -> Array:
    return np.cross(on.normals, on.principal)


def rows_apart(on: PathOnSurface, s: Array, spacing: float) -> Ints:
    """Rows about a spacing apart; both ends of every stretch and its corners among them."""
    way = unit(np.diff(on.positions, axis=0))
    corner = np.zeros(len(s), dtype=bool)
    corner[1:-1] = (way[1:] * way[:-1]).sum(axis=1) < np.cos(CORNER)
    rows = []
    for stretch in on.stretches:
        first, last = s[stretch[0]], s[stretch[-1]]
        marks = np.linspace(first, last, max(int(np.ceil((last - first) / spacing)), 1) + 1)
        near = np.searchsorted(s[stretch], marks[1:-1])
        rows.append(
            stretch[np.unique(np.concatenate([[0], near, np.flatnonzero(corner[stretch]), [len(stretch) - 1]]))]
        )
    return np.concatenate(rows)


def time_under_pad(points: Array, point_normals: Array, steps: PadSteps, radius: float) -> Array:
    """Time each point lies under the pad's compressed area.

    Args:
        points: Points of the region [m], shape (k, 3).
        point_normals: Unit surface normals there, shape (k, 3).
        steps: The pad's steps.
        radius: Of the pad [m].

    Returns:
        Times [s], shape (k,); exactly zero where the pad never is.
    """
    grid = build_point_grid(points, 0.35 * radius)
    return np.asarray(_sum_up(points, point_normals, steps, radius, grid))


@njit(cache=True, error_model="numpy")
def _sum_up(points, point_normals, steps, radius, grid):  # type: ignore[no-untyped-def]
    times = np.zeros(len(points))
    reach = BALL * radius
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(len(steps.start)):
        a, b, axis = steps.start[k], steps.end[k], steps.axes[k]
        for d in range(3):
            least, most = min(a[d], b[d]) - reach - grid.low[d], max(a[d], b[d]) + reach - grid.low[d]
            low[d] = int(max(np.floor(least / grid.cell), 0))
            high[d] = int(min(np.floor(most / grid.cell), grid.size[d] - 1)) + 1
        if low[2] >= high[2]:
            continue
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                row = (i * grid.size[1] + j) * grid.size[2]
                for q in range(grid.first[row + low[2]], grid.first[row + high[2]]):
                    p = grid.items[q]
                    share = _share_under(points[p], point_normals[p], a, b, axis, steps.depths[k], radius)
                    times[p] += share * steps.times[k]
    return times


@njit(cache=True, error_model="numpy", inline="always")
def _share_under(point, normal, a, b, axis, depth, radius):  # type: ignore[no-untyped-def]
    """Share of a step during which a point is under the pad's compressed area."""
    if normal[0] * axis[0] + normal[1] * axis[1] + normal[2] * axis[2] <= 0.0:
        return 0.0
    height = rise = 0.0
    for d in range(3):
        height += (point[d] - a[d]) * axis[d]
        rise += (b[d] - a[d]) * axis[d]
    # In the plane across the axis: |r - t e|^2 < R^2.
    ee = re = rr = 0.0
    for d in range(3):
        r = point[d] - a[d] - height * axis[d]
        e = b[d] - a[d] - rise * axis[d]
        ee += e * e
        re += r * e
        rr += r * r
    first, last = 0.0, 1.0
    under = re * re - ee * (rr - radius * radius)
    if ee <= 1e-24:
        if rr >= radius * radius:
            return 0.0
    else:
        if under <= 0.0:
            return 0.0
        root = np.sqrt(under)
        first, last = max(first, (re - root) / ee), min(last, (re + root) / ee)
    # Above the pressed-in face: height - t rise > -depth.
    room = height + depth
    if abs(rise) <= 1e-15:
        if room <= 0.0:
            return 0.0
    elif rise > 0.0:
        last = min(last, room / rise)
    else:
        first = max(first, room / rise)
    if last <= first:
        return 0.0
    middle = 0.5 * (first + last)
    above = height - middle * rise
    beside = rr - 2.0 * middle * re + middle * middle * ee
    return last - first if above * above + beside < (BALL * radius) ** 2 else 0.0
