"""Strokes: runs with tool axes and leads, put in a row; places left out of a path (runs -> ToolPath)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    angles_between,
    chord_lengths,
    evenly_to,
    into_plane,
    joined,
    midpoints,
    some_rows,
    turned,
    unit,
)
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError, count_text, place_in_mm
from polish_sim.planning.moves.leads import LEADS, choose_leads, with_leads
from polish_sim.planning.moves.travel import AirSpace, Move, move_in, move_of, path_of, travel
from polish_sim.planning.patterns.run import SurfaceRun, averaged
from polish_sim.planning.quality.access import Leaning, too_near
from polish_sim.planning.quality.areas import CutOut
from polish_sim.planning.quality.located import ground_under
from polish_sim.planning.quality.tool_room import pressed_places
from polish_sim.planning.toolpath import (
    LEAD_OUT,
    PROCESS,
    RETRACT,
    ToolPath,
    arc_length,
    interpolate,
    rows_apart,
    stretches,
)

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
    turn = chord_lengths(normals)
    jumps = midpoints(s)[turn > CREASE]
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
    # Over less than the distance of the path's points there is nothing to average.
    even = evenly_to(s[-1], max(length, (s[-1] - s[0]) / len(s)) / PER_WINDOW, 8, s[0])
    wanted = unit(_averaged(axes, s, even, max(round(length / (even[1] - even[0])), 1) | 1))
    allowed = np.clip(STEEPEST - angles_between(axes, normals), 0.0, bound)
    angle = angles_between(axes, wanted)
    # Turn towards the mean by the angle allowed, in the plane of both.
    square = unit(into_plane(wanted, axes))
    return unit(turned(axes, square, np.minimum(angle, allowed)))


def _averaged(vectors: Array, s: Array, even: Array, window: int) -> Array:
    """Means of vectors (n, 3) given at ``s`` (n,) over ``even`` evenly spaced places, at ``s`` again."""
    return interpolate(s, even, averaged(interpolate(even, s, vectors), window))


CREASE_REACH = 0.5  #: The tool axis turns over a crease within this many step-overs on either side


class ContactRun(NamedTuple):
    """A run in contact."""

    process: Move
    curvature: Array  #: Normal curvature of the surface along it [1/m], shape (n,)
    axis_deviation_rad: float  #: Largest angle by which smoothing turned an axis [rad]


def give_axes(run: SurfaceRun, plan: PlanConfig, first_pass: int, leaning: Leaning | None) -> ContactRun:
    """Set the tool on a run: along the normal, softened over creases, leaned by lead and tilt, smoothed.

    The run is in the direction it is walked; ``first_pass`` numbers the first of its passes. ``leaning``
    turns the tool away from what stands beside it besides.
    """
    s = arc_length(run.positions)
    tangents = unit(np.gradient(run.positions, axis=0))
    normals = soften_creases(run.points.normals, s, CREASE_REACH * plan.stepover_m)
    leaned = lean(normals, tangents, plan.lead_angle_rad, plan.tilt_angle_rad)
    if leaning:
        leaned = leaning.lean(run.positions, leaned)
    axes = smooth_axes(leaned, run.points.normals, s, plan.axis_smoothing_m, plan.axis_deviation_rad)
    passes = run.pass_index - run.pass_index.min() + first_pass
    return ContactRun(
        move_in(PROCESS, run.positions, axes, passes),
        run.surface.normal_curvature(run.points.facets, run.points.barycentric, tangents),
        angles_between(leaned, axes).max() if axes is not leaned else 0.0,
    )


class Placed(NamedTuple):
    """A stroke with its leads and the way to it."""

    move: Move  #: Travel if there was a stroke before, approach, lead-in, process, lead-out, retract
    source: Indices  #: Row of the stroke each point has its force, feed and curvature from, shape (n,)
    straight: int  #: How many of its leads are not as asked: straight along the tool axis


def place(stroke: Move, previous: Move | None, plan: PlanConfig, air: AirSpace) -> Placed | None:
    """Give a stroke leads and a way to it; None if it cannot be reached."""
    shapes = choose_leads(stroke, plan.lead_in, air)
    if shapes is None:
        return None
    move = with_leads(stroke, *shapes, air.clearance)
    if previous:
        between = travel(previous, move, air)
        if between is None:
            return None
        move = Move(*joined([between, move]))
    before = (move.segment == PROCESS).argmax()
    source = np.clip(np.arange(len(move.segment)) - before, 0, len(stroke.segment) - 1)
    return Placed(move, source, sum(shape is not LEADS[plan.lead_in] for shape in shapes))


NO_WAY = "the tool cannot come there without running into the part"
#: Spacing along a stroke at which the tool is checked for being in the part [pad radii]
CUT_APART = 0.1


class Planned(NamedTuple):
    """A path and notes about it."""

    path: ToolPath
    axis_deviation_max_rad: float  #: Largest angle by which smoothing turned a tool axis [rad]
    notes: tuple[str, ...]  #: What was done differently from what was asked, and where
    cuts: tuple[CutOut, ...] = ()  #: What is not followed


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
        whole = give_axes(run, plan, passes, leaning)
        gone = _in_part(run, whole.process, air, all_cuts)
        for source, found in _place_rest(whole.process, gone, moves, plan, air):
            if found is None:
                all_cuts.append(CutOut(NO_WAY, whole.process.positions[source]))
                continue
            passes = found.move.pass_index.max() + 1
            deviation = max(deviation, whole.axis_deviation_rad)
            straight += found.straight
            curvature.append(whole.curvature[source])
    if not moves:
        raise PlanError(
            "the tool can reach no stroke of the path without running into the part, the first is at "
            f"{place_in_mm(runs[0].positions[0])}. Choose a region that is open to the outside (--region), "
            "or a lower approach (--set plan.clearance_m=...)."
        )
    path = path_of(Move(*joined(moves)), np.concatenate(curvature))
    # The tool may come down again where it went up.
    path = path.rows(np.diff(path.s, prepend=-1.0) > 0.0)
    leads = count_text(straight, "lead")
    note = f"straight along the tool axis: {leads} that as {plan.lead_in} would run into the part"
    return Planned(path, deviation, (note,) if straight else (), tuple(all_cuts))


def _in_part(run: SurfaceRun, move: Move, air: AirSpace, cuts: list[CutOut]) -> Bools:
    """Which points of a stroke are next to ones at which a body of the tool is in the part, (n,); appends
    these to ``cuts``."""
    gone = np.zeros(len(move.positions), dtype=bool)
    if not air.tool:
        return gone
    rows = rows_apart(arc_length(move.positions), CUT_APART * air.tool.pad.radius_m)
    under = ground_under(run.surface, some_rows(run.points, rows))
    places = pressed_places(move.positions[rows], move.axes[rows], under, air.tool.pad, air.tool.force)
    found = air.tool.stands_in(air.alone or air.part, places)
    hit = np.flatnonzero(found.depths > 0.0)
    for number in np.unique(found.bodies[hit]):
        cuts.append(
            CutOut(too_near(*air.tool.pairs[number]), places.middles[hit[found.bodies[hit] == number]])
        )
    for first, last in rows[np.clip(hit[:, None] + [-1, 1], 0, len(rows) - 1)]:
        gone[first : last + 1] = True
    return gone


def _place_rest(
    stroke: Move, gone: Bools, moves: list[Move], plan: PlanConfig, air: AirSpace
) -> Iterator[tuple[Indices, Placed | None]]:
    """Put what is left of a stroke without its points ``gone`` (n,) behind the ``moves`` so far: of every
    stretch the row each point has its force, feed and curvature from, and the stretch with its leads, None if
    it cannot be reached. Where points are gone, stretches no longer than a step-over go too."""
    for low, high in stretches(~gone):
        rows = np.arange(low, high + 1)
        rest = some_rows(stroke, rows)
        if gone.any() and arc_length(rest.positions)[-1] <= plan.stepover_m:
            continue
        found = place(rest, moves[-1] if moves else None, plan, air)
        if found:
            moves.append(found.move)
        yield rows[found.source] if found else rows, found


class Remaining(NamedTuple):
    """What is left of a path."""

    path: ToolPath
    source: Indices  #: Row of the whole path each row has its force, feed and curvature from, shape (n,)
    lost: Bools  #: Rows of the whole path that were in contact and no longer are, shape (m,)


def lift_over(path: ToolPath, gone: Bools, plan: PlanConfig, air: AirSpace) -> Remaining | None:
    """Lift the tool over rows of a path (m,) in contact; stretches shorter than a step-over go with them.

    Strokes before the first that changes stay as they are. Every other stretch that stays gets leads clear of
    the part and a way to it through the air, as in planning; one that has none goes too. None if nothing
    stays.
    """
    moves: list[Move] = []
    sources: list[Indices] = []
    begin, same = 0, True
    for first, last in stretches(path.process):
        end = last
        while end + 1 < len(path.s) and path.segment[end + 1] in (LEAD_OUT, RETRACT):
            end += 1
        same = same and not gone[first : last + 1].any()
        if same:
            sources.append(np.arange(begin, end + 1))
            moves.append(some_rows(move_of(path), np.s_[begin : end + 1]))
        else:
            stroke = some_rows(move_of(path), np.s_[first : last + 1])
            stroke = stroke._replace(segment=np.full(len(stroke.segment), PROCESS, np.int8))
            rest = _place_rest(stroke, gone[first : last + 1], moves, plan, air)
            sources += [first + rows for rows, found in rest if found]
        begin = end + 1
    if not moves:
        return None
    whole, origin = Move(*joined(moves)), np.concatenate(sources)
    own = path.rows(origin)
    left = path_of(whole, own.curvature, own.force, own.feed)
    moving = np.diff(left.s, prepend=-1.0) > 0.0
    lost = path.process.copy()
    lost[origin[left.process]] = False
    return Remaining(left.rows(moving), origin[moving], lost)
