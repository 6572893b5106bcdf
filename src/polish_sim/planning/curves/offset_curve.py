"""Offset curves on the surface that never interfere with the curve they come from (paper 1, section 1.3, fig. 5).

Every point of the new curve is the equal-distance step from the nearest point of the old one. Where to try comes
from the level line of the distance to *all* curves around, so that the far side of a neck is seen too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curves.curve import Curve, Nearest
from polish_sim.planning.curves.level_set import LevelLine
from polish_sim.planning.curves.stepping import SurfaceQuery, step_on_surface
from polish_sim.spatial import unit

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

COARSEST = 1.0 / 8.0
"""Longest control-point spacing as a share of the step-over."""
FINE_ENOUGH_M, COARSEST_OF_FINE = 5e-4, 1.0 / 4.0
"""Spacing no finer than this is needed but for curvature [m], up to this share of the step-over."""
FINEST = 1.0 / 40.0
"""Shortest control-point spacing as a share of the step-over."""
CHORD_ERROR = 1.0 / 4000.0
"""Chord error the spacing is adapted to, as a share of the step-over."""

WHOLE = 1e-6
"""A count this little above a whole number is that number: rounding must not add a point."""
BACK = 1e-6
"""Feet fall back only by more than this share of the distance; less is rounding."""
ROUGHLY = 0.1
"""Lower bounds of distances may be too low by this share."""
OFF = 0.02
"""Feet further than this share of the step-over from the surface are not on it."""


class Feet(NamedTuple):
    """Nearest points on the closest of several curves."""

    curve: Ints
    """Which curve, shape (n,)."""
    nearest: Nearest


@dataclass(frozen=True, eq=False)
class CurveSet:
    """Several curves, asked which of them is nearest."""

    curves: tuple[Curve, ...]

    @cached_property
    def _starts(self) -> Ints:
        return np.cumsum([0] + [len(curve.positions) for curve in self.curves])

    @cached_property
    def _tree(self) -> cKDTree:
        if len(self.curves) == 1:
            return self.curves[0].tree
        return cKDTree(np.concatenate([curve.positions for curve in self.curves]))

    @cached_property
    def _longest_chord(self) -> float:
        return max(float(np.diff(curve.knots).max()) for curve in self.curves)

    def at_least(self, points: Array) -> Array:
        """A cheap lower bound of the distances of points (n, 3) to the curves [m], shape (n,)."""
        to_points, _ = self._tree.query(points, eps=ROUGHLY)
        return np.asarray(to_points / (1.0 + ROUGHLY) - 0.5 * self._longest_chord)

    def nearest(self, points: Array, limit: float = np.inf) -> Feet:
        """Nearest points of the closest curve; distances beyond the limit [m] are inf."""
        distances, found = self._tree.query(points, distance_upper_bound=limit)
        which = np.searchsorted(self._starts, found, side="right") - 1
        s, foot, normal = np.zeros(len(points)), np.zeros((len(points), 3)), np.zeros((len(points), 3))
        for number, curve in enumerate(self.curves):
            rows = np.flatnonzero(which == number)
            near = curve.near_point(points[rows], found[rows] - self._starts[number])
            s[rows], foot[rows], normal[rows], distances[rows] = near
        return Feet(which, Nearest(s, foot, normal, distances))


def nearest_of(curves: Sequence[Curve], points: Array, limit: float = np.inf) -> Feet:
    """Nearest points of the closest of several curves; distances beyond the limit [m] are inf."""
    return CurveSet(tuple(curves)).nearest(points, limit)


def offset_curve(surface: SurfaceQuery, curves: Sequence[Curve], trial: LevelLine, distance: float) -> Curve:
    """Put a trial line exactly one offset away from the curves it lies beside.

    First with even control points; then with a spacing of equal chord error for the curvature found.

    Args:
        surface: Where to stay.
        curves: The curves to offset; each trial point belongs to the nearest.
        trial: Roughly the offset curve, in order.
        distance: Offset l [m].

    Returns:
        The offset curve.
    """
    around = CurveSet(tuple(curves))
    even = Curve(trial.positions, unit(trial.normals), trial.closed)
    count = max(int(np.ceil(even.length / _coarsest(distance) - WHOLE)), 8)
    even = _on_offset(surface, around, _resample(even, np.full(count, even.length / count)), distance)
    return _on_offset(surface, around, _resample(even, adapted_spacing(even, distance)), distance)


def adapted_spacing(curve: Curve, distance: float) -> Array:
    """Chord lengths of equal chord error, s = sqrt(8 e / curvature), that add up to the curve's length.

    Args:
        curve: A curve with evenly spaced points.
        distance: Step-over, which sets the scale of e and the limits of s [m].

    Returns:
        Chord lengths in order [m].
    """
    reach = COARSEST * distance
    ahead, behind = curve.tangents(curve.knots + 0.5 * reach, reach), curve.tangents(curve.knots - 0.5 * reach, reach)
    curvature = np.linalg.norm(ahead - behind, axis=1) / reach
    wanted = np.sqrt(8.0 * CHORD_ERROR * distance / np.maximum(curvature, 1e-9))
    wanted = np.clip(wanted, FINEST * distance, _coarsest(distance))
    # Chords per metre, summed along the curve, rise by one from point to point.
    rate = 1.0 / wanted
    progress = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(curve.knots))])
    count = max(int(np.ceil(progress[-1] - WHOLE)), 8)
    stations = np.interp(np.linspace(0.0, progress[-1], count + 1), progress, curve.knots)
    return np.diff(stations)


def _coarsest(distance: float) -> float:
    """Longest spacing of control points [m]; fine step-overs do with fewer, the path has points so far apart anyway."""
    return max(COARSEST * distance, min(FINE_ENOUGH_M, COARSEST_OF_FINE * distance))


def _resample(curve: Curve, chords: Array) -> Curve:
    s = np.concatenate([[0.0], np.cumsum(chords)])
    if curve.closed:
        s = s[:-1]
    positions, normals = curve.at(s)
    return Curve(positions, normals, curve.closed)


def _on_offset(surface: SurfaceQuery, around: CurveSet, trial: Curve, distance: float) -> Curve:
    """Nearest point of the old curve, then the equal-distance step towards the trial."""
    feet = around.nearest(trial.positions)
    foot = surface.closest(feet.nearest.positions)
    # A foot off the surface lies on a line thought to go on beyond the border.
    on = (np.linalg.norm(foot.positions - feet.nearest.positions, axis=1) < OFF * distance)[:, None]
    start = np.where(on, foot.positions, feet.nearest.positions)
    normals = np.where(on, foot.normals, feet.nearest.normals)
    moved = step_on_surface(surface, start, normals, trial.positions - start, distance)
    kept = _forward_only(feet, distance)
    return Curve(moved.positions[kept], moved.normals[kept], trial.closed)


def _forward_only(feet: Feet, distance: float) -> NDArray[np.bool_]:
    """Drop points whose foot falls back behind the foot of the point before (sub-points already passed)."""
    ahead = np.diff(feet.nearest.s)
    back = (ahead < -BACK * distance) & (ahead > -0.5 * distance) & (np.diff(feet.curve) == 0)
    kept = np.concatenate([[True], ~back])
    return kept if kept.sum() >= 4 else np.ones(len(kept), dtype=bool)
