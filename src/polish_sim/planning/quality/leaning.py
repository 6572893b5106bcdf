"""How the tool leans away from what stands beside it (room along the normals -> a lean for every place).

A lean is a vector along the surface, the tangent of the angle long, the way the tool's upper end goes. It is
found where spindle, sensor or wrist have no room and the pad has, and fades from there, so that the axis
turns gradually.

A leaned pad presses with the side it leans to: its rim goes as deep as on the most hollow ground, no deeper.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, dots, norms
from polish_sim.planning.ground.points import thin
from polish_sim.planning.ground.triangulation import Triangulation
from polish_sim.planning.quality.coverage import pad_depths
from polish_sim.planning.quality.tool_room import Places, Tool, UnderPad, most_hollow, pressed_places
from polish_sim.spatial import perpendicular, unit

SLOPES = 6  #: Leans up to the largest that are tried; the least with room is taken
LEANED_APART = 0.25  #: Spacing of the places at which they are tried [pad radii]
FADES = 2.0  #: Length over which a lean fades [pad radii], no less than `SHORTEST_M`
SHORTEST_M = 0.03
STEP = 0.1  #: Distance at which more room is looked for [pad radii]
AROUND = 16  #: Nearest vertices a lean is averaged over, weighted by distance


class RoomOf(Protocol):
    """How much room the tool's bodies have at places."""

    def of_bodies(self, places: Places) -> Array:
        """Room of each body [m], shape (n, pairs)."""
        ...


@dataclass(frozen=True, eq=False)
class Leaning:
    """How the tool leans on a region."""

    mesh: Triangulation
    leans: Array  #: At its vertices, along the surface, shape (v, 3)

    @property
    def note(self) -> str:
        """How far it leans."""
        slope = norms(self.leans).max()
        return f"by up to {np.degrees(np.arctan(slope)):.3g} deg away from what stands beside it"

    def lean(self, points: Array, axes: Array) -> Array:
        """Unit axes (n, 3) at points (n, 3) [m], leaned."""
        away, index = self.mesh.tree.query(points, k=AROUND)
        same_side = dots(self.mesh.normals[index], axes[:, None]) > 0.0
        weights = same_side * (1.0 - away / away[:, -1:]) ** 2
        mean = (weights[:, :, None] * self.leans[index]).sum(axis=1)
        mean /= np.maximum(weights.sum(axis=1), 1e-300)[:, None]
        return unit(axes + mean - axes * (mean * axes).sum(axis=1, keepdims=True))


def find_leaning(
    room: RoomOf, mesh: Triangulation, rows: Indices, under: UnderPad, rooms: Array, tool: Tool
) -> Leaning | None:
    """Lean the tool where it lacks room and its pad does not; None if in vain.

    Looked at are vertices ``rows`` (k,) over ``under``; ``rooms`` (k, pairs) [m] are those along the normals.
    """
    pads = np.array([body == "pad" for body, _ in tool.pairs])
    short = np.flatnonzero((rooms.min(axis=1) < 0.0) & (rooms[:, pads].min(axis=1) >= 0.0))
    if not len(short):
        return None
    short = short[thin(mesh.vertices[rows[short]], LEANED_APART * tool.pad.radius_m).kept]
    steepest = np.tan(np.arcsin(most_hollow(tool.pad) / tool.pad.radius_m))
    rows, under = rows[short], _of(under, short)
    away = _away(room, pressed_places(mesh.vertices[rows], under.normals, under, tool.pad, tool.force), tool)
    needed = np.zeros(len(rows))
    for slope in np.linspace(0.0, steepest, SLOPES + 1)[1:]:
        waiting = np.flatnonzero(needed == 0.0)
        ground = _of(under, waiting)
        axes = unit(ground.normals + slope * away[waiting])
        tried = pressed_places(mesh.vertices[rows[waiting]], axes, ground, tool.pad, tool.force)
        needed[waiting[room.of_bodies(tried).min(axis=1) >= 0.0]] = slope
    found = needed > 0.0
    if not found.any():
        return None
    return Leaning(mesh, _faded(mesh, rows[found], needed[found], away[found], tool, steepest))


def _of(under: UnderPad, rows: Indices) -> UnderPad:
    return UnderPad(*(column[rows] for column in under))


def _away(room: RoomOf, places: Places, tool: Tool) -> Array:
    """The way along the surface in which what is short of room gets more of it, unit vectors, shape (k,
    3)."""
    ways = perpendicular(places.axes)
    step = STEP * tool.pad.radius_m
    slope = np.zeros_like(places.axes)
    for way in (ways, np.cross(places.axes, ways)):
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
    mean = (
        np.stack([np.bincount(column, weights * away[row, k], len(mesh.vertices)) for k in range(3)], axis=1)
        / np.maximum(np.bincount(column, weights, len(mesh.vertices)), 1e-300)[:, None]
    )
    mean -= mesh.normals * (mean * mesh.normals).sum(axis=1, keepdims=True)
    return longest[:, None] * mean


def pressed_from(mesh: Triangulation, rows: Indices, leans: Array, under: UnderPad, tool: Tool) -> Indices:
    """Vertices the leaned pad presses on from vertices ``rows`` (k,), leans (k, 3): the side it leans to."""
    kept = thin(mesh.vertices[rows], LEANED_APART * tool.pad.radius_m).kept
    rows, leans, under = rows[kept], leans[kept], _of(under, kept)
    tilts = np.stack(
        [dots(leans, way) for way in (under.principal, np.cross(under.normals, under.principal))]
    )
    depths = pad_depths(under.curvatures, tool.pad, tool.force, tilts.T)
    found = [np.empty(0, dtype=np.int64)]
    for row, lean, depth, near in zip(
        rows, leans, depths, mesh.tree.query_ball_point(mesh.vertices[rows], tool.pad.radius_m), strict=True
    ):
        near = np.array(near)
        found.append(near[depth + (mesh.vertices[near] - mesh.vertices[row]) @ lean > 0.0])
    return np.unique(np.concatenate(found))
