"""From a region and a plan request to the tool path (Region, PlanConfig -> ToolPath)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, joined, norms, some_rows, turned, unit
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import ClosestPoints, Region
from polish_sim.planning.curve import Curve
from polish_sim.planning.feasibility import check_plan_words
from polish_sim.planning.ground import Ground, prepare_ground
from polish_sim.planning.moves.stroke import Planned, assemble
from polish_sim.planning.moves.travel import AirSpace, order_blocks
from polish_sim.planning.patterns import PATTERNS
from polish_sim.planning.patterns.run import PatternRequest, SurfaceRun
from polish_sim.planning.quality.access import Leaning
from polish_sim.planning.quality.areas import CutOut
from polish_sim.planning.quality.coverage import strictly_covered
from polish_sim.planning.quality.crossings import find_crossings
from polish_sim.planning.quality.located import Strands
from polish_sim.planning.toolpath import ToolPath, interpolate
from polish_sim.planning.turns import Report

TOO_NARROW = "too narrow for a turn half a step-over inside its border"
CUT_HERE = "cut where the path would cross itself"


def plan_path(region: Region, plan: PlanConfig, on_progress: Report = lambda share: None) -> ToolPath:
    """Cover a region with a tool path on the surface, with approach, lead-in, lead-out and retract.

    ``plan`` has the pattern, the step-over and all other wishes:
    ``PlanConfig(pattern="raster", stepover_m=0.01)``. ``on_progress`` is called with the share of the region
    covered so far.

    Raises:
        InputError: Unknown pattern, lead-in, order or direction.
        PlanError: The step-over does not fit the region.
    """
    return plan_on(prepare_ground(region, plan), plan, on_progress).path


def plan_on(
    ground: Ground,
    plan: PlanConfig,
    on_progress: Report = lambda share: None,
    air: AirSpace | None = None,
    leaning: Leaning | None = None,
) -> Planned:
    """As `plan_path` on ground prepared before, with notes, and clear of the whole part.

    Args:
        ground: The region, prepared.
        plan: What is asked for.
        on_progress: Called with the share of the region covered so far.
        air: What the tool must not run into in the air; the tool point not into the region if not given.
        leaning: How the tool leans away from what stands beside it.

    Raises:
        InputError: Unknown pattern, lead-in, order or direction.
        PlanError: The region is too narrow for the step-over.
    """
    check_plan_words(plan)
    found = _cover(ground, plan, on_progress)
    if not any(found):
        raise PlanError(
            f"the region is too narrow for a step-over of {plan.stepover_m * 1e3:.4g} mm: no turn fits half "
            "of it inside the border. Set a smaller step-over (or a larger --overlap) or a larger region."
        )
    cuts = [
        CutOut(TOO_NARROW, piece.mesh.vertices)
        for piece, runs in zip(ground.pieces, found, strict=True)
        if not runs
    ]
    left, places = uncross([run for runs in found for run in runs], plan.stepover_m)
    cuts.append(CutOut(CUT_HERE, places))
    runs = _in_order(left, PATTERNS[plan.pattern].one_way, plan.start)
    region = ground.region
    air = air or AirSpace(region.surface, plan.clearance_m, region.up)
    return assemble(runs, plan, air, cuts, leaning)


def _cover(ground: Ground, plan: PlanConfig, report: Report) -> list[list[SurfaceRun]]:
    """Call the pattern for each piece: the runs of each, none where it is too narrow."""
    total = sum(piece.region.area_m2 for piece in ground.pieces)
    done = 0.0
    found = []
    for piece in ground.pieces:
        share = piece.region.area_m2 / total
        request = PatternRequest(
            piece.region,
            piece.mesh,
            plan,
            lambda x, done=done, share=share: report(done + share * x),  # type: ignore[misc]
        )
        found.append(PATTERNS[plan.pattern].plan(request))
        done += share
    return found


def _in_order(runs: Sequence[SurfaceRun], one_way: bool, start: tuple[float, ...]) -> list[SurfaceRun]:
    """Runs in an order with short ways through the air; those of a one-way pattern are walked as they are."""
    ends = np.array([run.positions[[0, -1]] for run in runs])
    order, backwards = order_blocks(ends, not one_way, np.array(start) if start else None)
    return [runs[k].backwards() if turned else runs[k] for k, turned in zip(order, backwards, strict=True)]


# The net under the patterns: where strands still cross, one of them is cut and the tool lifts. The other
# strand covers the place, so nothing stays unpolished. A piece beyond a cut that only goes where others
# cover everything is dropped instead of lifting for it.

#: A strand is cut this far on either side of a crossing, in step-overs; twice as far every round after
CUT = 0.15
ROUNDS = 6
AT_PLACE = 0.1  #: Strands that pass a crossing within this many step-overs are looked at
FINE = 0.02  #: Spacing at which they are looked for, in step-overs
DEAD_END = 3.0  #: Pieces shorter than this many step-overs are dropped if others cover what they do
BESIDE = 0.5  #: A piece covers what lies within this many step-overs of it


class Cut(NamedTuple):
    """A stretch to take out of a run."""

    run: int
    first: float  #: Arc lengths [m]
    last: float


def uncross(runs: Sequence[SurfaceRun], stepover: float) -> tuple[list[SurfaceRun], Array]:
    """Cut a short stretch out of one of two strands wherever finished runs cross.

    What is left, in the order given, pieces of one run one after the other; and where strands were cut [m],
    (k, 3).
    """
    left, places = list(runs), np.empty((0, 3))
    for number in range(ROUNDS):
        found = find_crossings([run.curve for run in left])
        if len(found) == 0:
            break
        half = CUT * stepover * 2.0**number
        left = _without(left, _choose_cuts(left, found, stepover, half), stepover)
        places = np.concatenate([places, found])
    return left, places


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
            run, s = samples.run[part[0]], samples.s[part]
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
    return min(cut.first, lengths[cut.run] - cut.last)


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
    length = run.curve.length
    kept, begin = [], 0.0
    for first, last in (*cuts, (length, length)):
        kept.append((begin, first))
        begin = max(begin, last)
    return [_stretch(run, low, high) for low, high in kept if high - low > min(1e-3 * length, 1e-4)]


def _stretch(run: SurfaceRun, low: float, high: float) -> SurfaceRun:
    """A run from one arc length to another [m], its ends on the surface."""
    s, ends = run.curve.knots, np.array([low, high])
    margin = min(1e-3 * (high - low), 1e-5)
    inner = np.flatnonzero((s > low + margin) & (s < high - margin))
    tips = run.surface.closest(interpolate(ends, s, run.positions))
    points = joined([some_rows(tips, np.s_[:1]), some_rows(run.points, inner), some_rows(tips, np.s_[1:])])
    index = np.clip(np.searchsorted(s, ends, side="right") - 1, 0, len(s) - 1)
    passes = run.pass_index[np.concatenate([index[:1], inner, index[1:]])]
    return SurfaceRun(run.surface, ClosestPoints(*points), passes)


def _covered(piece: SurfaceRun, others: Sequence[Curve], stepover: float) -> bool:
    """Whether others cover everything a piece does."""
    samples = Strands([piece.curve]).sample(0.25 * stepover)
    first = unit(np.gradient(samples.points, axis=0))
    around = turned(first, np.cross(samples.normals, first), 0.25 * np.pi * np.arange(8)[:, None])
    beside = (samples.points + BESIDE * stepover * around).reshape(-1, 3)
    found = piece.surface.closest(np.concatenate([samples.points, beside]))
    return bool(strictly_covered(found.positions, found.normals, others, stepover).all())
