"""A path once around a rim: midway between the two borders of a ring, as a closed quintic curve."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from polish_sim.arrays import Array
from polish_sim.errors import PlanError, SmoothingError
from polish_sim.geometry import Region, Surface
from polish_sim.planning.toolpath import APPROACH, PROCESS, RETRACT, ToolPath, arc_length, interpolate
from polish_sim.spatial import unit

DEGREE = 5  #: Of the curve, which has four continuous derivatives everywhere


def fit_closed_spline(points: Array) -> BSpline:
    """The curve, C4 everywhere, through points (n, 3) [m] in order and back to the first one, which is not
    repeated; its parameter grows by chord length, see `length_of`.

    Raises SmoothingError for two neighbours in one place.
    """
    round_trip = np.concatenate([points, points[:1]])
    chords = np.linalg.norm(np.diff(round_trip, axis=0), axis=1)
    if chords.min() <= 1e-9:
        k = int(np.argmin(chords))
        raise SmoothingError(
            f"points {k + 1} and {(k + 1) % len(points) + 1} are in one place: leave one out."
        )
    u = np.concatenate([[0.0], np.cumsum(chords)])
    return make_interp_spline(u, round_trip, k=DEGREE, bc_type="periodic")


def length_of(curve: BSpline) -> float:
    """Sum of the chords of a closed curve [m]: its parameter once round."""
    return float(curve.t[-1 - DEGREE])


SPACING = 0.001  # of the path's points [m]
POINTS = (12, 24, 48, 96)  # the curve goes through as few points as will do
OFF_SURFACE = 2e-5  # the curve may leave the surface by this [m]
_DENSE = 5e-4  # between points the borders are compared at [m]


def rim_path(surface: Surface, region: Region, clearance: float) -> ToolPath:
    """Plan a path down to the rim, once around a ring-shaped region and up, from ``clearance`` [m] above the
    part.

    Raises PlanError if the region is no ring, or too uneven for a smooth curve on it.
    """
    loops = region.boundary_loops
    if len(region.components()) != 1 or len(loops) != 2:
        raise PlanError(
            "a path around a rim needs a region in one piece with an outer and an inner border; this one has "
            f"{len(region.components())} piece(s) and {len(loops)} border(s). Choose a ring with --region, "
            "or give a path with --path."
        )
    outer, inner = (_resampled(loop, max(8, round(arc_length(loop)[-1] / _DENSE))) for loop in loops)
    curve = _curve_between(surface, outer, inner)
    length = length_of(curve)
    u = np.linspace(0.0, length, max(24, round(length / SPACING)) + 1)
    positions = curve(u)
    there = surface.closest(positions)
    bend = surface.normal_curvature(there.facets, there.barycentric, unit(curve(u, 1)))
    return _with_way_down(positions, there.normals, bend, clearance)


def _curve_between(surface: Surface, outer: Array, inner: Array) -> BSpline:
    """The closed curve through points of the surface midway between two borders, (p, 3) and (q, 3)."""
    gap = np.inf
    for count in POINTS:
        out = outer[np.linspace(0, len(outer), count, endpoint=False).astype(int)]
        nearest = inner[np.argmin(np.linalg.norm(out[:, None] - inner[None], axis=2), axis=1)]
        curve = fit_closed_spline(surface.closest(0.5 * (out + nearest)).positions)
        points = curve(np.linspace(0.0, length_of(curve), 8 * count))
        gap = np.linalg.norm(points - surface.closest(points).positions, axis=1).max()
        if gap <= OFF_SURFACE:
            return curve
    raise PlanError(
        f"a curve through {POINTS[-1]} points of this rim is still {1e3 * gap:.2f} mm off its surface: the "
        "rim is too uneven. Choose a smoother one with --region, or give a path with --path."
    )


def _resampled(loop: Array, count: int) -> Array:
    """Points at equal steps along a closed polyline, its end left out, shape (count, 3)."""
    s = arc_length(loop)
    return interpolate(np.linspace(0.0, s[-1], count, endpoint=False), s, loop)


def _with_way_down(positions: Array, axes: Array, bend: Array, clearance: float) -> ToolPath:
    points = np.concatenate(
        [positions[:1] + clearance * axes[:1], positions, positions[-1:] + clearance * axes[-1:]]
    )  # fmt: skip
    segment = np.full(len(points), PROCESS, np.int8)
    segment[0] = APPROACH
    segment[-1] = RETRACT
    framed = np.concatenate([axes[:1], axes, axes[-1:]])
    return ToolPath(
        points,
        framed,
        arc_length(points),
        np.zeros(len(points), np.int64),
        segment,
        np.pad(bend, 1, mode="edge"),
    )
