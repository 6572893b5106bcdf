"""A run with its tool axes: what the tool does in contact from one lift to the next (SurfaceRun ->
ContactRun)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from polish_sim.arrays import Array, dots, norms
from polish_sim.config import PlanConfig
from polish_sim.planning.moves.leads import Move
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.quality.leaning import Leaning
from polish_sim.planning.toolpath import PROCESS, arc_length, interpolate
from polish_sim.spatial import into_plane, unit

# The tool axis at every point: the normal, turned gradually over creases, leaned by lead and tilt, smoothed.

CREASE = np.radians(4.0)  #: Between neighbouring points a smooth part never turns by as much [rad]
SAMPLES = 32  #: Samples on the way over which a crease is rounded
STEEPEST = np.radians(75.0)  #: Smoothing never turns the axis further from the surface normal than this [rad]
PER_WINDOW = 64  #: Samples on the length over which axes are averaged


def lean(normals: Array, tangents: Array, lead: float, tilt: float) -> Array:
    """Turn unit normals (n, 3) by an angle ``lead`` [rad] towards the feed and ``tilt`` [rad] to its left:
    tool axes.

    A positive lead tips the tool's body forward, the way it is fed, so that the pad's heel presses more; a
    positive tilt tips it to the left of the feed seen from outside. Each angle is seen square to the other
    one's plane: the axis is n + tan(lead) t + tan(tilt) (n x t), t the feed directions (n, 3).
    """
    along = unit(into_plane(tangents, normals))
    across = np.cross(normals, along)
    return unit(normals + np.tan(lead) * along + np.tan(tilt) * across)


def soften_creases(normals: Array, s: Array, reach: float) -> Array:
    """Let the axis turn over a crease on a stretch instead of at a point; elsewhere it stays the normal (n,
    3).

    Along arc lengths ``s`` (n,) [m] the turn begins and ends ``reach`` [m] from the crease.
    """
    turn = norms(np.diff(normals, axis=0))
    jumps = 0.5 * (s[1:] + s[:-1])[turn > CREASE]
    if len(jumps) == 0:
        return normals
    even = np.linspace(s[0], s[-1], max(int((s[-1] - s[0]) * SAMPLES / reach), 2) + 1)
    softened = _averaged(normals, s, even, 2 * SAMPLES + 1)
    index = np.clip(np.searchsorted(jumps, s), 1, max(len(jumps) - 1, 1))
    away = np.minimum(np.abs(s - jumps[index - 1]), np.abs(s - jumps[np.minimum(index, len(jumps) - 1)]))
    far = np.clip(away / reach - 1.0, 0.0, 1.0)[:, None]
    share = far**2 * (3.0 - 2.0 * far)
    return unit(share * normals + (1.0 - share) * softened)


def smooth_axes(axes: Array, normals: Array, s: Array, length: float, bound: float) -> Array:
    """Average unit tool axes (n, 3) along one run over a length [m] of the path; 0 leaves them as they are.

    No axis is turned by more than ``bound`` [rad], less where it would otherwise lean further than `STEEPEST`
    from the surface's normal, so that smoothing turns no tool into the part. ``s`` (n,) [m] are the arc
    lengths.
    """
    if length <= 0.0 or bound <= 0.0:
        return axes
    count = max(int(np.ceil((s[-1] - s[0]) * PER_WINDOW / length)), 8)
    even = np.linspace(s[0], s[-1], count + 1)
    wanted = unit(_averaged(axes, s, even, max(round(length / (even[1] - even[0])), 1) | 1))
    allowed = np.clip(STEEPEST - angles_between(axes, normals), 0.0, bound)
    angle = angles_between(axes, wanted)
    # Turn towards the mean by the angle allowed, in the plane of both.
    square = unit(into_plane(wanted, axes))
    turn = np.minimum(angle, allowed)[:, None]
    return unit(np.cos(turn) * axes + np.sin(turn) * square)


def _averaged(vectors: Array, s: Array, even: Array, window: int) -> Array:
    """Means of vectors (n, 3) given at ``s`` (n,) over ``even`` evenly spaced places, at ``s`` again."""
    return interpolate(
        s, even, uniform_filter1d(interpolate(even, s, vectors), window, axis=0, mode="nearest")
    )


def angles_between(first: Array, second: Array) -> Array:
    """Angles between unit vectors, exact for small ones too, (n, 3) each -> (n,) [rad]."""
    across = norms(np.cross(first, second))
    return np.arctan2(across, dots(first, second))


CREASE_REACH = 0.5  #: The tool axis turns over a crease within this many step-overs on either side


class ContactRun(NamedTuple):
    """A run in contact."""

    process: Move
    curvature: Array  #: Normal curvature of the surface along it [1/m], shape (n,)
    axis_deviation_rad: float  #: Largest angle by which smoothing turned an axis [rad]

    def rows(self, first: int, last: int) -> ContactRun:
        """The stroke from one of its points to another, both included."""
        kept = slice(first, last + 1)
        return self._replace(process=self.process.rows(kept), curvature=self.curvature[kept])


def give_axes(
    run: SurfaceRun, plan: PlanConfig, first_pass: int, leaning: Leaning | None = None
) -> ContactRun:
    """Set the tool on a run: along the normal, softened over creases, leaned by lead and tilt, smoothed.

    The run is in the direction it is walked; ``first_pass`` numbers the first of its passes. ``leaning``
    turns the tool away from what stands beside it besides.
    """
    s = arc_length(run.positions)
    tangents = unit(np.gradient(run.positions, axis=0))
    normals = soften_creases(run.points.normals, s, CREASE_REACH * plan.stepover_m)
    leaned = lean(normals, tangents, plan.lead_angle_rad, plan.tilt_angle_rad)
    if leaning is not None:
        leaned = leaning.lean(run.positions, leaned)
    axes = smooth_axes(leaned, run.points.normals, s, plan.axis_smoothing_m, plan.axis_deviation_rad)
    passes = run.pass_index - int(run.pass_index.min()) + first_pass
    return ContactRun(
        Move(run.positions, axes, PROCESS, passes),
        run.surface.normal_curvature(run.points.facets, run.points.barycentric, tangents),
        float(angles_between(leaned, axes).max()) if axes is not leaned else 0.0,
    )
