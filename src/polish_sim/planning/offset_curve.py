"""Offset curves on the surface that never interfere with the curve they come from (paper 1, section 1.3, fig.
5).

Every point of the new curve is the equal-distance step from the nearest point of the old one. Where to try
comes from the level line of the distance to *all* curves around, so that the far side of a neck is seen too.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import depth_first_order

from polish_sim.arrays import Array, Indices, midpoints, next_corners, norms, running_sums, unit
from polish_sim.geometry import Surface
from polish_sim.planning.curve import Curve, CurveSet, step_on_surface
from polish_sim.planning.ground import Triangulation

# Lines of equal value of a field on a triangulation, as ordered point lists (vertex values -> polylines).

ROUNDING = 1e-6  #: Vertices above the level by no more than this share of the values' range lie on it


class LevelLine(NamedTuple):
    """A piece of a level line, the higher values on its left."""

    #: Points on edges of the triangulation [m], shape (n, 3); a closed line does not repeat its first
    positions: Array
    normals: Array  #: Surface normals, not normalised, shape (n, 3)
    vertices: Indices  #: A vertex with a higher value beside each point, shape (n,)
    closed: bool

    @property
    def curve(self) -> Curve:
        """The line as a curve."""
        return Curve(self.positions, unit(self.normals), self.closed)


def level_lines(
    mesh: Triangulation, values: Array, level: float, among: Indices | None = None
) -> list[LevelLine]:
    """Trace the lines on which a field interpolated over the triangles has the value ``level``.

    Its ``values`` (n,) are given at the vertices, those exactly on the level count as lower; only triangles
    ``among`` (k,) are looked at. Closed lines, and open ones that end at the border.
    """
    triangles = mesh.triangles if among is None else mesh.triangles[among]
    found = values[triangles]
    finite = found[np.isfinite(found)]
    flags = found > level + ROUNDING * (finite.max(initial=level) - finite.min(initial=level))
    crossed = (flags[:, 0] != flags[:, 1]) | (flags[:, 1] != flags[:, 2])
    if not crossed.any():
        return []
    triangles, flags = triangles[crossed], flags[crossed]
    rising = np.argmax(~flags & next_corners(flags), axis=1)
    falling = np.argmax(flags & ~next_corners(flags), axis=1)
    rows = np.arange(len(triangles))
    # Points lie on edges named (lower vertex, higher vertex); entering over the falling edge keeps higher
    # left.
    enter = np.stack([triangles[rows, (falling + 1) % 3], triangles[rows, falling]], axis=1)
    leave = np.stack([triangles[rows, rising], triangles[rows, (rising + 1) % 3]], axis=1)
    count = len(mesh.vertices)
    start, end = (edge[:, 0] * count + edge[:, 1] for edge in (enter, leave))
    keys, index = np.unique(np.concatenate([start, end]), return_inverse=True)
    start, end = np.split(index, 2)
    follows = coo_array((np.ones(len(start)), (start, end)), (len(keys), len(keys))).tocsr()
    heads, chains = np.setdiff1d(start, end), list[Indices]()
    waiting = np.concatenate([heads, start])  # lines that begin somewhere come before those that do not
    while len(waiting):
        chains.append(depth_first_order(follows, waiting[0], return_predecessors=False))
        waiting = waiting[~np.isin(waiting, chains[-1])]
    low, high = keys // count, keys % count
    share = np.clip((level - values[low]) / (values[high] - values[low]), 0.0, 1.0)[:, None]
    positions = mesh.vertices[low] + share * (mesh.vertices[high] - mesh.vertices[low])
    normals = mesh.normals[low] + share * (mesh.normals[high] - mesh.normals[low])
    return [
        LevelLine(positions[c], normals[c], high[c], k >= len(heads))
        for k, c in enumerate(chains)
        if len(c) >= 3
    ]


COARSEST = 1.0 / 8.0  #: Longest control-point spacing as a share of the step-over
FINE_ENOUGH_M, COARSEST_OF_FINE = 5e-4, 1.0 / 4.0
"""Spacing no finer than this is needed but for curvature [m], up to this share of the step-over."""
FINEST = 1.0 / 40.0  #: Shortest control-point spacing as a share of the step-over
CHORD_ERROR = 1.0 / 4000.0  #: Chord error the spacing is adapted to, as a share of the step-over
WHOLE = 1e-6  #: A count this little above a whole number is that number: rounding must not add a point
BACK = 1e-6  #: Feet fall back only by more than this share of the distance; less is rounding
OFF = 0.02  #: Feet further than this share of the step-over from the surface are not on it


def offset_curve(surface: Surface, curves: Sequence[Curve], trial: LevelLine, distance: float) -> Curve:
    """Put a trial line, roughly the offset curve in order, exactly ``distance`` [m] away from the nearest
    curves.

    First with even control points; then with a spacing of equal chord error for the curvature found.
    """
    around, even = CurveSet(curves), trial.curve
    count = max(int(np.ceil(even.length / _coarsest(distance) - WHOLE)), 8)
    even = _on_offset(surface, around, _resample(even, np.full(count, even.length / count)), distance)
    return _on_offset(surface, around, _resample(even, adapted_spacing(even, distance)), distance)


def adapted_spacing(curve: Curve, distance: float) -> Array:
    """Chord lengths of equal chord error, s = sqrt(8 e / curvature), in order, that add up to the curve's
    length [m].

    The step-over ``distance`` [m] sets the scale of e and the limits of s.
    """
    reach = COARSEST * distance
    ahead = curve.tangents(curve.knots + 0.5 * reach, reach)
    behind = curve.tangents(curve.knots - 0.5 * reach, reach)
    curvature = norms(ahead - behind) / reach
    wanted = np.sqrt(8.0 * CHORD_ERROR * distance / np.maximum(curvature, 1e-9))
    wanted = np.clip(wanted, FINEST * distance, _coarsest(distance))
    return np.diff(stations(curve.knots, wanted))


def stations(s: Array, spacing: Array) -> Array:
    """Arc lengths from the first to the last of ``s`` (n,) [m] as far apart as ``spacing`` (n,) [m] says
    there."""
    # Chords per metre, summed along the curve, rise by one from point to point.
    rate = 1.0 / spacing
    progress = running_sums(midpoints(rate) * np.diff(s))
    count = max(int(np.ceil(progress[-1] - WHOLE)), 8)
    return np.interp(np.linspace(0.0, progress[-1], count + 1), progress, s)


def _coarsest(distance: float) -> float:
    """Longest spacing of control points [m]; fine step-overs do with fewer, the path has points so far apart
    anyway."""
    return max(COARSEST * distance, min(FINE_ENOUGH_M, COARSEST_OF_FINE * distance))


def _resample(curve: Curve, chords: Array) -> Curve:
    s = running_sums(chords)
    if curve.closed:
        s = s[:-1]
    positions, normals = curve.at(s)
    return Curve(positions, normals, curve.closed)


def _on_offset(surface: Surface, around: CurveSet, trial: Curve, distance: float) -> Curve:
    """Nearest point of the old curve, then the equal-distance step towards the trial."""
    feet = around.nearest(trial.positions)
    foot = surface.closest(feet.positions)
    # A foot off the surface lies on a line extended beyond the border.
    on = (norms(foot.positions - feet.positions) < OFF * distance)[:, None]
    start = np.where(on, foot.positions, feet.positions)
    normals = np.where(on, foot.normals, feet.normals)
    moved = step_on_surface(surface, start, normals, trial.positions - start, distance)
    # Points whose foot falls back behind that of the point before are dropped (sub-points already passed).
    ahead = np.diff(feet.s)
    back = (ahead < -BACK * distance) & (ahead > -0.5 * distance) & (np.diff(feet.curve) == 0)
    kept = np.append(True, ~back)
    kept |= kept.sum() < 4
    return Curve(moved.positions[kept], moved.normals[kept], trial.closed)
