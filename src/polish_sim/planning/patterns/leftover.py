"""What the turns leave uncovered in the middle and at necks, and the lines that finish it (runs -> runs)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, diagonal_of, joined, norms, unit
from polish_sim.planning.ground import Triangulation
from polish_sim.planning.patterns.run import Run, averaged, dense, numbered
from polish_sim.planning.quality.coverage import STRICT
from polish_sim.planning.toolpath import arc_length
from polish_sim.planning.turns import Turn, distance_to

WORTH_A_LINK = 0.1  #: Smallest uncovered area a run is led into, in squared step-overs
WORTH_A_LIFT = 0.5  #: Smallest uncovered area the tool is lifted for, in squared step-overs
LONGEST_LINK = 12.0  #: Longest way from a run's end into an uncovered place, in step-overs
CLEAR = 0.2  #: How near a link may pass other turns, in step-overs
#: How far a link may be from the region's nearest vertex, in step-overs; vertices are a third of one apart
OFF = 0.4
DEEP = 0.8  #: A line through the middle of a place ends where the nearest turn comes this much closer
DEEPEST = 2.5  #: Distances to turns are measured up to this many step-overs
#: A run continues into a place that is at least this many step-overs wide on average along its way
PAYS = 0.1
MOST_LINES = 64
SAME = 1e-6  #: Areas and ways that differ by less than this share are the same
TRACE = 0.1  #: Spacing of the points turns are compared by, in step-overs
LEAN = 5  #: Points of a trace over which its direction is taken
TAIL_POINTS = 15  #: A link may pass this many of them at the end of its own run


def finish_middle(mesh: Triangulation, runs: Sequence[Run], stepover: float) -> list[Run]:
    """Lead runs through what they left uncovered, along its middle; lift only where no run ends nearby.

    Some runs become longer, new ones come at the end.
    """
    out = list(runs)
    traces = [dense(run.positions, TRACE * stepover) for run in runs]
    distance = _distance(mesh, np.concatenate([np.empty((0, 3)), *traces]), stepover)
    tried = np.zeros(len(mesh.vertices), dtype=bool)
    for _ in range(MOST_LINES):
        place, area = _largest_place(mesh, (distance > STRICT * stepover) & ~tried)
        if area < WORTH_A_LINK * stepover**2:
            break
        tried |= place
        if area < WORTH_A_LIFT * stepover**2 and place[mesh.border].any():
            continue
        line = _middle_line(mesh, place, distance, stepover)
        owner, added = _lead_into(mesh, traces, line, stepover)
        trace = dense(added, TRACE * stepover)
        if owner >= 0:
            if area < PAYS * stepover * _length(np.concatenate([traces[owner][-1:], added])):
                continue
            more = Run(added, np.full(len(added), out[owner].pass_index[-1]))
            out[owner] = Run(*joined([out[owner], more]))
            traces[owner] = np.concatenate([traces[owner], trace])
        elif area > WORTH_A_LIFT * stepover**2 and len(line) > 1:
            out.append(numbered([line]))
            traces.append(trace)
        else:
            continue
        distance = np.minimum(distance, _distance(mesh, trace, stepover))
        # What the line did not reach may be tried again.
        tried &= ~place | (distance < STRICT * stepover)
    return out


def middle_ends(mesh: Triangulation, turn: Turn, stepover: float) -> Array:
    """Both ends of what an innermost turn will leave uncovered in its middle [m], shape (2, 3), or (0, 3)."""
    distance = np.zeros(len(mesh.vertices))
    distance[turn.inside] = distance_to(mesh, turn.inside, [turn.curve], DEEPEST * stepover)
    place, area = _largest_place(mesh, distance > STRICT * stepover)
    if area < WORTH_A_LINK * stepover**2:
        return np.empty((0, 3))
    return _middle_line(mesh, place, distance, stepover)[[0, -1]]


def _distance(mesh: Triangulation, trace: Array, stepover: float) -> Array:
    """Distance of the vertices to a trace (k, 3), inf beyond 2.5 step-overs [m], shape (n,)."""
    return cKDTree(trace).query(mesh.vertices, distance_upper_bound=DEEPEST * stepover)[0]


def _largest_place(mesh: Triangulation, open_places: Bools) -> tuple[Bools, float]:
    """The connected piece of largest area of some vertices, and that area [m^2]."""
    if not open_places.any():
        return open_places, 0.0
    _, labels = mesh.components(open_places)
    areas = np.bincount(labels[open_places], weights=mesh.vertex_areas[open_places])
    largest = _largest(areas)
    return labels == largest, areas[largest]


def _largest(values: Array | Indices) -> int:
    """The first of the largest values, whichever of them rounding made a little larger."""
    return int(np.argmax(values >= (1.0 - SAME) * values.max()))


def _middle_line(mesh: Triangulation, place: Bools, distance: Array, stepover: float) -> Array:
    """Longest way through a place along the line furthest from everything covered, (n, 3); a point if
    compact."""
    rows = np.flatnonzero(place)
    number = np.full(len(place), -1)
    number[rows] = np.arange(len(rows))
    edges = number[mesh.edges[place[mesh.edges].all(axis=1)]]
    depth = np.minimum(distance[rows], DEEPEST * stepover)
    points = mesh.vertices[rows]
    length = norms(points[edges[:, 0]] - points[edges[:, 1]])
    cost = length * (depth.max() / np.minimum(depth[edges[:, 0]], depth[edges[:, 1]])) ** 4
    graph = coo_array((cost, (edges[:, 0], edges[:, 1])), shape=(len(rows), len(rows))).tocsr()
    deepest = _largest(depth)
    first = _largest(_finite(dijkstra(graph, directed=False, indices=deepest)))
    way, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    here, line = _largest(_finite(way)), []
    while here >= 0:
        line.append(here)
        here = before[here]
    # Its ends run into corners, where there is little left to cover.
    deep = np.flatnonzero(depth[line] > DEEP * depth[line].max())
    ordered = points[line[deep[0] : deep[-1] + 1]]
    if diagonal_of(ordered) < stepover:
        return points[deepest][None]
    even = dense(ordered, TRACE * stepover)
    window = min(21, len(even) // 2 * 2 - 1)
    return averaged(even, window)


def _length(line: Array) -> float:
    return arc_length(line)[-1]


def _finite(values: Array) -> Array:
    return np.where(np.isfinite(values), values, -1.0)


def _lead_into(
    mesh: Triangulation, traces: Sequence[Array], line: Array, stepover: float
) -> tuple[int, Array]:
    """The run that can continue into a line without crossing anything, and the points it adds; -1 if none
    can."""
    offers: list[tuple[float, int, Array]] = []
    for number, trace in enumerate(traces):
        heading = unit(trace[-1] - trace[-min(10, len(trace))])
        for way in (line, line[::-1]):
            link = way[0] - trace[-1]
            length = np.linalg.norm(link)
            price = length * (1.5 - 0.5 * (link @ heading) / max(length, 1e-12))
            if price < LONGEST_LINK * stepover:
                offers.append((price, number, way))
    for _, number, way in sorted(offers, key=lambda offer: offer[0]):
        others = [trace for k, trace in enumerate(traces) if k != number]
        others.append(traces[number][:-TAIL_POINTS])
        for led in (_swung_into(traces[number], way, stepover), way):
            if _is_clear(mesh, others, traces[number][-1], led, stepover):
                return number, led
    return -1, line


def _swung_into(trace: Array, way: Array, stepover: float) -> Array:
    """A way with an arc before it that leaves a trace straight ahead and runs into the way along it, (n,
    3)."""
    start, end = trace[-1], way[0]
    length = np.linalg.norm(end - start)
    back, ahead = trace[-min(LEAN, len(trace))], way[min(LEAN, len(way)) - 1]
    leaving = unit(start - back) * length
    arriving = unit(ahead - end) * length if len(way) > 1 else 2.0 * (end - start) - leaving
    u = np.linspace(0.0, 1.0, max(int(length / (TRACE * stepover)), 2), endpoint=False)[1:, None]
    # Cubic with these ends and directions (Hermite).
    along, turning = u**2 * (3.0 - 2.0 * u), u * (1.0 - u)
    arc = start + along * (end - start) + turning * ((1.0 - u) * leaving - u * arriving)
    return np.concatenate([arc, way])


def _is_clear(mesh: Triangulation, turns: Sequence[Array], start: Array, way: Array, stepover: float) -> bool:
    """Whether the straight way to a line, and the line, stay on the region and keep clear of all turns."""
    along = dense(np.concatenate([start[None], way]), TRACE * stepover)
    if mesh.tree.query(along)[0].max() > OFF * stepover:
        return False
    # The first steps are bound to be near the turn one comes from.
    along = along[min(4, len(along) - 1) :]
    low, high = along.min(axis=0) - CLEAR * stepover, along.max(axis=0) + CLEAR * stepover
    near = [trace[((trace > low) & (trace < high)).all(axis=1)] for trace in turns]
    points = np.concatenate(near)
    return len(points) == 0 or cKDTree(points).query(along)[0].min() > CLEAR * stepover
