"""The part of a region that the tool reaches without a collision with the part (Region, Tool -> Access)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, norms
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import Region, Surface
from polish_sim.geometry.regions.region import cut_region
from polish_sim.planning.ground.ground import Ground
from polish_sim.planning.ground.points import thin
from polish_sim.planning.quality.leaning import Leaning, find_leaning, pressed_from
from polish_sim.planning.quality.tool_room import (
    FIXTURE,
    Places,
    Tool,
    UnderPad,
    ground_under,
    hollow_radius,
    pressed_places,
)

BEYOND = 0.5  #: Largest room that is measured [pad radii]
SCOUTED_APART = 0.25  #: Spacing of the places checked first [pad radii]; all only where room is little
LITTLE = 0.4  #: Little room, in pad radii
FINE = 0.02  #: There, vertices closer than this [pad radii] are checked once
TURN_INSIDE = 0.45
"""Least distance of the outermost turn from the region's border [step-overs]: the border may be that much
nearer to a wall than the pad."""
HOLLOW = "too hollow for the pad"
TRIM, TILT = "trim", "tilt"
AVOID = (TRIM, TILT)


@dataclass(frozen=True, eq=False)
class Access:
    """The part of a region that the tool reaches."""

    region: Region  #: Where the path may run
    touched: Array  #: Share of each vertex's area on the ground asked for that the pad can touch, shape (v,)
    reasons: tuple[str, ...]
    why: Indices  #: Number of the reason why it cannot touch a vertex, -1 where it can, shape (v,)
    left_out_m2: float  #: Area of what it cannot touch [m^2]
    leaning: Leaning | None = None  #: How the tool leans away from what stands beside it; None: not at all
    gained_m2: float = 0.0  #: How much more it touches for that [m^2]


@dataclass(frozen=True, eq=False)
class ToolRoom:
    """How much room the tool has on a surface, as what `cut_region` cuts by."""

    surface: Surface
    part: Surface
    tool: Tool
    clearance: float  #: [m]
    shift: float  #: Added to the room [m]
    leaning: Leaning | None = None  #: How the tool leans; None: it stands along the normal
    length: float = 0.0  #: Of the line where it is used up, not known

    def at(self, points: Array) -> Array:
        """Room at points (n, 3) of the surface [m], shape (n,)."""
        return self.of_bodies(self.places(points)[0]).min(axis=1) + self.shift

    def straight(self, points: Array) -> Array:
        """The same."""
        return self.at(points)

    def places(self, points: Array) -> tuple[Places, UnderPad]:
        """The tool pressed on at points (n, 3), and the surface under it."""
        foot = self.surface.closest(points)
        under = ground_under(self.surface, foot.facets, foot.barycentric)
        axes = under.normals if self.leaning is None else self.leaning.lean(points, under.normals)
        return pressed_places(points, axes, under, self.tool.pad, self.tool.force), under

    def of_bodies(self, places: Places) -> Array:
        """Room of each body of the tool beside part and fixture [m], shape (n, pairs)."""
        return self.tool.rooms(self.part, places, self.clearance, BEYOND * self.tool.pad.radius_m)


def find_access(ground: Ground, region: Region, part: Surface, tool: Tool, plan: PlanConfig) -> Access | None:
    """Find the part of a region that the tool reaches; None if it reaches all of it.

    Where its middle may go it keeps a clearance from what stands beside it, pressed in as far as the pad
    yields; what the pad touches from there is within reach. ``ground`` is the region asked for, prepared,
    ``region`` the same as it was selected.

    Raises:
        PlanError: It is nothing.
    """
    radius, vertices = tool.pad.radius_m, ground.mesh.vertices
    room = ToolRoom(ground.region.surface, part, tool, plan.tool_clearance_m, 0.0)
    some = thin(vertices, SCOUTED_APART * radius)
    near = (room.at(vertices[some.kept]) < LITTLE * radius)[some.stands_for]
    if not near.any():
        return None
    reach = _reach(ground, room, near)
    if reach.least.min() >= 0.0:
        return None
    upright = reach
    if plan.avoid == TILT:
        reach = _leant(ground, room, near, upright)
    _refuse_nothing(reach.least, reach.rooms, reach.hollow, ground, tool)
    relaxed = min(TURN_INSIDE * plan.stepover_m, 0.5 * radius)
    leaning = reach.leaning
    wanted = replace(room, surface=region.surface, shift=radius + relaxed, leaning=leaning)
    cut = cut_region(region, wanted, radius)
    gained = reach.area(ground) - upright.area(ground)
    reasons = (*(too_near(*pair) for pair in tool.pairs), HOLLOW)
    why = np.where(reach.hollow, len(tool.pairs), reach.rooms.argmin(axis=1))
    why[reach.touched >= 0.5] = -1
    missed = ground.mesh.part_areas(ground.part_facets).sum() - reach.area(ground)
    return Access(cut or region, reach.touched, reasons, why, missed, leaning, gained)


def too_near(body: str, beside: str) -> str:
    """The reason of what a body of the tool has no room for."""
    return f"{body} too near the {beside}"


class _Reach(NamedTuple):
    """What the tool reaches from the vertices of a ground."""

    rooms: Array  #: Of each body [m], shape (v, pairs)
    hollow: Bools  #: (v,)
    touched: Array  #: Share of each vertex's area, shape (v,)
    leaning: Leaning | None

    @property
    def least(self) -> Array:
        """Room of the tool [m], shape (v,)."""
        return self.rooms.min(axis=1)

    def area(self, ground: Ground) -> float:
        """What it touches [m^2]."""
        return float((ground.mesh.part_areas(ground.part_facets) * self.touched).sum())


def _reach(ground: Ground, room: ToolRoom, near: Bools) -> _Reach:
    """What the tool reaches; away from the vertices ``near`` (v,) it has room."""
    radius, mesh = room.tool.pad.radius_m, ground.mesh
    rooms = np.full((len(near), len(room.tool.pairs)), BEYOND * radius)
    some = thin(mesh.vertices[near], FINE * radius)
    places, under = room.places(mesh.vertices[near][some.kept])
    rooms[near] = room.of_bodies(places)[some.stands_for]
    under = UnderPad(*(column[some.stands_for] for column in under))
    hollow = np.zeros(len(near), dtype=bool)
    hollow[near] = under.curvatures[:, 1] * hollow_radius(room.tool.pad) < -1.0
    least = rooms.min(axis=1)
    leans = np.zeros_like(mesh.vertices) if room.leaning is None else room.leaning.leans
    leaned = norms(leans) > 0.0
    touched = _touched(ground, np.where(leaned, -radius, least), radius)
    rows = np.flatnonzero((leaned & (least >= 0.0))[near])
    if len(rows):
        at = np.flatnonzero(near)[rows]
        touched[
            pressed_from(mesh, at, leans[at], UnderPad(*(column[rows] for column in under)), room.tool)
        ] = 1.0
    return _Reach(rooms, hollow, np.where(hollow & (least < 0.0), 0.0, touched), room.leaning)


def _leant(ground: Ground, room: ToolRoom, near: Bools, upright: _Reach) -> _Reach:
    """What the tool reaches if it may lean; the same as upright where that is no more."""
    rows = np.flatnonzero(near)
    _, under = room.places(ground.mesh.vertices[rows])
    leaning = find_leaning(room, ground.mesh, rows, under, upright.rooms[rows], room.tool)
    if leaning is None:
        return upright
    leaned = norms(leaning.leans) > 0.0
    reach = _reach(ground, replace(room, leaning=leaning), near | leaned)
    return reach if reach.area(ground) > upright.area(ground) else upright


def _refuse_nothing(least: Array, rooms: Array, hollow: Bools, ground: Ground, tool: Tool) -> None:
    """Refuse a region on which the tool has room nowhere."""
    if least.max() >= 0.0:
        return
    best = int(least.argmax())
    diameter = 2e3 * tool.pad.radius_m
    place = place_in_mm(ground.mesh.vertices[best])
    body, beside = tool.pairs[int(rooms[best].argmin())]
    why = (
        f"even at {place} it is hollow of less than {1e3 * hollow_radius(tool.pad):.3g} mm radius, which a "
        f"pad of {diameter:.3g} mm does not follow"
        if hollow[best]
        else f"where it has most room, at {place}, its {body} would still come {-1e3 * least[best]:.3g} mm "
        f"too close to the {beside} beside it (pad {diameter:.3g} mm)"
    )
    frame = " Is --fixture in the part's own frame and unit?" if beside == FIXTURE else ""
    raise PlanError(
        f"the tool reaches no place of the region: {why}. Set a smaller --pad-diameter or another "
        f"--region.{frame}"
    )


def _touched(ground: Ground, least: Array, radius: float) -> Array:
    """Share of each vertex' ground the pad touches from where its middle has room: what is within a radius,
    (v,)."""
    vertices, edges = ground.mesh.vertices, ground.mesh.edges
    roomy = least >= 0.0
    crossed = edges[roomy[edges[:, 0]] != roomy[edges[:, 1]]]
    ends = least[crossed]
    share = (ends[:, 0] / (ends[:, 0] - ends[:, 1]))[:, None]
    border = (1.0 - share) * vertices[crossed[:, 0]] + share * vertices[crossed[:, 1]]
    away = np.zeros(len(vertices))
    away[~roomy] = cKDTree(np.concatenate([vertices[roomy], border])).query(vertices[~roomy])[0]
    # A vertex stands for what is half the way to the next ones.
    wide = np.sqrt(np.maximum(ground.mesh.vertex_areas, 1e-300))
    return np.clip(0.5 + (radius - away) / wide, 0.0, 1.0)
