"""The net under the patterns: where strands still cross, one of them is cut and the tool lifts (runs ->
runs).

The other strand covers the place, so nothing stays unpolished. A piece beyond a cut that only goes where
other strands cover everything is dropped instead of lifting for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, norms
from polish_sim.geometry import ClosestPoints
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.patterns.run import SurfaceRun
from polish_sim.planning.quality.coverage import strictly_covered
from polish_sim.planning.quality.crossings import find_crossings
from polish_sim.planning.quality.located import Strands
from polish_sim.planning.toolpath import interpolate
from polish_sim.spatial import unit

#: A strand is cut this far on either side of a crossing, in step-overs; twice as far every round after
CUT = 0.15
ROUNDS = 6
AT_PLACE = 0.1  #: Strands that pass a crossing within this many step-overs are looked at
FINE = 0.02  #: Spacing at which they are looked for, in step-overs
DEAD_END = 3.0  #: Pieces shorter than this many step-overs are dropped if others cover what they do
BESIDE = 0.5  #: A piece covers what lies within this many step-overs of it


class Uncrossed(NamedTuple):
    """Runs that cross neither themselves nor each other."""

    runs: list[SurfaceRun]  #: What is left, in the order given, pieces of one run one after the other
    cuts: Array  #: Where a strand was cut [m], shape (k, 3)


class Cut(NamedTuple):
    """A stretch to take out of a run."""

    run: int
    first: float  #: Arc lengths [m]
    last: float


def uncross(runs: Sequence[SurfaceRun], stepover: float) -> Uncrossed:
    """Cut a short stretch out of one of two strands wherever finished runs cross, and return where."""
    left, places = list(runs), np.empty((0, 3))
    for number in range(ROUNDS):
        found = find_crossings([run.curve for run in left])
        if len(found) == 0:
            break
        half = CUT * stepover * 2.0**number
        left = _without(left, _choose_cuts(left, found, stepover, half), stepover)
        places = np.concatenate([places, found])
    return Uncrossed(left, places)


def _choose_cuts(runs: Sequence[SurfaceRun], places: Array, stepover: float, half: float) -> list[Cut]:
    """Which strand is cut at each place: one cut there already, else the one that ends sooner."""
    strands = Strands([run.curve for run in runs])
    samples = strands.sample(FINE * stepover)
    tree = cKDTree(samples.points)
    cuts: list[Cut] = []
    for place in places:
        rows = np.sort(np.array(tree.query_ball_point(place, AT_PLACE * stepover), dtype=np.int64))
        gap = np.flatnonzero((np.diff(rows) > 2) | (np.diff(samples.run[rows]) != 0)) + 1
        passes = [part for part in np.split(rows, gap) if len(part)]
        passes.sort(key=lambda part: norms(samples.points[part] - place).min())
        options = []
        for part in passes[:2]:
            run, s = int(samples.run[part[0]]), samples.s[part]
            nearest = s[norms(samples.points[part] - place).argmin()]
            # Where a strand passes twice without going away in between the whole loop is taken out.
            low, high = (nearest, nearest) if len(passes) > 1 else (s[0], s[-1])
            options.append(Cut(run, float(low) - half, float(high) + half))
        if options:
            cuts.append(min(options, key=lambda cut: _cost(cut, cuts, strands.lengths)))
    return cuts


def _cost(cut: Cut, others: Sequence[Cut], lengths: Array) -> float:
    """How far the cut is from the run's nearer end [m]; nothing where the run is cut already."""
    if any(cut.run == other.run and cut.first < other.last and cut.last > other.first for other in others):
        return -1.0
    return min(cut.first, float(lengths[cut.run]) - cut.last)


def _without(runs: Sequence[SurfaceRun], cuts: Sequence[Cut], stepover: float) -> list[SurfaceRun]:
    """Take stretches out of runs, and drop short pieces that cover nothing others do not."""
    pieces: list[SurfaceRun] = []
    suspects: list[int] = []
    for number, whole in enumerate(runs):
        own = sorted((cut.first, cut.last) for cut in cuts if cut.run == number)
        for run in _split(whole, own) if own else [whole]:
            if own and run.curve.length < DEAD_END * stepover:
                suspects.append(len(pieces))
            pieces.append(run)
    suspects.sort(key=lambda k: pieces[k].curve.length)
    gone: set[int] = set()
    for k in suspects:
        others = [piece.curve for j, piece in enumerate(pieces) if j != k and j not in gone]
        if others and _covered(pieces[k], others, stepover):
            gone.add(k)
    return [piece for k, piece in enumerate(pieces) if k not in gone]


def _split(run: SurfaceRun, cuts: Sequence[tuple[float, float]]) -> list[SurfaceRun]:
    """What is left of a run between stretches taken out (from, to), sorted [m]."""
    s = run.curve.knots
    kept, begin = [], 0.0
    for first, last in cuts:
        kept.append((begin, first))
        begin = max(begin, last)
    kept.append((begin, float(s[-1])))
    shortest = 1e-3 * float(s[-1])
    return [_stretch(run, low, high) for low, high in kept if high - low > min(shortest, 1e-4)]


def _stretch(run: SurfaceRun, low: float, high: float) -> SurfaceRun:
    """A run from one arc length to another [m], its ends on the surface."""
    s, ends = run.curve.knots, np.array([low, high])
    margin = min(1e-3 * (high - low), 1e-5)
    inner = np.flatnonzero((s > low + margin) & (s < high - margin))
    own: tuple[NDArray[Any], ...] = run.points
    tips: tuple[NDArray[Any], ...] = run.surface.closest(interpolate(ends, s, run.positions))
    columns = [np.concatenate([tip[:1], a[inner], tip[1:]]) for a, tip in zip(own, tips, strict=True)]
    index = np.clip(np.searchsorted(s, ends, side="right") - 1, 0, len(s) - 1)
    passes = run.pass_index[np.concatenate([index[:1], inner, index[1:]])]
    return SurfaceRun(run.surface, ClosestPoints(*columns), passes)


def _covered(piece: SurfaceRun, others: Sequence[Curve], stepover: float) -> bool:
    """Whether others cover everything a piece does."""
    samples = Strands([piece.curve]).sample(0.25 * stepover)
    first = unit(np.gradient(samples.points, axis=0))
    second = np.cross(samples.normals, first)
    angle = np.arange(8) * (0.25 * np.pi)
    around = np.cos(angle)[:, None, None] * first + np.sin(angle)[:, None, None] * second
    beside = (samples.points + BESIDE * stepover * around).reshape(-1, 3)
    found = piece.surface.closest(np.concatenate([samples.points, beside]))
    return bool(strictly_covered(found.positions, found.normals, others, stepover).all())
