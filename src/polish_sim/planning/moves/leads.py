"""How the tool approaches the part and leaves it: lead-in, lead-out, approach and retract (paper 1, 1.4, fig.
14)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, dots, joined, unit
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.planning.moves.travel import APART_M, AirSpace, Move, evenly, move_in, move_of, path_of
from polish_sim.planning.quality.located import ground_under
from polish_sim.planning.quality.tool_room import pressed_places
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, LEAD_OUT, RETRACT, ToolPath, arc_length

LEAD_SHARE = 1.0 / 3.0  #: Height of the lead-in as a share of the clearance
RAMP = np.radians(20.0)  #: Angle of the tangent lead-in to the surface [rad]
LeadShape = Callable[[float], Array]
"""Maps a height [m] to points (distance back along the path, height above the part) [m], shape (n, 2), top
first."""


def normal_lead(height: float) -> Array:
    """Straight down along the tool axis: the tool never touches the part sideways."""
    down = evenly(height, 0.0, height)
    return np.stack([np.zeros_like(down), down], axis=1)


def tangent_lead(height: float) -> Array:
    """A shallow ramp along the path."""
    down = evenly(height, 0.0, height / np.sin(RAMP))
    return np.stack([down / np.tan(RAMP), down], axis=1)


def arc_lead(height: float) -> Array:
    """A quarter circle that ends along the path."""
    angle = evenly(0.5 * np.pi, 0.0, 0.5 * np.pi * height)
    return height * np.stack([np.sin(angle), 1.0 - np.cos(angle)], axis=1)


LEADS: Mapping[str, LeadShape] = {"normal": normal_lead, "tangent": tangent_lead, "arc": arc_lead}


class Landing(NamedTuple):
    """How a stroke begins or ends."""

    shape: LeadShape
    clearance: float  #: Height it begins from [m]
    row: int = 0  #: Point of the stroke at which the tool lands or leaves


BACKWARDS = np.s_[::-1]


def with_leads(process: Move, start: Landing, end: Landing) -> Move:
    """Put approach and lead-in before a process move and lead-out and retract after it; ``end`` is how the
    tool leaves, mirrored."""
    way_down = landing(process, start.shape, start.clearance)
    way_up = landing(process.rows(BACKWARDS), end.shape, end.clearance, (RETRACT, LEAD_OUT)).rows(BACKWARDS)
    return Move(*joined([way_down, process, way_up]))


def landing(
    process: Move, shape: LeadShape, clearance: float, codes: tuple[int, int] = (APPROACH, LEAD_IN)
) -> Move:
    """The straight way down to the lead at the beginning of a process move, and the lead.

    They keep the tool axis of the beginning; the first point is ``clearance`` [m] above the part along it.
    """
    height = LEAD_SHARE * clearance
    profile = shape(height)[:-1]
    rise = evenly(clearance, height, clearance - height)[:-1]
    above = np.stack([np.full_like(rise, profile[0, 0]), rise], axis=1)
    foot, axis, turn = process.positions[0], process.axes[0], process.pass_index[0]
    back = foot - process.positions[1]
    back = unit(back - axis * (back @ axis))
    moves = []
    for code, points in zip(codes, (above, profile), strict=True):
        moves.append(move_in(code, foot + points[:, :1] * back + points[:, 1:] * axis, axis, turn))
    return Move(*joined(moves))


ROUNDING_M = 1e-9
#: Shares of the clearance from which a straight lead begins, tried in this order
LOWER = (1.0, 0.5, 0.25, 0.12)
FURTHER = 14  #: Points further along that are tried as the end of a stroke
LONGEST_CUT = 0.45  #: No end of a stroke is shortened by more than this share of it


def choose_leads(process: Move, name: str, air: AirSpace, stepover: float) -> tuple[Landing, Landing] | None:
    """Keep the lead asked for unless the tool would run into the part on it; then come straight along the
    axis.

    What the pad yields to where it presses it yields to on the lead. Where even the straight lead hits, it
    begins lower; where that hits too, the stroke is shortened, by half a ``stepover`` [m] first. The tool
    point itself never enters the part, and it can always come from outside in a straight line.

    Returns how the stroke begins and ends; None if the tool can land on no part of it, or leave from none.
    """
    start, end = (_choose(way, name, air, stepover) for way in (process, process.rows(BACKWARDS)))
    if start is None or end is None or (last := len(process.positions) - 1 - end.row) <= start.row:
        return None
    return start, end._replace(row=last)


def _choose(process: Move, name: str, air: AirSpace, stepover: float) -> Landing | None:
    """The first landing at the beginning that is clear: as asked, straight, from lower, further along."""
    s = arc_length(process.positions)
    # Points further and further along: half a step-over, then always half as far again.
    away = 0.5 * stepover * 1.5 ** np.arange(FURTHER)
    found = np.searchsorted(s, away[away < LONGEST_CUT * s[-1]])
    rows = [int(row) for row in found if 0 < row < len(s) - 1]
    straight = [Landing(normal_lead, share * air.clearance, row) for row in (0, *rows) for share in LOWER]
    tries = (Landing(LEADS[name], air.clearance), *straight)
    return next((landing for landing in tries if _is_clear(process, landing, air)), None)


def _is_clear(process: Move, tried: Landing, air: AirSpace) -> bool:
    """Whether neither the lead nor the way out from it runs into the part."""
    process = process.rows(np.s_[tried.row :])
    foot, way = process.rows(np.s_[:1]), landing(process, tried.shape, tried.clearance)
    up = np.abs(dots(way.positions - foot.positions, foot.axes))
    if (signed_distances(air.part, way.positions) < np.minimum(0.5 * up, APART_M) - ROUNDING_M).any():
        return False
    if air.tool:
        under = ground_under(air.part, air.part.closest(foot.positions))
        pressed = pressed_places(foot.positions, foot.axes, under, air.tool.pad, air.tool.force)
        if not air.has_room(way.positions, way.axes, pressed):
            return False
    top = way.positions[:1]
    return air.way_out(top[0], foot.axes[0], air.height_to_keep(top)) is not None


def with_way_down(path: ToolPath, clearance: float) -> ToolPath:
    """Let a path begin in the air: a tool that begins in contact cannot zero its force sensor.

    Its first point is then ``clearance`` [m] above the part along the tool axis.
    """
    if not path.process[0]:
        return path
    whole = move_of(path)
    way = landing(whole, normal_lead, clearance)
    rows = np.maximum(np.arange(-len(way.positions), len(path.s)), 0)
    own = path.rows(rows)
    return path_of(Move(*joined([way, whole])), own.curvature, own.force, own.feed)
