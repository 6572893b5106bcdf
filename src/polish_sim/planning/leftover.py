"""What the turns leave uncovered in the middle and at necks, and the lines that finish it (runs -> runs)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from polish_sim.planning.coverage import STRICT
from polish_sim.planning.curve import Curve, unit
from polish_sim.planning.quality import count_self_crossings
from polish_sim.planning.run import Run, dense, join
from polish_sim.planning.toolpath import arc_length
from polish_sim.planning.triangulation import Triangulation
from polish_sim.planning.turns import Turn, distance_to

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

WORTH_A_LINK = 0.1
"""Smallest uncovered area a run is led into, in squared step-overs."""
WORTH_A_LIFT = 1.0
"""Smallest uncovered area the tool is lifted for, in squared step-overs."""
LONGEST_LINK = 12.0
"""Longest way from a run's end into an uncovered place, in step-overs."""
CLEAR = 0.2
"""How near a link may pass other turns, in step-overs."""
DEEP = 0.8
"""A line through the middle of a place ends where the nearest turn comes this much closer."""
MOST_LINES = 64


def finish_middle(mesh: Triangulation, runs: Sequence[Run], stepover: float) -> list[Run]:
    """Lead runs through what they left uncovered, along its middle; lift only where no run ends nearby.

    Args:
        mesh: The region.
        runs: Lines that cover most of it.
        stepover: [m].

    Returns:
        The runs, some longer, and new ones at the end.
    """
    out = list(runs)
    distance = np.full(len(mesh.vertices), np.inf)
    for run in runs:
        distance = np.minimum(distance, _distance(mesh, run, stepover))
    tried = np.zeros(len(mesh.vertices), dtype=bool)
    at_border = np.zeros(len(mesh.vertices), dtype=bool)
    at_border[mesh.border] = True
    for _ in range(MOST_LINES):
        open_places = (distance > STRICT * stepover) & ~tried
        place, area = _largest_place(mesh, open_places)
        if area < WORTH_A_LINK * stepover**2:
            break
        tried |= place
        if area < WORTH_A_LIFT * stepover**2 and at_border[place].any():
            continue
        line = _middle_line(mesh, place, distance, stepover)
        owner, added = _lead_into(mesh, out, line, stepover)
        if owner >= 0:
            out[owner] = join(out[owner], Run(added, np.full(len(added), out[owner].pass_index[-1])))
        elif area > WORTH_A_LIFT * stepover**2 and len(line) > 1:
            added = line
            out.append(Run(line, np.zeros(len(line), dtype=np.int64)))
        else:
            continue
        distance = np.minimum(distance, _distance(mesh, Run(added, np.zeros(len(added), dtype=np.int64)), stepover))
        tried &= ~place | (distance < STRICT * stepover)
    return out


def middle_ends(mesh: Triangulation, turn: Turn, stepover: float) -> Array:
    """Both ends of what an innermost turn will leave uncovered in its middle [m], shape (2, 3), or (0, 3)."""
    distance = distance_to(mesh, turn.inside, [turn.curve], 4.0 * stepover)
    place, area = _largest_place(mesh, distance > STRICT * stepover)
    if area < WORTH_A_LINK * stepover**2:
        return np.empty((0, 3))
    return _middle_line(mesh, place, distance, stepover)[[0, -1]]


def _distance(mesh: Triangulation, run: Run, stepover: float) -> Array:
    """Distance of every vertex to a line on its side of the part, inf beyond four step-overs, shape (n,)."""
    points = dense(run.positions, 0.1 * stepover)
    found, _ = cKDTree(points).query(mesh.vertices, distance_upper_bound=4.0 * stepover)
    return np.asarray(found)


def _largest_place(mesh: Triangulation, open_places: Mask) -> tuple[Mask, float]:
    """The connected piece of largest area, and that area [m^2]."""
    if not open_places.any():
        return open_places, 0.0
    _, labels = mesh.components(open_places)
    areas = np.bincount(labels[open_places], weights=mesh.vertex_areas[open_places])
    return labels == areas.argmax(), float(areas.max())


