"""How the tool approaches the part and leaves it: lead-in, lead-out, approach and retract (paper 1, 1.4, fig.
14); and whether a lifted tool can leave a place in a straight line, and along which."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Indices, dots, norms
from polish_sim.geometry import Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.planning.quality.tool_room import CHECKED_APART, Places, Tool, ground_under, pressed_places
from polish_sim.planning.toolpath import APPROACH, LEAD_IN, LEAD_OUT, PROCESS, RETRACT, ToolPath, arc_length
from polish_sim.spatial import perpendicular, unit

DIRECTIONS = 40  #: Directions tried in the half space the tool looks away to, besides up and the tool axis
KEPT = 0.7  #: Share of the clearance the travelling tool keeps from the part
KEPT_LOW = 0.9  #: Where it was lifted less than that: share of the height it had then
SHORTEST_STEP_M = 5e-4
MOST_STEPS = 400


class Ball(NamedTuple):
    """A ball around the part; outside it the tool travels freely."""

    middle: Array
    radius: float


def ball_around(part: Surface, clearance: float) -> Ball:
    """A ball that holds the part and half as much again as the clearance [m]."""
    return Ball(part.middle, part.radius + 1.5 * clearance)


def height_to_keep(part: Surface, tops: Array, clearance: float) -> float:
    """Distance from the part a tool keeps that travels from or to places (n, 3) with a clearance [m]."""
    return float(min(KEPT * clearance, KEPT_LOW * signed_distances(part, tops).min()))


def way_out(part: Surface, ball: Ball, point: Array, axis: Array, up: Array, kept: float) -> Array | None:
    """Find a straight way from a lifted tool at ``point`` (3,) [m] to outside the ball around the part.

    Returns a unit direction (3,): up if that is free, else the tool's axis, else the one nearest to it; None
    without any. The tool keeps ``kept`` [m] from the part.
    """
    if kept <= 0.0:
        return None
    for direction in (up, axis, *_around(axis)):
        if _is_free(part, ball, point, direction, kept):
            return np.asarray(direction)
    return None


def _around(axis: Array) -> Array:
    """Unit directions spread over the half space about an axis, the nearest to it first, shape (n, 3)."""
    k = np.arange(DIRECTIONS) + 0.5
    along, angle = 1.0 - k / DIRECTIONS, k * np.pi * (3.0 - np.sqrt(5.0))
    first = perpendicular(axis)
    second = np.cross(axis, first)
    beside = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return unit(along[:, None] * axis + np.sqrt(1.0 - along**2)[:, None] * beside)


def _is_free(part: Surface, ball: Ball, point: Array, direction: Array, kept: float) -> bool:
    """Walk along a ray in steps no longer than the distance to the part allows."""
    here = point
    for _ in range(MOST_STEPS):
        if np.linalg.norm(here - ball.middle) > ball.radius:
            return True
        height = signed_distances(part, here[None])[0]
        if height < kept:
            return False
        here = here + direction * max(height - kept, SHORTEST_STEP_M)
    return False


# Whether the tool runs into the part on its way through the air (moves -> depths).

RIM_POINTS = 24


def rim_depths(surface: Surface, positions: Array, axes: Array, radius: float) -> Array:
    """How deep the middle or the rim of the pad's face stands in the part [m], 0 where it is clear, shape
    (n,).

    Tool points and unit axes are (n, 3) each; a ``radius`` of 0 looks at the tool point only.
    """
    points = positions[:, None]
    if radius > 0.0:
        first = _beside(surface, axes)
        second = np.cross(axes, first)
        angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
        rim = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        points = np.concatenate([points, points + radius * rim], axis=1)
    depth = -signed_distances(surface, points.reshape(-1, 3)).reshape(points.shape[:2])
    return np.maximum(depth, 0.0).max(axis=1)


def _beside(surface: Surface, axes: Array) -> Array:
    """Unit vectors square to axes (n, 3) that turn with the part, as the coordinate axes would not."""
    ways = surface.vertices[:3] - surface.middle
    square = np.cross(axes[:, None], ways)
    size = norms(square)
    # The first that is long enough: rounding does not choose among equals.
    chosen = (size > 0.5 * size.max(axis=1, keepdims=True)).argmax(axis=1)
    rows = np.arange(len(axes))
    return square[rows, chosen] / size[rows, chosen][:, None]


LEAD_SHARE = 1.0 / 3.0  #: Height of the lead-in as a share of the clearance
RAMP = np.radians(20.0)  #: Angle of the tangent lead-in to the surface [rad]
SPACING_M = 1e-3
LeadShape = Callable[[float], Array]
"""Maps a height [m] to points (distance back along the path, height above the part) [m], shape (n, 2), top
first."""


class Move(NamedTuple):
    """A piece of the tool path in one segment."""

    positions: Array  #: Tool points [m], shape (n, 3)
    axes: Array  #: Unit tool axes, shape (n, 3)
    segment: int
    pass_index: Indices

    def rows(self, kept: slice) -> Move:
        """Some of its points."""
        return Move(self.positions[kept], self.axes[kept], self.segment, self.pass_index[kept])


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


def with_leads(
    process: Move,
    shape: LeadShape,
    clearance: float,
    shape_out: LeadShape | None = None,
    clearance_out: float | None = None,
) -> list[Move]:
    """Put approach and lead-in before a process move and lead-out and retract after it: five moves.

    ``shape`` is how the tool lands, ``shape_out`` how it leaves, mirrored, the same if not given. The first
    point is ``clearance`` [m] above the part along the tool axis, the last ``clearance_out`` or as much.
    """
    lead_in, approach = landing(process, True, shape, clearance)
    lead_out, retract = landing(process, False, shape_out or shape, clearance_out or clearance)
    return [approach, lead_in, process, lead_out, retract]


def landing(process: Move, at_start: bool, shape: LeadShape, clearance: float) -> tuple[Move, Move]:
    """The lead at one end of a process move and the straight way above it, in the order they are walked.

    The lead keeps the tool axis of its end; the furthest point is ``clearance`` [m] above the part along it.
    """
    height = LEAD_SHARE * clearance
    profile = shape(height)[:-1]
    rise = evenly(clearance, height, clearance - height)[:-1]
    above = np.stack([np.full_like(rise, profile[0, 0]), rise], axis=1)
    end, inner, codes = (0, 1, (LEAD_IN, APPROACH)) if at_start else (-1, -2, (LEAD_OUT, RETRACT))
    axis = process.axes[end]
    back = process.positions[end] - process.positions[inner]
    back = unit(back - axis * (back @ axis))
    moves = []
    for points, code in ((profile, codes[0]), (above, codes[1])):
        line = process.positions[end] + points[:, :1] * back + points[:, 1:] * axis
        line = line if at_start else line[::-1]
        turn = np.full(len(line), process.pass_index[end])
        moves.append(Move(line, np.tile(axis, (len(line), 1)), code, turn))
    return moves[0], moves[1]


def concatenate(moves: Sequence[Move]) -> tuple[Array, Array, NDArray[np.int8], Indices]:
    """Positions, axes, segment codes and pass indices of all moves in a row."""
    return (
        np.concatenate([move.positions for move in moves]),
        np.concatenate([move.axes for move in moves]),
        np.concatenate([np.full(len(move.positions), move.segment, dtype=np.int8) for move in moves]),
        np.concatenate([move.pass_index for move in moves]),
    )


def evenly(first: float, last: float, length: float) -> Array:
    """Values from first to last, about `SPACING_M` apart over a length."""
    return np.linspace(first, last, max(int(np.ceil(length / SPACING_M)), 2) + 1)


# Which lead-in and lead-out a stroke gets: the one asked for where it keeps clear of the part (Move ->
# LeadShape).

TOLERANCE_M = 2e-4  #: On its lead the pad may stand this much deeper in the part than where it lands [m]
APART_M = 3e-4  #: On its lead the tool point keeps this far from the part, but at most half its height [m]
ROUNDING_M = 1e-9
#: Shares of the clearance from which a straight lead begins, tried in this order
LOWER = (1.0, 0.5, 0.25, 0.12)
FURTHER = 14  #: Points further along that are tried as the end of a stroke
NEAR = 3  #: Points tried when only the pad's rim touches
LONGEST_CUT = 0.45  #: No end of a stroke is shortened by more than this share of it


class AirSpace(NamedTuple):
    """What the lifted tool must keep clear of."""

    part: Surface  #: The whole part, in its fixture if it has one
    pad_radius: float  #: [m]; 0 looks at the tool point only
    clearance: float  #: Height of a lifted tool above the part along its axis [m]
    up: Array  #: Unit vector away from the table, shape (3,)
    tool: Tool | None = None  #: What follows the pad; None looks at the pad only
    alone: Surface | None = None  #: The part without a fixture, if it has one: the tool knows that by itself

    def has_room(self, line: Array, axes: Array, presses: Places | None = None) -> bool:
        """Whether the tool is nowhere in the part along points (n, 3), pressed as it is at a place or not at
        all."""
        if self.tool is None:
            return True
        rows = every(line, CHECKED_APART * self.tool.pad.radius_m)
        low, yields = (presses.lows[0], presses.yields[0]) if presses else (APART_M, 0.0)
        places = Places(line[rows], axes[rows], np.full(len(rows), low), np.full(len(rows), yields))
        return not self.tool.stands_in(self.alone or self.part, places).depths.any()


class Landing(NamedTuple):
    """How a stroke begins or ends."""

    shape: LeadShape
    clearance: float  #: Height it begins from [m]
    row: int  #: Point of the stroke at which the tool lands or leaves


class ChosenLeads(NamedTuple):
    """How a stroke begins and ends."""

    start: Landing
    end: Landing


def choose_leads(process: Move, name: str, air: AirSpace, stepover: float) -> ChosenLeads | None:
    """Keep the lead asked for unless the pad would run into the part on it; then come straight along the
    axis.

    A pad on a hollow already stands in the part with its rim where it presses, and next to a wall it does so
    on any
    lead: a lead hits when the pad stands deeper on it, or on the straight way above it, than where it touches
    down. Where even the straight lead hits, it begins lower; where that hits too, the stroke is shortened, a
    ``stepover`` [m] at a time. The tool point itself never enters the part, and it can always come from
    outside in a straight line.

    None if the tool can land on no part of the stroke, or leave from none.
    """
    ball = ball_around(air.part, air.clearance)
    start, end = (_choose(process, at_start, name, air, ball, stepover) for at_start in (True, False))
    if start is None or end is None or end.row - start.row < 1:
        return None
    return ChosenLeads(start, end)


def _choose(
    process: Move, at_start: bool, name: str, air: AirSpace, ball: Ball, stepover: float
) -> Landing | None:
    """The first landing that is clear: as asked, straight, from lower, further along; last with the pad in a
    wall."""
    rows = _rows_along(process, at_start, stepover)
    straight: list[tuple[LeadShape, float]] = [(normal_lead, share * air.clearance) for share in LOWER]
    point_only = air._replace(pad_radius=0.0)
    last = 0 if at_start else len(process.positions) - 1
    tries: list[tuple[AirSpace, list[tuple[LeadShape, float]], list[int]]] = [
        (air, [(LEADS[name], air.clearance), *straight], [last]),
        (air, straight, rows[:NEAR]),
        (point_only, straight, [last, *rows]),
    ]
    for around, shapes, where in tries:
        for row in where:
            for shape, clearance in shapes:
                cut = slice(row, None) if at_start else slice(row + 1)
                if _is_clear(process.rows(cut), at_start, shape, clearance, around, ball):
                    return Landing(shape, clearance, row)
    return None


def _rows_along(process: Move, at_start: bool, stepover: float) -> list[int]:
    """Points of a stroke further and further from its end: half a step-over, then always half as far
    again."""
    s = arc_length(process.positions)
    away = 0.5 * stepover * 1.5 ** np.arange(FURTHER)
    away = away[away < LONGEST_CUT * s[-1]]
    rows = np.searchsorted(s, away) if at_start else np.searchsorted(s, s[-1] - away, side="right") - 1
    return [int(row) for row in rows if 0 < row < len(s) - 1]


def _is_clear(
    process: Move, at_start: bool, shape: LeadShape, clearance: float, air: AirSpace, ball: Ball
) -> bool:
    """Whether neither the lead nor the way out from it runs into the part."""
    end = slice(0, 1) if at_start else slice(-1, None)
    landed = rim_depths(air.part, process.positions[end], process.axes[end], air.pad_radius)[0]
    lead, above = landing(process, at_start, shape, clearance)
    line = np.concatenate([lead.positions, above.positions])
    axes = np.concatenate([lead.axes, above.axes])
    up = np.abs(dots(line - process.positions[end], process.axes[end]))
    if (signed_distances(air.part, line) < np.minimum(0.5 * up, APART_M) - ROUNDING_M).any():
        return False
    if rim_depths(air.part, line, axes, air.pad_radius).max() > landed + TOLERANCE_M:
        return False
    if not air.has_room(line, axes, _pressed_at(process.positions[end], process.axes[end], air)):
        return False
    top = above.positions[0 if at_start else -1]
    kept = height_to_keep(air.part, top[None], air.clearance)
    return way_out(air.part, ball, top, process.axes[end][0], air.up, kept) is not None


def _pressed_at(position: Array, axis: Array, air: AirSpace) -> Places | None:
    """The tool pressed on the part at a place (1, 3); None without a tool."""
    if air.tool is None:
        return None
    foot = air.part.closest(position)
    under = ground_under(air.part, foot.facets, foot.barycentric)
    return pressed_places(position, axis, under, air.tool.pad, air.tool.force)


def every(line: Array, spacing: float) -> Indices:
    """Rows of a polyline (n, 3) no further apart than its points or a spacing [m], both ends among them."""
    s = arc_length(line)
    marks = np.linspace(0.0, s[-1], max(int(np.ceil(s[-1] / spacing)), 1) + 1)
    return np.unique(np.append(np.searchsorted(s, marks).clip(0, len(s) - 1), [0, len(s) - 1]))


# A path made elsewhere gets a way down to its first point if it has none (ToolPath -> ToolPath).


def with_way_down(path: ToolPath, clearance: float) -> ToolPath:
    """Let a path begin in the air: a tool that begins in contact cannot zero its force sensor.

    Its first point is then ``clearance`` [m] above the part along the tool axis.
    """
    if not path.process[0]:
        return path
    first = slice(0, 2)
    contact = Move(path.positions_work[first], path.axes_work[first], PROCESS, path.pass_index[first])
    lead, above = landing(contact, True, normal_lead, clearance)
    positions, axes, segment, pass_index = concatenate([above, lead])
    positions = np.concatenate([positions, path.positions_work])
    before = (len(segment), 0)
    return ToolPath(
        positions,
        np.concatenate([axes, path.axes_work]),
        arc_length(positions),
        np.concatenate([pass_index, path.pass_index]),
        np.concatenate([segment, path.segment]),
        np.pad(path.curvature, before, mode="edge"),
        None if path.force is None else np.pad(path.force, before, mode="edge"),
        None if path.feed is None else np.pad(path.feed, before, mode="edge"),
    )
