"""How good a path is, ours or not: spacing, crossings, distance to the surface (positions -> figures)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from polish_sim.planning.curve import Curve, unit

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

SAMPLES = 8
"""Samples per step-over along the path."""
OWN_STRETCH = 2.0
"""Points closer than this many step-overs along the path belong to the same turn."""
FURTHEST = 2.0
"""A neighbour further away than this many step-overs is no neighbour; coverage tells of such gaps."""
SHARP = np.radians(60.0)
"""Change of direction of a corner of 120 deg [rad]."""


class Stepover(NamedTuple):
    """Distances to the adjacent turns."""

    mean_m: float
    p5_m: float
    p95_m: float
    excluded: float
    """Share of the path left out: corners sharper than 120 deg and the last half turn of each run."""


def measure_stepover(runs: Sequence[Curve], stepover: float) -> Stepover:
    """Distances from points of the path to the adjacent turn on either side.

    Args:
        runs: Each run in contact, an open curve.
        stepover: What was planned, or expected [m].

    Returns:
        Mean and percentiles, nan where there are no neighbours.
    """
    path = _sample(runs, stepover)
    left, right = (_beside(path, sign, stepover) for sign in (1.0, -1.0))
    out = path.corner | _last_half_turns(path, left, right)
    distances = [_refine(runs, path, side, ~out & (side >= 0) & ~out[side]) for side in (left, right)]
    kept = np.concatenate(distances)
    if len(kept) == 0:
        return Stepover(np.nan, np.nan, np.nan, float(out.mean()))
    p5, p95 = np.percentile(kept, [5.0, 95.0])
    return Stepover(float(kept.mean()), float(p5), float(p95), float(out.mean()))


class _Samples(NamedTuple):
    """Evenly spaced points of all runs."""

    run: Ints
    s: Array
    points: Array
    sides: Array
    corner: Mask


def _sample(runs: Sequence[Curve], stepover: float) -> _Samples:
    parts = []
    for number, curve in enumerate(runs):
        s = np.linspace(0.0, curve.length, max(int(np.ceil(curve.length * SAMPLES / stepover)), 2) + 1)
        points, normals = curve.at(s)
        sides = np.cross(normals, unit(np.gradient(points, axis=0)))
        parts.append(_Samples(np.full(len(s), number), s, points, sides, _corners(points)))
    return _Samples(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _corners(points: Array) -> Mask:
    """Points within half a step-over of a place where the path turns by more than 60 deg within one."""
    half = SAMPLES // 2
    index = np.arange(len(points))
    before = points - points[np.maximum(index - half, 0)]
    after = points[np.minimum(index + half, len(index) - 1)] - points
    sharp = (unit(before) * unit(after)).sum(axis=1) < np.cos(SHARP)
    sharp[:half] = sharp[-half:] = False
    return binary_dilation(sharp, iterations=half)


def _beside(path: _Samples, sign: float, stepover: float) -> Ints:
    """The nearest sample of another turn on one side of each sample, -1 where there is none."""
    tree = cKDTree(path.points)
    found = np.full(len(path.points), -1, dtype=np.int64)
    waiting = np.arange(len(path.points))
    for count in (40, 240):
        count = min(count, len(path.points))
        for rows in np.array_split(waiting, len(waiting) // 5000 + 1):
            distance, index = tree.query(path.points[rows], k=count, distance_upper_bound=FURTHEST * stepover)
            index = np.where(np.isfinite(distance), index, rows[:, None])
            towards = ((path.points[index] - path.points[rows, None]) * path.sides[rows, None]).sum(axis=2)
            apart = np.abs(path.s[index] - path.s[rows, None]) > OWN_STRETCH * stepover
            apart |= path.run[index] != path.run[rows, None]
            other = apart & (sign * towards > 0.25 * np.where(np.isfinite(distance), distance, 0.0))
            found[rows] = np.where(other.any(axis=1), index[np.arange(len(rows)), other.argmax(axis=1)], -1)
        waiting = waiting[found[waiting] < 0]
    return found


def _last_half_turns(path: _Samples, left: Ints, right: Ints) -> Mask:
    """The second half of the way since a run last passed beside its own end."""
    out = np.zeros(len(path.s), dtype=bool)
    for end in np.flatnonzero(np.append(np.diff(path.run) != 0, True)):
        beside = [j for j in (left[end], right[end]) if j >= 0 and path.run[j] == path.run[end]]
        turn = max((path.s[end] - path.s[j] for j in beside), default=0.0)
        out |= (path.run == path.run[end]) & (path.s > path.s[end] - 0.5 * turn)
    return out


def _refine(runs: Sequence[Curve], path: _Samples, side: Ints, wanted: Mask) -> Array:
    """Distances to the neighbouring turn itself instead of its nearest sample."""
    distances = [np.empty(0)]
    for number, curve in enumerate(runs):
        rows = np.flatnonzero(wanted & (path.run[side] == number))
        spacing = curve.length / max(int((path.run == number).sum()) - 1, 1)
        best = np.full(len(rows), np.inf)
        for shift in np.linspace(-1.0, 1.0, 17):
            trial = curve.at(path.s[side[rows]] + shift * spacing)[0]
            best = np.minimum(best, np.linalg.norm(trial - path.points[rows], axis=1))
        distances.append(best)
    return np.concatenate(distances)


def count_self_crossings(runs: Sequence[Curve]) -> int:
    """Count pairs of segments in contact that cross, seen along the surface normal.

    Args:
        runs: Each run in contact, an open curve.

    Returns:
        Number of crossings on the same side of the part, within runs and between them.
    """
    start, end = (np.concatenate([curve.positions[cut] for curve in runs]) for cut in (np.s_[:-1], np.s_[1:]))
    normals = np.concatenate([curve.normals[:-1] for curve in runs])
    # Numbers that follow each other only where segments share a point.
    number = np.arange(len(start)) + np.repeat(np.arange(len(runs)), [len(curve.positions) - 1 for curve in runs])
    reach = float(np.linalg.norm(end - start, axis=1).max())
    pairs = cKDTree(0.5 * (start + end)).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.abs(number[pairs[:, 0]] - number[pairs[:, 1]]) > 1]
    i, j = pairs[:, 0], pairs[:, 1]
    same_side = (normals[i] * normals[j]).sum(axis=1) > 0.0
    i, j = i[same_side], j[same_side]
    normal = unit(normals[i] + normals[j])

    def turn(a: Array, b: Array, c: Array) -> Array:
        return np.asarray((np.cross(b - a, c - a) * normal).sum(axis=1))

    across = turn(start[i], end[i], start[j]) * turn(start[i], end[i], end[j]) < 0.0
    back = turn(start[j], end[j], start[i]) * turn(start[j], end[j], end[i]) < 0.0
    return int((across & back).sum())
