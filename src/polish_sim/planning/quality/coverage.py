"""Which places of the region the path passes within 0.55 step-overs: the strict coverage (path -> mask,
shares)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    by_slices,
    chord_lengths,
    directions_at,
    dots,
    norms,
    running_sums,
    some_rows,
    unit,
)
from polish_sim.config import PadConfig
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, minus, scaled
from polish_sim.planning.curve import Curve, CurveSet
from polish_sim.planning.ground import Ground, Triangulation
from polish_sim.planning.points import build_point_grid, cells_between, thin
from polish_sim.planning.quality.located import PathOnSurface, Strands
from polish_sim.planning.toolpath import rows_apart

STRICT = 0.55  #: A place counts as covered if the path passes within this many step-overs
CHORD = 0.15  #: Length of the chords the path is measured by, in step-overs


#: Points on which the share of area is counted, one in each equal share of the region's area
SAMPLES = 100_000


def strictly_covered(points: Array, normals: Array, runs: Sequence[Curve], stepover: float) -> Bools:
    """Which points (k, 3) [m] are within 0.55 step-overs of a path's runs in contact, on its side of the
    part."""
    path, limit = Strands(runs).sample(CHORD * stepover), STRICT * stepover
    parts = (slice(*ends) for ends in pairwise(path.first))
    fine = [Curve(path.points[part], path.normals[part], False) for part in parts]
    feet = CurveSet(fine).nearest(points, np.hypot(limit, 0.5 * CHORD * stepover))
    return (feet.distances <= limit) & (dots(feet.normals, normals) > 0.0)


def distances_to_path(mesh: Triangulation, runs: Sequence[Curve], stepover: float) -> Array:
    """Distances of vertices from what of a path's runs in contact lies on their side of the part [m],
    (v,)."""
    path = Strands(runs).sample(CHORD * stepover)
    # With the normals as further coordinates a path on the other side, or round an edge, is far.
    tree = cKDTree(np.hstack([path.points, stepover * path.normals]))
    nearest = tree.query(np.hstack([mesh.vertices, stepover * mesh.normals]))[1]
    return norms(mesh.vertices - path.points[nearest])


def strict_share(mesh: Triangulation, areas: Array, runs: Sequence[Curve], stepover: float) -> float:
    """Share of the area of triangles (t,) [m^2], 0 to 1, within 0.55 step-overs [m] of the path's runs.

    Counted on points spread within every triangle: the vertices alone stand in rows, as paths do.
    """
    ends = np.cumsum(areas)
    # One point at random in each equal share of the area: regular steps would fall into step with the rows
    # of a regular mesh. Always the same points.
    drawn = np.random.default_rng(0).random((3, SAMPLES))
    marks = (np.arange(SAMPLES) + drawn[0]) / SAMPLES * ends[-1]
    corners = mesh.triangles[np.minimum(np.searchsorted(ends, marks), np.flatnonzero(areas)[-1])].T
    first, second = np.where(drawn[1] + drawn[2] > 1.0, 1.0 - drawn[1:], drawn[1:])
    weights = np.stack([first, second, 1.0 - first - second])[:, :, None]
    points, normals = (sum(weights * values[corners]) for values in (mesh.vertices, mesh.normals))
    return strictly_covered(points, normals, runs, stepover).mean()


# How deep the pad sinks in at a force: an elastic foundation on a curved place (curvature, tilt -> depth).

SPRINGS = 400


def pad_depths(curvatures: Array, pad: PadConfig, force: float | Array, tilts: Array) -> Array:
    """Depth (n,) [m] of the pad's middle at which the elastic foundation carries a force; below zero it stays
    off.

    The disc of radius R is a bed of springs, K / (pi R^2) per area; over a place of principal curvatures k1,
    k2 (n, 2) [1/m], positive convex, the compression is delta - (k1 x^2 + k2 y^2) / 2 + a x + b y where that
    is positive, a and b the tool axis' slopes along both directions, ``tilts`` (n, 2).
    """
    springs, mean_depths = _disc_points(pad.radius_m).T, np.full(len(curvatures), force / pad.stiffness_n_m)
    return by_slices(partial(_solve, springs), curvatures, tilts, mean_depths)  # type: ignore[no-any-return]


def _solve(springs: Array, curvatures: Array, tilts: Array, mean_depths: Array) -> Array:
    """The depths: with the k springs nearest to the pad pressed, sum(delta - fall) = q F / K of all q; more
    or fewer than carry it give a larger delta."""
    falls = np.sort(0.5 * curvatures @ springs**2 - tilts @ springs, axis=1)
    pressed = np.arange(1, SPRINGS + 1)
    deep = (np.cumsum(falls, axis=1) + SPRINGS * mean_depths[:, None]) / pressed
    return np.asarray(deep.min(axis=1))


def _disc_points(radius: float) -> Array:
    """Points of equal area on a disc (sunflower) [m], shape (q, 2)."""
    k = np.arange(SPRINGS)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    return radius * np.sqrt((k[:, None] + 0.5) / SPRINGS) * directions_at(angle)


# How long each place of a region is under the pad: its compressed disc carried along the path (path ->
# seconds).
#
# The disc moves in straight steps. Over each, the time a place lies within the disc's edge (a quadratic) and
# above its pressed-in face (a line) is an interval known in closed form, so the times are exact for straight
# paths.

STEP = 0.1  #: Length of the pad's steps in pad radii
CORNER = np.radians(10.0)  #: Waypoints at which the path turns by more end a step [rad]
BALL = 1.05  #: Places further than this many pad radii from the pad's middle are not under it, however tall


class PadSteps(NamedTuple):
    """Straight steps of the pad."""

    start: Array  #: Middle of the pad on the surface, before [m], shape (n, 3)
    end: Array  #: And after, shape (n, 3)
    axes: Array  #: Unit tool axes, shape (n, 3)
    depths: Array  #: How deep the pad's face is pressed in at its middle [m], shape (n,)
    times: Array  #: How long each step takes [s], shape (n,)


def pad_steps(on: PathOnSurface, pad: PadConfig) -> PadSteps:
    """Cut the path in contact into steps of about a tenth of the pad's radius."""
    length = chord_lengths(on.positions)
    slowness = 0.5 * (1.0 / on.feeds[1:] + 1.0 / on.feeds[:-1])
    s, t = (running_sums(way) for way in (length, length * slowness))
    rows = checked_rows(on, s, STEP * pad.radius_m)
    under = some_rows(on.under, rows)
    depths = pad_depths(under.curvatures, pad, on.forces[rows], under.slopes(on.axes[rows]))
    joined = on.stretch_of[rows[1:]] == on.stretch_of[rows[:-1]]
    a, b = rows[:-1][joined], rows[1:][joined]
    mean = 0.5 * (depths[:-1] + depths[1:])[joined]
    return PadSteps(on.positions[a], on.positions[b], unit(on.axes[a] + on.axes[b]), mean, t[b] - t[a])


