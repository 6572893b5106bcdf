"""A path without some of its places: the tool lifts over them (ToolPath -> ToolPath)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Bools, Indices, joined
from polish_sim.config import PlanConfig
from polish_sim.planning.moves.leads import AirSpace, Move, choose_leads, concatenate, with_leads
from polish_sim.planning.moves.travel import travel
from polish_sim.planning.toolpath import LEAD_OUT, PROCESS, RETRACT, ToolPath, arc_length, stretches


class Remaining(NamedTuple):
    """What is left of a path."""

    path: ToolPath
    source: Indices  #: Row of the whole path each row has its force, feed and curvature from, shape (n,)
    lost: Bools  #: Rows of the whole path that were in contact and no longer are, shape (m,)


class _Block(NamedTuple):
    """A stroke with its leads and the way to it; one row a point."""

    positions: Array
    axes: Array
    segment: NDArray[np.int8]
    passes: Indices
    source: Indices


def lift_over(path: ToolPath, gone: Bools, plan: PlanConfig, air: AirSpace) -> Remaining | None:
    """Lift the tool over rows of a path (m,) in contact; stretches shorter than a step-over go with them.

    Strokes before the first that changes stay as they are. Every other stretch that stays gets leads clear of
    the part and a way to it through the air, as in planning; one that has none goes too. None if nothing
    stays.
    """
    blocks: list[_Block] = []
    begin, same = 0, True
    for first, last in stretches(path.process):
        end = last
        while end + 1 < len(path.s) and path.segment[end + 1] in (LEAD_OUT, RETRACT):
            end += 1
        same = same and not gone[first : last + 1].any()
        if same:
            rows = np.arange(begin, end + 1)
            places, axes = path.positions_work[rows], path.axes_work[rows]
            blocks.append(_Block(places, axes, path.segment[rows], path.pass_index[rows], rows))
        else:
            for kept in stretches(~gone[first : last + 1]):
                block = _placed(
                    path, first + kept[0], first + kept[1], plan, air, blocks[-1] if blocks else None
                )
                blocks += [] if block is None else [block]
        begin = end + 1
    if not blocks:
        return None
    whole = _Block(*joined(blocks))
    s, origin = arc_length(whole.positions), whole.source
    wishes = [None if column is None else column[origin] for column in (path.force, path.feed)]
    left = ToolPath(
        whole.positions, whole.axes, s, whole.passes, whole.segment, path.curvature[origin], *wishes
    )
    moving = np.diff(s, prepend=-1.0) > 0.0
    lost = path.process.copy()
    lost[origin[whole.segment == PROCESS]] = False
    return Remaining(left.rows(moving), origin[moving], lost)


def _placed(
    path: ToolPath, first: int, last: int, plan: PlanConfig, air: AirSpace, previous: _Block | None
) -> _Block | None:
    """A stretch of a path with leads, and the way to it from the stroke before; None if it has none."""
    rows = np.arange(first, last + 1)
    process = Move(path.positions_work[rows], path.axes_work[rows], PROCESS, path.pass_index[rows])
    if arc_length(process.positions)[-1] <= plan.stepover_m:
        return None
    chosen = choose_leads(process, plan.lead_in, air, plan.stepover_m)
    if chosen is None:
        return None
    kept = slice(chosen.start.row, chosen.end.row + 1)
    (shape, clearance, *_), (shape_out, clearance_out, *_) = chosen
    parts = with_leads(process.rows(kept), shape, clearance, shape_out, clearance_out)
    if previous is not None:
        lifted = Move(previous.positions[-1:], previous.axes[-1:], RETRACT, previous.passes[-1:])
        between, clear = travel(lifted, parts[0], air)
        if not clear:
            return None
        parts = [between, *parts]
    around = sum(len(move.positions) for move in parts[:-3]), sum(len(move.positions) for move in parts[-2:])
    positions, axes, segment, passes = concatenate(parts)
    return _Block(positions, axes, segment, passes, np.pad(rows[kept], around, mode="edge"))
