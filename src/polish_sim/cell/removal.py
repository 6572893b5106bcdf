"""Preston's law on the pad's pressure: pressure x sliding speed x time at every node (nodes, motion ->
exposure).

The pad is the elastic foundation of ``contact``, with a spring under every node instead of its hundred. Its
depth is measured along the pad's axis and projected on the node's normal: to first order the distance to the
surface, but valid up to the part's edges. Each step's field is scaled so that it carries the exact force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation, Slerp

from polish_sim.arrays import Array, Indices, dots, joined, midpoints, next_corners, norms, running_sums, unit
from polish_sim.cell.contact import RealPart
from polish_sim.cell.real_part import Touch, facing_tool
from polish_sim.geometry import Region, Surface
from polish_sim.geometry.field_lookup import DistanceField, look_up
from polish_sim.kernel_cache import njit
from polish_sim.kernels import dot, kernel, minus, plus_cross, scaled
from polish_sim.log import RunLog, Trace
from polish_sim.planning.ground import Triangulation, triangulate
from polish_sim.planning.points import build_point_grid, cells_between
from polish_sim.planning.toolpath import interpolate

# How the pad moved on the part, and how hard it pressed, in short straight steps (log, trace -> PadMotion).
#
# The force's impulse over each step is the sum over every physics step, so nothing of it depends on the log's
# rate.

STEP = 0.02  # way of the pad in one step, in pad radii
LONGEST_S, SHORTEST_S = 0.05, 0.001  # of a step


class PadMotion(NamedTuple):
    """Steps of the pad in contact, in the work frame of the real part."""

    ends_s: Array  #: When each step ends [s], shape (k,)
    centers: Array  #: Centre of the pad's face in the middle of the step [m], shape (k, 3)
    axes: Array  #: Unit pad axis, from the part to the tool, shape (k, 3)
    velocities: Array  #: Velocity of the centre [m/s], shape (k, 3)
    turning: Array  #: Angular velocity of pad and spindle [rad/s], shape (k, 3)
    times: Array  #: How long each step takes [s], shape (k,)
    impulses: Array  #: Exact contact force along the pad's axis, integrated over the step [N s], shape (k,)


def pad_motion(
    log: RunLog, trace: Trace, part: RealPart, pad_radius: float, part_turns: Array | None = None
) -> PadMotion:
    """Cut a run into steps; those in contact, in order.

    Only the tool's orientation is taken from the log, and the pose at the start from ``part``. ``part_turns``
    (n, 3, 3) is how a part that is carried stands in the base at the log's rows; None: as at the start.
    """
    time = trace.time_s
    force = np.maximum(trace.normal_force_n, 0.0)
    touching = np.flatnonzero(force > 0.0)
    if len(time) < 2 or not len(touching):
        some, none = np.empty((0, 3)), np.empty(0)
        return PadMotion(none, some, some, some, some, none, none)
    # The force of an instant acts until the next one.
    clock = np.append(time, 2.0 * time[-1] - time[-2])
    impulse = running_sums(force * np.diff(clock))
    speeds = trace.tcp_speed_m_s
    if part_turns is not None:
        speeds = norms(np.gradient(trace.tool_on_part_m, time, axis=0))
    marks = _marks(clock[touching[0]], clock[touching[-1] + 1], speeds[touching], pad_radius)
    gained, times = np.diff(np.interp(marks, clock, impulse)), np.diff(marks)
    R_base_part = part.rotation[None] if part_turns is None else part_turns
    faces, turns = _pad_poses(log, trace, part.position, R_base_part, marks)
    centers = midpoints(faces)
    velocities = np.diff(faces, axis=0) / times[:, None]
    outward = -turns.as_matrix()[:, :, 2]
    axes = unit(outward[1:] + outward[:-1])
    spin = np.interp(midpoints(marks), time, trace.spindle_rad_s)
    turning = (turns[1:] * turns[:-1].inv()).as_rotvec() / times[:, None] - spin[:, None] * axes
    columns = (marks[1:], centers, axes, velocities, turning, times, gained)
    return PadMotion(*(np.ascontiguousarray(column[gained > 0.0]) for column in columns))


def _marks(first: float, last: float, speeds: Array, pad_radius: float) -> Array:
    """Ends of steps [s] in which a pad at almost its highest speed moves no further than a share of its
    radius."""
    step = min(STEP * pad_radius / max(np.percentile(speeds, 99.0), 1e-9), LONGEST_S)
    return np.linspace(first, last, math.ceil((last - first) / max(step, SHORTEST_S)) + 1)


def _pad_poses(
    log: RunLog, trace: Trace, origin: Array, R_base_part: Array, marks: Array
) -> tuple[Array, Rotation]:
    """Centre of the pad's face (k, 3) [m] and the tool's turn in the real work frame, at moments (k,) [s]."""
    rows = log["time_s"]
    logged = Rotation.from_quat(log["tcp_quaternion_wxyz"], scalar_first=True)
    R_work_base = _turned(rows, Rotation.from_matrix(R_base_part), marks).inv()
    R_work_tool = R_work_base * _turned(rows, logged, marks)
    tips = trace.tcp_position_m - trace.part_shift_m
    tips = interpolate(marks, trace.time_s, tips)
    travel = np.interp(marks, trace.time_s, trace.pad_travel_m)
    faces = R_work_base.apply(tips - origin) - travel[:, None] * R_work_tool.as_matrix()[:, :, 2]
    return faces, R_work_tool


def _turned(rows: Array, turns: Rotation, moments: Array) -> Rotation:
    """Turns given at some moments [s], (n,), or one for all time, at others, (k,)."""
    if len(turns) == 1:
        return turns
    return Slerp(rows, turns)(np.clip(moments, rows[0], rows[-1]))


# Nodes on the real part under the pad's way, fine enough to sum its pressure up (Region, RealPart -> nodes).
#
# The region is one conforming triangulation; what lies beside it and is pressed all the same is cut into
# small pieces.

EDGE = 0.08  #: Longest edge of the nodes' triangles in pad radii; they lie about 0.6 of it apart
ACROSS_BORDER = 0.5
MOST_NODES = 300_000
REACH = 1.1  #: Surfaces this many pad radii from the path are not under the pad
ROUNDS = 8
ON_SURFACE = 1e-6  # distance at which a node lies on a surface [m]
ALIKE = 0.3  # least cosine between the drawing's normal and the real one for a step along it [-]
EDGE_TURN = 0.9  # further apart than this cosine the real normal is an edge's: the drawing's is taken [-]
ALONG = 0.99  # least cosine between normals of the real part a field's spacing apart, but for edges [-]
_WHOLE = 1.0 - 1e-9


class PressedNodes(NamedTuple):
    """Nodes on the real part, in its own work frame; the region's come first."""

    positions: Array  #: [m], shape (n, 3)
    #: Unit outward normals of the real surface, shape (n, 3); zero: the pad cannot meet this node
    normals: Array
    areas: Array  #: Area each stands for [m^2], shape (n,)