def checked_rows(on: PathOnSurface, s: Array, spacing: float) -> Indices:
    """Rows about a spacing apart; both ends of every stretch and its corners among them."""
    way = unit(np.diff(on.positions, axis=0))
    corner = np.zeros(len(s), dtype=bool)
    corner[1:-1] = dots(way[1:], way[:-1]) < np.cos(CORNER)
    rows = []
    for stretch in on.stretches:
        rows.append(stretch[np.union1d(rows_apart(s[stretch], spacing), np.flatnonzero(corner[stretch]))])
    return np.concatenate(rows)


def time_under_pad(points: Array, point_normals: Array, steps: PadSteps, radius: float) -> Array:
    """Time each point (k, 3) [m] lies under the pad's compressed area [s], (k,); exactly zero where the pad
    never is.

    ``point_normals`` (k, 3) are the unit surface normals there.
    """
    grid = build_point_grid(points, 0.35 * radius)
    return _sum_up(points, point_normals, steps, radius, grid)


@njit
def _sum_up(points, point_normals, steps, radius, grid):  # type: ignore[no-untyped-def]
    times = np.zeros(len(points))
    reach = BALL * radius
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for k in range(len(steps.start)):
        a, b, axis = steps.start[k], steps.end[k], steps.axes[k]
        for d in range(3):
            low[d], high[d] = cells_between(grid, d, min(a[d], b[d]) - reach, max(a[d], b[d]) + reach)
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


@njit(inline="always")
def _share_under(point, normal, a, b, axis, depth, radius):  # type: ignore[no-untyped-def]
    """Share of a step during which a point is under the pad's compressed area."""
    if dot(normal, axis) <= 0.0:
        return 0.0
    offset, step = minus(point, a), minus(b, a)
    height, rise = dot(offset, axis), dot(step, axis)
    # In the plane across the axis: |r - t e|^2 < R^2.
    r, e = minus(offset, scaled(height, axis)), minus(step, scaled(rise, axis))
    ee, re, rr = dot(e, e), dot(r, e), dot(r, r)
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


# The time under the pad over a whole region, with its variation (Ground, path -> ExposureMap).

#: Places at which the time is summed up lie this many pad radii apart, or as far as the vertices do
TIMED_APART = 0.04
OVER, UNDER = 2.0, 0.5  #: Over- and under-polished: longer (shorter) under the pad than this many medians


class ExposureMap(NamedTuple):
    """Time under the pad, and its distribution over the region's area without holes."""

    times: Array  #: At every vertex of the region [s], shape (v,)
    #: For metrics.json: the median is of the vertices that come under the pad, cv the standard deviation over
    #: the mean; over-polished are more than two medians, under-polished less than half of one, bare ones too
    figures: dict[str, float]


def expose(ground: Ground, on: PathOnSurface, pad: PadConfig, counted: Array | float = 1.0) -> ExposureMap:
    """Carry the pad along a path: the times and their figures.

    ``counted`` (v,) is the share of each ground vertex's area that counts, or that of all.
    """
    mesh = ground.mesh
    some = thin(mesh.vertices, TIMED_APART * pad.radius_m)
    points, normals = mesh.vertices[some.kept], mesh.normals[some.kept]
    times = time_under_pad(points, normals, pad_steps(on, pad), pad.radius_m)
    own = ground.part_areas * counted
    areas: Array = np.bincount(some.stands_for, weights=own, minlength=len(points)).astype(np.float64)
    total = areas.sum()
    mean = (areas * times).sum() / total
    spread = np.sqrt((areas * (times - mean) ** 2).sum() / total)
    under = (times > 0.0) & (areas > 0.0)
    # The time below which half of the area under the pad lies.
    median = (
        np.quantile(times[under], 0.5, weights=areas[under], method="inverted_cdf") if under.any() else 0.0
    )
    figures = {
        "exposure_mean_s": mean,
        "exposure_median_s": median,
        "exposure_max_s": times.max(),
        "exposure_cv": spread / mean if mean > 0.0 else float("nan"),
        "over_polished_area_m2": areas[times > OVER * median].sum(),
        "under_polished_area_m2": areas[times < UNDER * median].sum(),
    }
    return ExposureMap(times[some.stands_for], figures)
