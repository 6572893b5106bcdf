"""A path beside the surface it belongs to: feet, normals, curvatures, forces and feeds (ToolPath ->
PathOnSurface)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Indices,
    chord_lengths,
    dots,
    in_groups,
    joined,
    norms,
    running_sums,
    unit,
)
from polish_sim.config import ProcessConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import ClosestPoints, Surface
from polish_sim.planning.curve import Curve, interpolated
from polish_sim.planning.ground import Ground
from polish_sim.planning.toolpath import ToolPath, arc_length, interpolate

LONGEST_M = 2e-3  #: Chords in contact longer than this are looked at in between as well [m]


class UnderPad(NamedTuple):
    """The surface under the middle of the pad."""

    normals: Array  #: Unit, shape (n, 3)
    principal: Array  #: Unit direction of the larger curvature, shape (n, 3)
    curvatures: Array  #: Principal curvatures, the larger first [1/m], shape (n, 2)

    def slopes(self, ways: Array) -> Array:
        """Parts of vectors (n, 3) along both principal directions, shape (n, 2)."""
        second = np.cross(self.normals, self.principal)
        return np.stack([dots(ways, way) for way in (self.principal, second)], axis=1)


def ground_under(surface: Surface, foot: ClosestPoints) -> UnderPad:
    """The surface at some of its points (n,)."""
    facets, barycentric = foot.facets, foot.barycentric
    bend = surface.curvature(facets, barycentric)
    normals = surface.evaluate(facets, barycentric).normals
    return UnderPad(normals, bend.directions, np.stack([bend.k1, bend.k2], axis=1))


class PathOnSurface(NamedTuple):
    """Points in contact beside the surface they belong to."""

    positions: Array  #: Tool points [m], shape (n, 3)
    axes: Array  #: Unit tool axes, shape (n, 3)
    under: UnderPad  #: The surface at the closest points
    distances: Array  #: Distance to the part's surface [m], 0 over closed holes, shape (n,)
    forces: Array  #: Contact force [N], shape (n,)
    feeds: Array  #: Feed [m/s], shape (n,)
    stretch_of: Indices  #: Number of the stretch between lifts each point is in, shape (n,)
    stretches: tuple[Indices, ...]  #: Rows of each stretch of two points or more
    runs: tuple[Curve, ...]  #: The same stretches as curves, with surface normals


def locate(ground: Ground, path: ToolPath, process: ProcessConfig) -> PathOnSurface:
    """Find the surface under the points in contact, and between them where they lie far apart.

    The path's own forces and feeds count before those of the process.

    Raises:
        PlanError: No two neighbouring points are in contact.
    """
    path = with_points_between(path)
    surface = ground.region.surface
    index = np.flatnonzero(path.process)
    stretch_of = running_sums(np.diff(index) > 1)[: len(index)]
    every = np.split(np.arange(len(index)), np.flatnonzero(np.diff(index) > 1) + 1)
    stretches = tuple(rows for rows in every if len(rows) > 1)
    if not stretches:
        raise PlanError(
            "no two neighbouring points of the path are in contact. Mark points as 'process', or give "
            "x,y,z,i,j,k."
        )
    positions = path.positions_work[index]
    foot = surface.closest(positions)
    return PathOnSurface(
        positions=positions,
        axes=path.axes_work[index],
        under=ground_under(surface, foot),
        distances=np.where(ground.of_part[foot.facets], norms(positions - foot.positions), 0.0),
        forces=path.force_at(path.s[index], process.contact_force_n),
        feeds=path.feeds(process.feed_m_s)[index],
        stretch_of=stretch_of,
        stretches=stretches,
        runs=tuple(Curve(positions[rows], foot.normals[rows], False) for rows in stretches),
    )


def with_points_between(path: ToolPath) -> ToolPath:
    """Put points into chords in contact that are longer than wanted [m]; the polyline stays what it is."""
    chords = chord_lengths(path.positions_work)
    pressing = path.process[1:] & path.process[:-1]
    counts = np.where(pressing, np.maximum(np.ceil(chords / LONGEST_M * (1.0 - 1e-9)), 1.0), 1.0)
    if (counts == 1.0).all():
        return path
    row, place = in_groups(counts.astype(np.int64))
    at, every = np.append(row + place / counts[row], len(chords)), np.arange(len(path.s))
    positions = interpolate(at, every, path.positions_work)
    numbers = {name: path.columns[name] for name in path.columns.keys() & {"curvature", "force", "feed"}}
    return replace(
        path.rows(at.astype(np.int64)),
        positions_work=positions,
        axes_work=unit(interpolate(at, every, path.axes_work)),
        s=arc_length(positions),
        **{name: np.interp(at, every, column) for name, column in numbers.items()},
    )


# The stretches of a path in contact as one set of arrays, read anywhere along them (runs -> Strands).

_BETWEEN = 1.0  #: Length left between runs on the common scale [m], so that none reads into the next


class RunSamples(NamedTuple):
    """Evenly spaced points of all runs, run after run."""

    run: Indices  #: Which run, shape (n,)
    s: Array  #: Arc length from the run's start [m], shape (n,)
    points: Array  #: [m], shape (n, 3)
    normals: Array  #: Unit surface normals, shape (n, 3)
    first: Indices  #: Number of each run's first sample, one more at the end, shape (runs + 1,)


class Strands:
    """Open polylines on the surface, side by side on one scale of arc length."""

    def __init__(self, runs: Sequence[Curve]) -> None:
        """Take the runs, open curves of two points or more."""
        self.lengths = np.array([run.length for run in runs])
        """Length of each run [m], shape (runs,)."""
        self._offsets = running_sums(self.lengths + _BETWEEN)[:-1]
        self._knots = np.concatenate(
            [run.knots + offset for run, offset in zip(runs, self._offsets, strict=True)]
        )
        self._positions, self._normals = joined((run.positions, run.normals) for run in runs)

    def at(self, run: Indices, s: Array) -> tuple[Array, Array]:
        """Positions [m] and unit normals of runs (n,) at arc lengths (n,), held at a run's ends."""
        where = self._offsets[run] + np.clip(s, 0.0, self.lengths[run])
        return interpolated(self._positions, self._normals, self._knots, where)

    def sample(self, spacing: float) -> RunSamples:
        """Points no further apart than a spacing [m], three or more of each run, both ends among them."""
        counts = np.maximum(np.ceil(self.lengths / spacing).astype(np.int64), 2) + 1
        run, place = in_groups(counts)
        s = place * (self.lengths / (counts - 1))[run]
        points, normals = self.at(run, s)
        return RunSamples(run, s, points, normals, running_sums(counts))