class Nodes(NamedTuple):
    """The region's triangles and all nodes."""

    mesh: Triangulation  #: Of the nominal region; its vertices are the first nodes
    pressed: PressedNodes


def place_nodes(surface: Surface, region: Region, part: RealPart, touch: Touch, edge: float = EDGE) -> Nodes:
    """Spread nodes over the region and whatever else the pad reaches, and put them on the real part.

    They are moved along the drawing's normals. ``edge`` is the longest edge of the region's triangles in pad
    radii.
    """
    area = region.surface.facet_areas.sum()
    longest = max(edge * touch.pad_radius, math.sqrt(4.0 * area / MOST_NODES))
    mesh = triangulate(region.surface, longest)
    beside = surroundings(surface, region, touch, longest)
    own = on_real_part(part.field, mesh.vertices, mesh.normals)
    # The field rounds sharp edges off: its slope turns there, or is the wall's and `_project` keeps the
    # drawing's, or it finds no surface where a cell reaches across an edge. There the node next to it says
    # how the part lies.
    lost = ~own[1].any(axis=1)
    away, _ = cKDTree(mesh.vertices[mesh.border[:, 0]]).query(mesh.vertices)
    near = np.flatnonzero(away < np.where(lost, math.sqrt(3.0), 1.0) * part.field.spacing)
    sure = np.flatnonzero(~lost & (away >= part.field.spacing))
    if len(sure):
        next_to = sure[cKDTree(mesh.vertices[sure]).query(mesh.vertices[near])[1]]
        as_drawn = (own[1][near] == mesh.normals[near]).all(axis=1)
        turned = as_drawn | (dots(own[1][near], own[1][next_to]) < ALONG)
        near, next_to = near[turned], next_to[turned]
        own[0][near] = mesh.vertices[near] + own[0][next_to] - mesh.vertices[next_to]
        own[1][near] = own[1][next_to]
    others = on_real_part(part.field, beside.positions, beside.normals)
    met = np.asarray(others[1].any(axis=1))
    positions, normals = (np.concatenate([a, b[met]]) for a, b in zip(own, others, strict=True))
    return Nodes(
        mesh, PressedNodes(positions, normals, np.concatenate([mesh.vertex_areas, beside.areas[met]]))
    )


