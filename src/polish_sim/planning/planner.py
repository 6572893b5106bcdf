"""From a region and a plan request to the tool path (Region, PlanConfig -> ToolPath)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, some_rows, turned, unit
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError
from polish_sim.geometry import Region
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
from polish_sim.planning.quality.crossings import Crossings, find_crossings
from polish_sim.planning.quality.located import Strands
from polish_sim.planning.toolpath import ToolPath
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
SMALL_LOOP = 0.5  #: Where a run crosses itself within this many step-overs the whole loop is cut out
DEAD_END = 3.0  #: Pieces shorter than this many step-overs are dropped if others cover what they do
BESIDE = 0.5  #: A piece covers what lies within this many step-overs of it


class Cut(NamedTuple):
    """A stretch to take out of a run."""

    run: int
    s: float  #: Arc length of its middle [m]
    half: float  #: Half its length [m]


def uncross(runs: Sequence[SurfaceRun], stepover: float) -> tuple[list[SurfaceRun], Array]:
    """Cut a short stretch out of one of two strands wherever finished runs cross.

    What is left, in the order given, pieces of one run one after the other; and where strands were cut [m],
    (k, 3).
    """
    left, places = list(runs), np.empty((0, 3))
    for number in range(ROUNDS):
        found = find_crossings([run.curve for run in left])
        if len(found.places) == 0:
            break
        half = CUT * stepover * 2.0**number
        left = _without(left, _choose_cuts(left, found, SMALL_LOOP * stepover, half), stepover)
        places = np.concatenate([places, found.places])
    return left, places


def _choose_cuts(runs: Sequence[SurfaceRun], found: Crossings, loop: float, half: float) -> list[Cut]:
    """Which strand is cut at each place: one cut there already, else the one that ends sooner."""
    lengths = [run.curve.length for run in runs]
    cuts: list[Cut] = []
    for (one, other), (here, there) in zip(found.runs.tolist(), found.s.tolist(), strict=True):
        options = [Cut(one, here, half), Cut(other, there, half)]
        if one == other and there - here < loop:
            options = [Cut(one, 0.5 * (here + there), half + 0.5 * (there - here))]
        cuts.append(min(options, key=lambda cut: _cost(cut, cuts, lengths)))
    return cuts


def _cost(cut: Cut, others: Sequence[Cut], lengths: Sequence[float]) -> float:
    """How far the cut is from the run's nearer end [m]; nothing where the run is cut already."""
    if any(cut.run == other.run and abs(cut.s - other.s) < cut.half + other.half for other in others):
        return -1.0
    return min(cut.s, lengths[cut.run] - cut.s)


def _without(runs: Sequence[SurfaceRun], cuts: Sequence[Cut], stepover: float) -> list[SurfaceRun]:
    """Take stretches out of runs, and drop short pieces that cover nothing others do not."""
    pieces: list[SurfaceRun] = []
    for number, whole in enumerate(runs):
        own = [cut for cut in cuts if cut.run == number]
        pieces += _split(whole, own) if own else [whole]
    short = [run for run in pieces if run not in runs and run.curve.length < DEAD_END * stepover]
    for run in sorted(short, key=lambda run: run.curve.length):
        others = [piece.curve for piece in pieces if piece is not run]
        if others and _covered(run, others, stepover):
            pieces.remove(run)
    return pieces


def _split(run: SurfaceRun, cuts: Sequence[Cut]) -> list[SurfaceRun]:
    """What is left of a run between cuts: of its points, those outside all of them."""
    s = run.curve.knots
    middles, halves = np.array([(cut.s, cut.half) for cut in cuts]).T
    gone = (np.abs(s[:, None] - middles) < halves).any(axis=1)
    piece = np.searchsorted(np.sort(middles), s)
    rows = (np.flatnonzero(~gone & (piece == k)) for k in range(len(cuts) + 1))
    return [
        replace(run, points=some_rows(run.points, kept), pass_index=run.pass_index[kept])
        for kept in rows
        if len(kept) > 1
    ]


def _covered(piece: SurfaceRun, others: Sequence[Curve], stepover: float) -> bool:
    """Whether others cover everything a piece does."""
    samples = Strands([piece.curve]).sample(0.25 * stepover)
    first = unit(np.gradient(samples.points, axis=0))
    around = turned(first, np.cross(samples.normals, first), 0.25 * np.pi * np.arange(8)[:, None])
    beside = (samples.points + BESIDE * stepover * around).reshape(-1, 3)
    found = piece.surface.closest(np.concatenate([samples.points, beside]))
    return bool(strictly_covered(found.positions, found.normals, others, stepover).all())
