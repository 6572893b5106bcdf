"""Close small holes of a skin, report the larger ones (Skin -> Skin)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry.polygon import MOST_CORNERS, split_polygons
from polish_sim.geometry.repair.skin import Floats, Skin, place
from polish_sim.geometry.topology import find_adjacency

SMALL_HOLE = 0.05
"""Holes up to this share of the part's size across are closed ..."""

LARGEST_CLOSED = 5e-3
"""... if they are no wider than this [m]."""

MISSING_FACET = 0.2
"""Holes of three or four edges, where one facet or two are missing, are closed up to this share of the size."""

_SHOWN = 3


class Hole(NamedTuple):
    """A closed line of border edges."""

    vertices: NDArray[np.int64]
    """Vertices in the order that winds a patch like the facets around it, shape (k,)."""
    width: float
    """Longest side of its bounding box [m]."""
    middle: Floats
    """Mean of its vertices [m], shape (3,)."""


def close_holes(skin: Skin) -> Skin:
    """Close small holes with plane-like patches; leave the larger ones open and say so.

    The longest border of each open piece is its rim, not a hole, unless the piece is closed but for small holes.

    Returns:
        The skin, with notes of place and size of what was closed and what was left.
    """
    holes = find_holes(skin)
    if not holes:
        return skin
    small = [hole for hole in holes if _is_small(hole, skin.size)]
    large = [hole for hole in holes if not _is_small(hole, skin.size)]
    notes = list(skin.notes)
    faces, source = skin.faces, skin.source
    if small:
        members = np.concatenate([hole.vertices for hole in small])
        split = split_polygons(skin.vertices, members, np.array([len(hole.vertices) for hole in small]))
        beside = faces[np.isin(faces, members).all(axis=1)]
        fresh = ~_contained(np.sort(split.triangles, axis=1).astype(np.int32), np.sort(beside, axis=1))
        patches = split.triangles[fresh].astype(np.int32)
        faces = np.concatenate([faces, patches])
        source = np.concatenate([source, np.full(len(patches), -1, dtype=np.int32)])
        notes.append(f"closed {_count(small, 'small hole')}: {_describe(small)}")
    if large:
        edges = sum(len(hole.vertices) for hole in large)
        notes.append(f"open surface: {edges} border edges in {_count(large, 'line')}: {_describe(large)}")
    return Skin(skin.vertices, faces, source, tuple(notes))


def find_holes(skin: Skin) -> list[Hole]:
    """Borders of the skin as closed lines, the widest first; lines through a vertex twice are cut there."""
    facet, edge = np.nonzero(find_adjacency(skin.faces).facets < 0)
    # A patch runs along the border the other way than the facets beside it.
    start, end = skin.faces[facet, (edge + 1) % 3], skin.faces[facet, edge]
    ahead: dict[int, list[int]] = {}
    for a, b in zip(start.tolist(), end.tolist(), strict=True):
        ahead.setdefault(a, []).append(b)
    holes = []
    for first in sorted(ahead):
        while ahead[first]:
            for loop in _simple_loops(_walk(ahead, first)):
                members = np.array(loop, dtype=np.int64)
                points = skin.vertices[members]
                holes.append(Hole(members, float(np.ptp(points, axis=0).max()), points.mean(axis=0)))
    return sorted(holes, key=lambda hole: -hole.width)


def _walk(ahead: dict[int, list[int]], first: int) -> list[int]:
    """Follow border edges until they end; each is used once."""
    line = [first]
    while ahead.get(line[-1]):
        line.append(ahead[line[-1]].pop())
    return line


def _simple_loops(line: list[int]) -> list[list[int]]:
    """Cut a walk into loops that pass no vertex twice; a loose end is no loop."""
    loops: list[list[int]] = []
    stack: list[int] = []
    at: dict[int, int] = {}
    for vertex in line:
        if vertex in at:
            begin = at[vertex]
            loops.append(stack[begin:])
            for gone in stack[begin + 1 :]:
                del at[gone]
            del stack[begin + 1 :]
        else:
            at[vertex] = len(stack)
            stack.append(vertex)
    return [loop for loop in loops if len(loop) >= 3]


def _is_small(hole: Hole, size: float) -> bool:
    if len(hole.vertices) > MOST_CORNERS:
        return False
    limit = min(SMALL_HOLE * size, LARGEST_CLOSED)
    return hole.width <= (max(limit, MISSING_FACET * size) if len(hole.vertices) <= 4 else limit)


def _contained(rows: NDArray[np.int32], among: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Which rows occur among others, all sorted; a patch must not double a facet."""
    both = np.concatenate([among, rows])
    _, index, counts = np.unique(both, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(counts[index.ravel()[len(among) :]] > 1)


def _count(holes: list[Hole], what: str) -> str:
    return f"{len(holes)} {what}{'s' if len(holes) != 1 else ''}"


def _describe(holes: list[Hole]) -> str:
    shown = "; ".join(f"{1e3 * hole.width:.3g} mm wide at {place(hole.middle)}" for hole in holes[:_SHOWN])
    return shown + (f"; and {len(holes) - _SHOWN} more" if len(holes) > _SHOWN else "")