def surroundings(surface: Surface, region: Region, touch: Touch, longest: float) -> PressedNodes:
    """Middles of small triangles of the nominal surface outside the region that the pad can reach."""
    tree = cKDTree(touch.positions)
    whole = (
        np.bincount(region.facets, region.surface.facet_areas, len(surface.faces))
        >= _WHOLE * surface.facet_areas
    )
    facets = np.flatnonzero(~whole & facing_tool(surface, touch))
    corners = np.broadcast_to(np.eye(3), (len(facets), 3, 3))
    # Of a facet the region's border cuts a piece is in or out as its middle is: smaller ones are more exact.
    cut = np.isin(np.arange(len(surface.faces)), region.facets)
    limits = np.where(cut, ACROSS_BORDER * longest, longest)
    done: list[tuple[Indices, Array]] = []
    while len(facets):
        places = surface.vertices[surface.faces[facets]]
        points = np.einsum("kca,kad->kcd", corners, places)
        sides = norms(points - next_corners(points))
        away, _ = tree.query(points.mean(axis=1))
        near = away < REACH * touch.pad_radius + sides.max(axis=1)
        small = near & (sides.max(axis=1) <= limits[facets])
        done.append((facets[small], corners[small]))
        rows = np.flatnonzero(near & ~small)
        facets, corners = np.repeat(facets[rows], 2), _halved(corners[rows], sides[rows].argmax(axis=1))
    owners, shares = joined(done or [(np.empty(0, np.int64), np.empty((0, 3, 3)))])
    if not len(owners):
        return PressedNodes(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    areas = surface.facet_areas[owners] * np.abs(np.linalg.det(shares))
    positions, normals = surface.evaluate(owners.astype(np.int32), shares.mean(axis=1))
    outside = np.ones(len(owners), dtype=bool)
    on_cut = cut[owners]
    if on_cut.any():
        closest = region.surface.closest(positions[on_cut]).positions
        outside[on_cut] = norms(closest - positions[on_cut]) > ON_SURFACE
    return PressedNodes(positions[outside], normals[outside], areas[outside])


def _halved(corners: Array, longest: Indices) -> Array:
    """Both halves of triangles cut through the middle of their longest edge, shape (2 k, 3, 3)."""
    turned = np.take_along_axis(corners, ((longest[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
    a, b, c = turned[:, 0], turned[:, 1], turned[:, 2]
    middle = 0.5 * (a + b)
    return np.stack([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)], axis=1).reshape(
        -1, 3, 3
    )


def on_real_part(field: DistanceField, positions: Array, normals: Array) -> tuple[Array, Array]:
    """Move nodes (n, 3) [m] of the drawing along its unit ``normals`` (n, 3) onto the real surface.

    Returns positions [m] and unit normals there, each (n, 3); it is zero where the real surface has none.
    """
    found, slopes = positions.copy(), np.zeros_like(positions)
    _project(field, np.ascontiguousarray(normals), found, slopes)
    return found, slopes


@njit
def _project(field, normals, positions, slopes):  # type: ignore[no-untyped-def]
    """Newton's method along each normal; across it where the surface has turned away, as on a step's wall."""
    nodes = field.bricks.reshape(-1)
    per_metre = 1.0 / field.spacing
    for i in range(len(positions)):
        x, y, z = positions[i]
        nx, ny, nz = normals[i]
        for _ in range(ROUNDS):
            d, gx, gy, gz = look_up(field, nodes, per_metre, x, y, z)
            along = gx * nx + gy * ny + gz * nz
            if along > ALIKE:
                x, y, z = x - d / along * nx, y - d / along * ny, z - d / along * nz
            else:
                x, y, z = x - d * gx, y - d * gy, z - d * gz
        d, gx, gy, gz = look_up(field, nodes, per_metre, x, y, z)
        size = math.sqrt(gx * gx + gy * gy + gz * gz)
        if size > 0.0 and abs(d) < 0.1 * field.spacing and gx * nx + gy * ny + gz * nz > 0.0:
            positions[i, 0], positions[i, 1], positions[i, 2] = x, y, z
            if gx * nx + gy * ny + gz * nz > EDGE_TURN * size:
                nx, ny, nz = gx / size, gy / size, gz / size
            slopes[i, 0], slopes[i, 1], slopes[i, 2] = nx, ny, nz


CELL = 0.35  #: Side of the cells nodes are looked up by, in pad radii
#: Least cosine between a node's normal and the pad's axis for the pad to press on it [-]
REMOVAL_FACING = 0.1
DEEPEST = 0.5  #: How far up its axis a pad finds nodes, in its radii, unless it is pressed in deeper


class Removed(NamedTuple):
    """What a pad did to some nodes."""

    exposure: Array  #: Integral of pressure x sliding speed at each node [N/m], shape (n,)
    gained: Array  #: Exposure summed over all nodes, step by step [N m], shape (k,)
    #: Mean force of the field along the pad's axis before scaling [N], shape (k,); 0: no node touched
    carried: Array


def expose_nodes(
    nodes: PressedNodes,
    motion: PadMotion,
    pad_radius: float,
    stiffness: float,
    slide: float = 0.0,
    deepest: float = 0.0,
) -> Removed:
    """Carry a pad whose whole disc has ``stiffness`` [N/m] over the nodes: what it took off, but for the wear
    coefficient. All of its face also slides at ``slide`` [m/s], to all sides in turn, as on a quick orbit.
    It may be pressed in by as much as ``deepest`` [m].
    """
    grid = build_point_grid(nodes.positions, CELL * pad_radius)
    # Neighbours in space are neighbours in memory.
    order = grid.items
    sorted_nodes = PressedNodes(*(np.ascontiguousarray(column[order]) for column in nodes))
    bedding, up = stiffness / (math.pi * pad_radius**2), max(deepest, DEEPEST * pad_radius)
    found = _carry(sorted_nodes, motion, grid, pad_radius, up, bedding, slide)
    exposure = np.empty(len(order))
    exposure[order] = found[0]
    return Removed(exposure, found[1], found[2])


@njit
def _carry(nodes, motion, grid, radius, up, bedding, slide):  # type: ignore[no-untyped-def]
    steps = len(motion.times)
    exposure, gained, carried = np.zeros(len(nodes.areas)), np.zeros(steps), np.zeros(steps)
    under, force, power = _room_for(nodes)
    for k in range(steps):
        number = _find_near(nodes, motion.centers[k], motion.axes[k], grid, radius, up, under)
        _press_nodes(
            nodes, motion.centers[k], motion.axes[k], motion.velocities[k], motion.turning[k], bedding, slide,
            under, number, force, power,
        )  # fmt: skip
        total = 0.0
        for t in range(number):
            total += force[t]
        carried[k] = total
        if total > 0.0:
            for t in range(number):
                work = power[t] * motion.impulses[k] / total
                gained[k] += work
                exposure[under[t]] += work / nodes.areas[under[t]]
    return exposure, gained, carried


@kernel
def _room_for(nodes):  # type: ignore[no-untyped-def]
    """For the numbers of the nodes under a pad, and force and power of each."""
    count = len(nodes.areas)
    return np.empty(count, np.int64), np.empty(count), np.empty(count)


@kernel
def _find_near(nodes, center, axis, grid, radius, up, under):  # type: ignore[no-untyped-def]
    """List the nodes over the face of a pad at ``center`` that look at it, a way ``up`` its axis; returns how
    many are listed."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for d in range(3):
        # A disc's half width, and the way up.
        reach = radius * math.sqrt(max(1.0 - axis[d] * axis[d], 0.0)) + up * abs(axis[d])
        low[d], high[d] = cells_between(grid, d, center[d] - reach, center[d] + reach)
    number = 0
    c, a = scaled(1.0, center), scaled(1.0, axis)  # values: loaded once, not at every node
    if low[2] < high[2]:
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                row = (i * grid.size[1] + j) * grid.size[2]
                for q in range(grid.first[row + low[2]], grid.first[row + high[2]]):
                    r = minus(nodes.positions[q], c)
                    height = dot(r, a)
                    near = dot(r, r) - height * height < radius * radius
                    under[number] = q
                    number += int(height > 0.0 and near and dot(nodes.normals[q], a) > REMOVAL_FACING)
    return number


@kernel
def _press_nodes(  # type: ignore[no-untyped-def]
    nodes, center, axis, velocity, turning, bedding, slide, under, number, force, power
):
    """Force on each node along the pad's axis [N], and force along the part's normal x sliding speed [W]."""
    for t in range(number):
        q = under[t]
        n = nodes.normals[q]
        r = minus(nodes.positions[q], center)
        height, facing = dot(r, axis), dot(n, axis)
        # The spring under the node, at the pad's face: as deep as the part is thick there, across its
        # surface; its share of the disc is the node's shadow.
        push = bedding * height * facing * nodes.areas[q] * facing
        v = plus_cross(velocity, turning, minus(r, scaled(height, axis)))
        v = minus(v, scaled(dot(v, n), n))
        force[t] = push * facing
        power[t] = push * math.sqrt(dot(v, v) + slide * slide)
