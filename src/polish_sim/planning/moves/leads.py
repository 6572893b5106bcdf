"""How the tool approaches the part and leaves it: lead-in, lead-out, approach and retract (paper 1, 1.4, fig.
14)."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from polish_sim.arrays import Array, dots, joined, some_rows, unit
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.planning.moves.travel import APART_M, AirSpace, Move, evenly, move_in, move_of, path_of
from polish_sim.planning.quality.located import ground_under
from polish_sim.planning.quality.tool_room import pressed_places
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, LEAD_OUT, RETRACT, ToolPath

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


BACKWARDS = np.s_[::-1]


def with_leads(process: Move, start: LeadShape, end: LeadShape, clearance: float) -> Move:
    """Put approach and lead-in, from a ``clearance`` [m] on, before a process move and lead-out and retract
    after it; ``end`` is how the tool leaves, mirrored."""
    way_down = landing(process, start, clearance)
    way_up = landing(some_rows(process, BACKWARDS), end, clearance, (RETRACT, LEAD_OUT))
    return Move(*joined([way_down, process, some_rows(way_up, BACKWARDS)]))


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
    moves = (
        move_in(code, foot + points[:, :1] * back + points[:, 1:] * axis, axis, turn)
        for code, points in zip(codes, (above, profile), strict=True)
    )
    return Move(*joined(moves))


ROUNDING_M = 1e-9


def choose_leads(process: Move, name: str, air: AirSpace) -> tuple[LeadShape, LeadShape] | None:
    """Keep the lead asked for unless the tool would run into the part on it; then come straight along the
    axis.

    What the pad yields to where it presses it yields to on the lead. The tool point itself never enters the
    part.

    Returns how a stroke begins, and how it ends; None if the tool can land on one of its ends in neither way.
    """
    start, end = (
        next((shape for shape in (LEADS[name], normal_lead) if _is_clear(way, shape, air)), None)
        for way in (process, some_rows(process, BACKWARDS))
    )
    return None if start is None or end is None else (start, end)


def _is_clear(process: Move, shape: LeadShape, air: AirSpace) -> bool:
    """Whether the tool does not run into the part on a lead."""
    foot, way = some_rows(process, np.s_[:1]), landing(process, shape, air.clearance)
    up = np.abs(dots(way.positions - foot.positions, foot.axes))
    if (signed_distances(air.part, way.positions) < np.minimum(0.5 * up, APART_M) - ROUNDING_M).any():
        return False
    if not air.tool:
        return True
    under = ground_under(air.part, air.part.closest(foot.positions))
    pressed = pressed_places(foot.positions, foot.axes, under, air.tool.pad, air.tool.force)
    return air.has_room(way.positions, way.axes, pressed)


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
