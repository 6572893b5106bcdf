"""From a region and a plan request to the tool path (Region, PlanConfig -> ToolPath)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import Region, Surface
from polish_sim.geometry.fixture import joined_surfaces
from polish_sim.planning.curves.turns import Report
from polish_sim.planning.feasibility import check_plan_words
from polish_sim.planning.ground.ground import Ground, prepare_ground
from polish_sim.planning.moves.leads import (
    LEADS,
    AirSpace,
    Move,
    choose_leads,
    concatenate,
    every,
    with_leads,
)
from polish_sim.planning.moves.stroke import ContactRun, give_axes
from polish_sim.planning.moves.travel import order_blocks, travel
from polish_sim.planning.moves.uncross import uncross
from polish_sim.planning.patterns import PATTERNS
from polish_sim.planning.patterns.run import PatternRequest, SurfaceRun
from polish_sim.planning.quality.access import too_near
from polish_sim.planning.quality.areas import CutOut
from polish_sim.planning.quality.leaning import Leaning
from polish_sim.planning.quality.tool_room import Tool, ground_under, pressed_places
from polish_sim.planning.toolpath import ToolPath, arc_length, stretches

#: Spacing along a stroke at which the tool is checked for being in the part [pad radii]
CUT_APART = 0.1
NO_WAY = "the tool cannot come there without running into the part"
TOO_NARROW = "too narrow for a turn half a step-over inside its border"
CUT_HERE = "cut where the path would cross itself"
SHORTENED = "no room for the lead at the end of a stroke"


class Planned(NamedTuple):
    """A path and notes about it."""

    path: ToolPath
    axis_deviation_max_rad: float  #: Largest angle by which smoothing turned a tool axis [rad]
    notes: tuple[str, ...]  #: What was done differently from what was asked, and where
    cuts: tuple[CutOut, ...] = ()  #: What is not followed


class Placed(NamedTuple):
    """A stroke with its leads and the way to it."""

    stroke: ContactRun
    moves: list[Move]  #: Travel if there was a stroke before, approach, lead-in, process, lead-out, retract
    straight: int  #: How many of its leads are not as asked: straight along the tool axis
    shortened: Array  #: What was cut off its ends [m], shape (k, 3)


def plan_path(region: Region, plan: PlanConfig, on_progress: Report | None = None) -> ToolPath:
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
    on_progress: Report | None = None,
    part: Surface | None = None,
    tool: Tool | None = None,
    leaning: Leaning | None = None,
) -> Planned:
    """As `plan_path` on ground prepared before, with notes, and clear of the whole part.

    Args:
        ground: The region, prepared.
        plan: What is asked for.
        on_progress: Called with the share of the region covered so far.
        part: The whole part the tool must not run into in the air; the region if not given.
        tool: The tool that must not; only the tool point if not given.
        leaning: How the tool leans away from what stands beside it.

    Raises:
        InputError: Unknown pattern, lead-in, order or direction.
        PlanError: The region is too narrow for the step-over.
    """
    check_plan_words(plan)
    found = _cover(ground, plan, on_progress or (lambda share: None))
    if not any(found):
        raise PlanError(
            f"the region is too narrow for a step-over of {plan.stepover_m * 1e3:.4g} mm: no turn fits half "
            "of it inside the border. Set a smaller step-over or a larger region."
        )
    cuts = [
        CutOut(TOO_NARROW, piece.mesh.vertices)
        for piece, runs in zip(ground.pieces, found, strict=True)
        if not runs
    ]
    done = uncross([run for runs in found for run in runs], plan.stepover_m)
    cuts.append(CutOut(CUT_HERE, done.cuts))
    runs = _in_order(done.runs, PATTERNS[plan.pattern].one_way, plan.start)
    alone = ground.region.surface if part is None else part
    obstacle = joined_surfaces(alone, tool.fixture if tool else None)
    radius = 0.0 if tool is None else tool.pad.radius_m
    air = AirSpace(obstacle, radius, plan.clearance_m, ground.region.up, tool, alone)
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
    tour = order_blocks(ends, not one_way, np.array(start) if start else None)
    return [
        runs[int(index)].backwards() if backwards else runs[int(index)]
        for index, backwards in zip(tour.order, tour.backwards, strict=True)
    ]


def assemble(
    runs: Sequence[SurfaceRun],
    plan: PlanConfig,
    air: AirSpace,
    cuts: Sequence[CutOut],
    leaning: Leaning | None,
) -> Planned:
    """Give runs their tool axes and leads and put them in a row; what the tool cannot reach is left out.

    Raises:
        PlanError: The tool can reach none of them.
    """
    moves: list[Move] = []
    curvature: list[Array] = []
    all_cuts = list(cuts)
    passes, deviation, straight = 0, 0.0, 0
    for run in runs:
        for whole in _clear_of_part(run, give_axes(run, plan, passes, leaning), plan, air, all_cuts):
            placed = _place(whole, moves[-1] if moves else None, plan, air)
            if placed is None:
                all_cuts.append(CutOut(NO_WAY, whole.process.positions))
                continue
            stroke = placed.stroke
            all_cuts.append(CutOut(SHORTENED, placed.shortened))
            passes = int(stroke.process.pass_index.max()) + 1
            deviation = max(deviation, stroke.axis_deviation_rad)
            straight += placed.straight
            before = sum(len(move.positions) for move in placed.moves[:-3])
            after = sum(len(move.positions) for move in placed.moves[-2:])
            curvature.append(np.pad(stroke.curvature, (before, after), mode="edge"))
            moves += placed.moves
    if not moves:
        raise PlanError(
            "the tool can reach no stroke of the path without running into the part, the first is at "
            f"{place_in_mm(runs[0].positions[0])}. Choose a region that is open to the outside (--region), "
            "or a lower approach (--set plan.clearance_m=...)."
        )
    positions, axes, segment, pass_index = concatenate(moves)
    path = ToolPath(positions, axes, arc_length(positions), pass_index, segment, np.concatenate(curvature))
    # The tool may come down again where it went up.
    path = path.rows(np.diff(path.s, prepend=-1.0) > 0.0)
    note = f"{straight} leads go straight along the tool axis: a {plan.lead_in} one would run into the part"
    return Planned(path, deviation, (note,) if straight else (), tuple(all_cuts))


def _clear_of_part(
    run: SurfaceRun, whole: ContactRun, plan: PlanConfig, air: AirSpace, cuts: list[CutOut]
) -> Sequence[ContactRun]:
    """The stretches of a stroke on which no body of the tool is in the part; appends the others to
    ``cuts``."""
    if air.tool is None:
        return [whole]
    move, points = whole.process, run.points
    rows = every(move.positions, CUT_APART * air.pad_radius)
    under = ground_under(run.surface, points.facets[rows], points.barycentric[rows])
    places = pressed_places(move.positions[rows], move.axes[rows], under, air.tool.pad, air.tool.force)
    found = air.tool.stands_in(air.alone or air.part, places)
    hit = np.flatnonzero(found.depths > 0.0)
    if not len(hit):
        return [whole]
    for number in np.unique(found.bodies[hit]):
        cuts.append(
            CutOut(too_near(*air.tool.pairs[number]), places.middles[hit[found.bodies[hit] == number]])
        )
    clear = np.ones(len(move.positions), dtype=bool)
    for first, last in zip(
        rows[np.maximum(hit - 1, 0)], rows[np.minimum(hit + 1, len(rows) - 1)], strict=True
    ):
        clear[first : last + 1] = False
    s = arc_length(move.positions)
    return [
        whole.rows(first, last) for first, last in stretches(clear) if s[last] - s[first] > plan.stepover_m
    ]


def _place(whole: ContactRun, previous: Move | None, plan: PlanConfig, air: AirSpace) -> Placed | None:
    """Leads for a stroke, shortened if need be, and the way to it; None if it cannot be reached."""
    chosen = choose_leads(whole.process, plan.lead_in, air, plan.stepover_m)
    if chosen is None:
        return None
    start, end = chosen
    stroke = whole.rows(start.row, end.row)
    line = whole.process.positions
    parts = with_leads(stroke.process, start.shape, start.clearance, end.shape, end.clearance)
    if previous is not None:
        between, clear = travel(previous, parts[0], air)
        if not clear:
            return None
        parts = [between, *parts]
    shortened = np.concatenate([line[: start.row], line[end.row + 1 :]])
    straight = sum(landing.shape is not LEADS[plan.lead_in] for landing in chosen)
    return Placed(stroke, parts, straight, shortened)
