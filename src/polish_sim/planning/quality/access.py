"""The part of a region that the tool reaches without a collision with the part, upright or leaned away from
what stands beside it (Region, Tool -> Access)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    dots,
    into_plane,
    norms,
    plane_axes,
    some_rows,
    summed,
    unit,
)
from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import Region, Surface
from polish_sim.geometry.regions.region import cut_region
from polish_sim.planning.ground import Ground, Triangulation
from polish_sim.planning.points import thin
from polish_sim.planning.quality.areas import AskedRegion
from polish_sim.planning.quality.coverage import pad_depths
from polish_sim.planning.quality.located import UnderPad, ground_under
from polish_sim.planning.quality.tool_room import (
    FIXTURE,
    Places,
    Tool,
    hollow_radius,
    most_hollow,
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
class Leaning:
    """How the tool leans on a region."""

    mesh: Triangulation
    leans: Array  #: At its vertices, along the surface, shape (v, 3)

    @property
    def note(self) -> str:
        """How far it leans."""
        steepest = np.degrees(np.arctan(norms(self.leans).max()))
        return f"by up to {steepest:.3g} deg away from what stands beside it"

    def lean(self, points: Array, axes: Array) -> Array:
        """Unit axes (n, 3) at points (n, 3) [m], leaned."""
        away, index = self.mesh.tree.query(points, k=AROUND)
        same_side = dots(self.mesh.normals[index], axes[:, None]) > 0.0
        weights = same_side * (1.0 - away / away[:, -1:]) ** 2
        mean = (weights[:, :, None] * self.leans[index]).sum(axis=1)
        mean /= np.maximum(weights.sum(axis=1), 1e-300)[:, None]
        return unit(axes + mean - axes * (mean * axes).sum(axis=1, keepdims=True))


@dataclass(frozen=True, eq=False)
class Access:
    """The part of a region that the tool reaches."""

    region: Region  #: Where the path may run
    asked: AskedRegion  #: What of the ground asked for the pad cannot touch, and why
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

    straight = at

    def places(self, points: Array) -> tuple[Places, UnderPad]:
        """The tool pressed on at points (n, 3), and the surface under it."""
        foot = self.surface.closest(points)
        under = ground_under(self.surface, foot)
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
    _refuse_nothing(reach, ground, tool)
    relaxed = min(TURN_INSIDE * plan.stepover_m, 0.5 * radius)
    leaning = reach.leaning
    wanted = replace(room, surface=region.surface, shift=radius + relaxed, leaning=leaning)
    cut = cut_region(region, wanted, radius)
    gained = reach.area(ground) - upright.area(ground)
    reasons = (*(too_near(*pair) for pair in tool.pairs), HOLLOW)
    why = np.where(reach.hollow, len(tool.pairs), reach.rooms.argmin(axis=1))
    why[reach.touched >= 0.5] = -1
    missed = ground.region.area_m2 - reach.area(ground)
    return Access(cut or region, AskedRegion(ground, reasons, why, reach.touched, missed), leaning, gained)


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
        return ground.region.area_m2 * np.average(self.touched, weights=ground.part_areas)


def _reach(ground: Ground, room: ToolRoom, near: Bools) -> _Reach:
    """What the tool reaches; away from the vertices ``near`` (v,) it has room."""
    radius, mesh = room.tool.pad.radius_m, ground.mesh
    rooms = np.full((len(near), len(room.tool.pairs)), BEYOND * radius)
    some = thin(mesh.vertices[near], FINE * radius)
    places, under = room.places(mesh.vertices[near][some.kept])
    rooms[near] = room.of_bodies(places)[some.stands_for]
    under = some_rows(under, some.stands_for)
    hollow = np.zeros(len(near), dtype=bool)
    hollow[near] = under.curvatures[:, 1] * hollow_radius(room.tool.pad) < -1.0
    least = rooms.min(axis=1)
    leans = np.zeros_like(mesh.vertices) if room.leaning is None else room.leaning.leans
    leaned = norms(leans) > 0.0
    touched = _touched(ground, np.where(leaned, -radius, least), radius)
    rows = np.flatnonzero((leaned & (least >= 0.0))[near])
    if len(rows):
        at = np.flatnonzero(near)[rows]
        touched[pressed_from(mesh, at, leans[at], some_rows(under, rows), room.tool)] = 1.0
    return _Reach(rooms, hollow, np.where(hollow & (least < 0.0), 0.0, touched), room.leaning)


def _leant(ground: Ground, room: ToolRoom, near: Bools, upright: _Reach) -> _Reach:
    """What the tool reaches if it may lean; the same as upright where that is no more."""
    rows = np.flatnonzero(near)
    _, under = room.places(ground.mesh.vertices[rows])
    leaning = find_leaning(room, ground.mesh, rows, under, upright.rooms[rows])
    if leaning is None:
        return upright
    leaned = norms(leaning.leans) > 0.0
    reach = _reach(ground, replace(room, leaning=leaning), near | leaned)
    return reach if reach.area(ground) > upright.area(ground) else upright


def _refuse_nothing(reach: _Reach, ground: Ground, tool: Tool) -> None:
    """Refuse a region on which the tool has room nowhere."""
    least = reach.least
    if least.max() >= 0.0:
        return
    best = least.argmax()
    diameter = 2e3 * tool.pad.radius_m
    place = place_in_mm(ground.mesh.vertices[best])
    body, beside = tool.pairs[reach.rooms[best].argmin()]
    why = (
        f"even at {place} it is hollow of less than {1e3 * hollow_radius(tool.pad):.3g} mm radius, which a "
        f"pad of {diameter:.3g} mm does not follow"
        if reach.hollow[best]
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
    # A vertex stands for what is half the way to the next ones.
    wide = np.sqrt(np.maximum(ground.mesh.vertex_areas, 1e-300))
    away, near = np.zeros(len(vertices)), cKDTree(np.concatenate([vertices[roomy], border]))
    away[~roomy] = near.query(vertices[~roomy], distance_upper_bound=radius + wide.max())[0]
    return np.clip(0.5 + (radius - away) / wide, 0.0, 1.0)


# A lean is a vector along the surface, the tangent of the angle long, the way the tool's upper end goes. It
# is found where spindle, sensor or wrist have no room and the pad has, and fades from there, so that the axis
# turns gradually. A leaned pad presses with the side it leans to: its rim goes as deep as on the most hollow
# ground, no deeper.

SLOPES = 6  #: Leans up to the largest that are tried; the least with room is taken
LEANED_APART = 0.25  #: Spacing of the places at which they are tried [pad radii]
FADES = 2.0  #: Length over which a lean fades [pad radii], no less than `SHORTEST_M`
SHORTEST_M = 0.03
STEP = 0.1  #: Distance at which more room is looked for [pad radii]
AROUND = 16  #: Nearest vertices a lean is averaged over, weighted by distance


def find_leaning(
    room: ToolRoom, mesh: Triangulation, rows: Indices, under: UnderPad, rooms: Array
) -> Leaning | None:
    """Lean the tool where it lacks room and its pad does not; None if in vain.

    Looked at are vertices ``rows`` (k,) over ``under``; ``rooms`` (k, pairs) [m] are those along the normals.
    """
    tool = room.tool
    pads = np.array([body == "pad" for body, _ in tool.pairs])
    short = np.flatnonzero((rooms.min(axis=1) < 0.0) & (rooms[:, pads].min(axis=1) >= 0.0))
    if not len(short):
        return None
    short = short[thin(mesh.vertices[rows[short]], LEANED_APART * tool.pad.radius_m).kept]
    steepest = np.tan(np.arcsin(most_hollow(tool.pad) / tool.pad.radius_m))
    rows, under = rows[short], some_rows(under, short)
    away = _away(room, pressed_places(mesh.vertices[rows], under.normals, under, tool.pad, tool.force))
    needed = np.zeros(len(rows))
    for slope in np.linspace(0.0, steepest, SLOPES + 1)[1:]:
        waiting = np.flatnonzero(needed == 0.0)
        ground = some_rows(under, waiting)
        axes = unit(ground.normals + slope * away[waiting])
        tried = pressed_places(mesh.vertices[rows[waiting]], axes, ground, tool.pad, tool.force)
        needed[waiting[room.of_bodies(tried).min(axis=1) >= 0.0]] = slope
    found = needed > 0.0
    if not found.any():
        return None
    return Leaning(mesh, _faded(mesh, rows[found], needed[found], away[found], tool, steepest))


def _away(room: ToolRoom, places: Places) -> Array:
    """The way along the surface in which what is short of room gets more of it, unit vectors, shape (k,
    3)."""
    step = STEP * room.tool.pad.radius_m
    slope = np.zeros_like(places.axes)
    for way in plane_axes(places.axes):
        ahead, behind = (
            room.of_bodies(places._replace(middles=places.middles + sign * step * way)).min(axis=1)
            for sign in (1.0, -1.0)
        )
        slope += (ahead - behind)[:, None] * way
    return unit(slope)


def _faded(
    mesh: Triangulation, rows: Indices, slopes: Array, away: Array, tool: Tool, steepest: float
) -> Array:
    """Leans of all vertices: those needed, and around them ever less, (v, 3)."""
    reach = max(FADES * tool.pad.radius_m, SHORTEST_M)
    near = cKDTree(mesh.vertices[rows])
    pairs = near.sparse_distance_matrix(mesh.tree, reach, output_type="coo_matrix")
    weights = slopes[pairs.row] - steepest * pairs.data / reach
    kept = weights > 0.0
    row, column, weights = pairs.row[kept], pairs.col[kept], weights[kept]
    longest = np.zeros(len(mesh.vertices))
    np.maximum.at(longest, column, weights)
    total = np.bincount(column, weights, len(mesh.vertices))
    mean = summed(column, weights[:, None] * away[row], len(total)) / np.maximum(total, 1e-300)[:, None]
    return longest[:, None] * into_plane(mean, mesh.normals)


def pressed_from(mesh: Triangulation, rows: Indices, leans: Array, under: UnderPad, tool: Tool) -> Indices:
    """Vertices the leaned pad presses on from vertices ``rows`` (k,), leans (k, 3): the side it leans to."""
    kept = thin(mesh.vertices[rows], LEANED_APART * tool.pad.radius_m).kept
    rows, leans, under = rows[kept], leans[kept], some_rows(under, kept)
    depths = pad_depths(under.curvatures, tool.pad, tool.force, under.slopes(leans))
    found = [np.empty(0, dtype=np.int64)]
    for row, lean, depth, near in zip(
        rows, leans, depths, mesh.tree.query_ball_point(mesh.vertices[rows], tool.pad.radius_m), strict=True
    ):
        near = np.array(near)
        found.append(near[depth + (mesh.vertices[near] - mesh.vertices[row]) @ lean > 0.0])
    return np.unique(np.concatenate(found))