def _middle_line(mesh: Triangulation, place: Mask, distance: Array, stepover: float) -> Array:
    """Longest way through a place along the line furthest from everything covered, (n, 3); a point if compact."""
    rows = np.flatnonzero(place)
    number = np.full(len(place), -1)
    number[rows] = np.arange(len(rows))
    edges = number[mesh.edges[place[mesh.edges].all(axis=1)]]
    depth = np.minimum(distance[rows], 4.0 * stepover)
    points = mesh.vertices[rows]
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    cost = length * (depth.max() / np.minimum(depth[edges[:, 0]], depth[edges[:, 1]])) ** 4
    graph = coo_array((cost, (edges[:, 0], edges[:, 1])), shape=(len(rows), len(rows))).tocsr()
    deepest = int(depth.argmax())
    first = int(_finite(dijkstra(graph, directed=False, indices=deepest)).argmax())
    way, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    here, line = int(_finite(way).argmax()), []
    while here >= 0:
        line.append(here)
        here = int(before[here])
    # Its ends run into corners, where there is little left to cover.
    deep = np.flatnonzero(depth[line] > DEEP * depth[line].max())
    ordered = points[line[deep[0] : deep[-1] + 1]]
    if np.linalg.norm(np.ptp(ordered, axis=0)) < stepover:
        return points[deepest][None]
    even = dense(ordered, 0.1 * stepover)
    window = min(21, len(even) // 2 * 2 - 1)
    return np.asarray(uniform_filter1d(even, window, axis=0, mode="nearest"))


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, -1.0)


def _lead_into(mesh: Triangulation, runs: Sequence[Run], line: Array, stepover: float) -> tuple[int, Array]:
    """The run that can go on into a line without crossing anything, and the points it adds; -1 if none can."""
    everything = [dense(run.positions, 0.1 * stepover) for run in runs]
    offers: list[tuple[float, int, Array]] = []
    for number, points in enumerate(everything):
        heading = unit((points[-1] - points[-min(10, len(points))])[None])[0]
        for way, detour in _ways(line, points[-1]):
            link = way[0] - points[-1]
            length = float(np.linalg.norm(link)) + detour
            price = length * (1.5 - 0.5 * float(link @ heading) / max(length, 1e-12))
            if price < LONGEST_LINK * stepover:
                offers.append((price, number, way))
    for _, number, way in sorted(offers, key=lambda offer: offer[0]):
        others = [points for k, points in enumerate(everything) if k != number]
        others.append(everything[number][:-15])
        if _is_clear(cKDTree(np.concatenate(others)), everything[number][-1], way, stepover):
            longer = np.concatenate([everything[number], way])
            if _crossings(mesh, longer) <= _crossings(mesh, everything[number]):
                return number, way
    return -1, line


def _ways(line: Array, start: Array) -> list[tuple[Array, float]]:
    """Ways to follow a line: from either end, or from its nearest point to the further end; with a handicap [m]."""
    nearest = int(np.linalg.norm(line - start, axis=1).argmin())
    ahead, back = line[nearest:], line[nearest::-1]
    part = ahead if len(ahead) > len(back) else back
    missed = float(arc_length(line)[-1] - arc_length(part)[-1])
    return [(line, 0.0), (line[::-1], 0.0), (part, 2.0 * missed)]


def _crossings(mesh: Triangulation, points: Array) -> int:
    normals = mesh.normals[mesh.tree.query(points)[1]]
    return count_self_crossings([Curve(points, normals, False)])


def _is_clear(tree: cKDTree, start: Array, way: Array, stepover: float) -> bool:
    """Whether the straight way to a line and the line keep clear of all turns, but for the first steps."""
    along = dense(np.concatenate([start[None], way]), 0.1 * stepover)
    return bool((tree.query(along[min(4, len(along) - 1) :])[0] > CLEAR * stepover).all())
