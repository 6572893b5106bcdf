"""What a pattern yields: lines the tool follows in contact, one lift after each (pattern -> tool path)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Indices, norms, some_rows
from polish_sim.config import PlanConfig
from polish_sim.geometry import ClosestPoints, Region, Surface
from polish_sim.planning.curve import Curve
from polish_sim.planning.ground import Triangulation
from polish_sim.planning.offset_curve import stations
from polish_sim.planning.toolpath import arc_length, interpolate
from polish_sim.planning.turns import Report

ROUNDING = 0.5  #: A corner is rounded over this much on either side, as a share of the step-over
SHARPENING = 2.0  #: How often what rounding takes off a corner is put on before; so turns cut off less of it
FINE = 1.0 / 40.0  #: Spacing of the points that are smoothed, as a share of the step-over
WHOLE = 1e-6  #: Numbers of intervals this little above a whole one count as that one: rounding
CHORD_ERROR_M = 5e-7
#: Equal chord error within these limits of the finished path's spacing [m]
CLOSEST_M, FURTHEST_M = 2.5e-4, 1e-3


class Run(NamedTuple):
    """A line on or very near the surface, followed without a lift."""

    positions: Array  #: Points [m], shape (n, 3)
    pass_index: Indices  #: Turn or line each belongs to, shape (n,)


@dataclass(frozen=True, eq=False)
class SurfaceRun:
    """A run finished: smooth, dense, its points on the surface."""

    surface: Surface  #: The surface its points belong to
    points: ClosestPoints
    pass_index: Indices

    @property
    def positions(self) -> Array:
        """Points on the surface [m], shape (n, 3)."""
        return self.points.positions

    @cached_property
    def curve(self) -> Curve:
        """The line as an open curve."""
        return Curve(self.positions, self.points.normals, False)

    def backwards(self) -> SurfaceRun:
        """The same line followed the other way; turns are numbered anew from its new beginning."""
        points = some_rows(self.points, np.s_[::-1])
        return replace(self, points=points, pass_index=self.pass_index.max() - self.pass_index[::-1])


def numbered(parts: Sequence[Array]) -> Run:
    """A run of parts (n, 3) [m] one after the other, each a pass of its own."""
    return Run(np.concatenate(parts), np.repeat(np.arange(len(parts)), [len(part) for part in parts]))


def dense(positions: Array, spacing: float, least: int = 0) -> Array:
    """Points of a polyline no further apart than a spacing [m], its corners cut by at most half of it, (n,
    3).

    They are the ends of that many chords or more.
    """
    s = arc_length(positions)
    count = max(int(np.ceil(s[-1] / spacing - WHOLE)), least)
    return interpolate(np.linspace(0.0, s[-1], count + 1), s, positions)


def finish_run(surface: Surface, run: Run, stepover: float) -> SurfaceRun:
    """Round the corners over half a step-over [m], space the points for equal chord error, put them on the
    surface."""
    from scipy.interpolate import CubicSpline  # slow to import

    knots = arc_length(run.positions)
    distinct = np.concatenate([[True], np.diff(knots) > 1e-9])
    knots, positions, passes = knots[distinct], run.positions[distinct], run.pass_index[distinct]
    # Evenly spaced points along the line, its corners rounded.
    even = dense(positions, FINE * stepover, least=8)
    window = min(round(ROUNDING / FINE), (len(even) - 1) // 3)
    smooth = _rounded(even + SHARPENING * (even - _rounded(even, window)), window)
    s = np.linspace(0.0, knots[-1], len(smooth))
    spline = CubicSpline(s, smooth)
    curvature = np.maximum(norms(spline(s, 2)), 1e-9)
    where = stations(s, np.clip(np.sqrt(8.0 * CHORD_ERROR_M / curvature), CLOSEST_M, FURTHEST_M))
    found = surface.closest(spline(where))
    index = passes[np.searchsorted(knots, where, side="right") - 1]
    return SurfaceRun(surface, found, index)


def _rounded(points: Array, window: int) -> Array:
    """Mean weighted by a triangle of twice the window."""
    return _moving_average(_moving_average(points, window), window)


def _moving_average(points: Array, window: int) -> Array:
    """Mean over a window; the ends stay, because the line is continued by its point reflection."""
    size = window | 1
    pad = min(size, len(points) - 1)
    longer = np.pad(points, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")
    return averaged(longer, size)[pad : pad + len(points)]


def averaged_twice(values: Array, window: int, mode: str) -> Array:
    """Mean weighted by a triangle of twice the window along the first axis; ``mode`` continues the ends."""
    return averaged(averaged(values, window, mode), window, mode)


def averaged(values: Array, window: int, mode: str = "nearest") -> Array:
    """Mean over a window along the first axis; ``mode`` continues the ends."""
    from scipy.ndimage import uniform_filter1d  # slow to import

    return uniform_filter1d(values, window, 0, mode=mode)


# What a pattern is asked to cover (region and plan -> pattern).


class PatternRequest(NamedTuple):
    """A connected region and how it is to be covered."""

    region: Region  #: What to cover, in one piece; small holes are closed
    mesh: Triangulation  #: Its fine triangulation
    plan: PlanConfig  #: Step-over, order, direction, start and other options of the pattern
    report: Report  #: Called with the share done

    @property
    def stepover(self) -> float:
        """Distance between neighbouring turns [m]."""
        return self.plan.stepover_m

    def finished(self, runs: Sequence[Run]) -> list[SurfaceRun]:
        """Runs smoothed, spaced and on the surface."""
        return [finish_run(self.region.surface, run, self.stepover) for run in runs]
