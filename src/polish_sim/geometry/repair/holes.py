"""Close small holes of a skin, report the larger ones (Skin -> Skin)."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices, Ints, crosses, longest_side
from polish_sim.errors import MeshError, count_text
from polish_sim.geometry import topology
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.polygon import MOST_CORNERS, split_polygons
from polish_sim.geometry.repair.skin import Skin, middle_in_mm

SMALL_HOLE = 0.05  #: Holes up to this share of the part's size across are closed ...
LARGEST_CLOSED = 5e-3  #: ... if they are no wider than this [m]
#: Holes of three or four edges, a missing facet or two, are closed up to this share of the size
MISSING_FACET = 0.2
_SHOWN = 3


class Hole(NamedTuple):
    """A closed line of border edges."""

    vertices: Indices  #: Vertices in the order that winds a patch like the facets around it, shape (k,)
    width: float  #: Longest side of its bounding box [m]
    middle: Array  #: Mean of its vertices [m], shape (3,)


def close_holes(skin: Skin) -> Skin:
    """Close small holes with plane-like patches; leave the larger ones open, with a note of place and size.

    The longest border of each open piece is its rim, not a hole, unless the piece is closed but for small
    holes.
    """
    holes = find_holes(skin)
    if not holes:
        return skin
    size = skin.size
    small = [hole for hole in holes if _is_small(hole, size)]
    large = [hole for hole in holes if not _is_small(hole, size)]
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
        notes.append(f"closed {count_text(len(small), 'small hole')}: {_describe(small)}")
    if large:
        edges = sum(len(hole.vertices) for hole in large)
        notes.append(
            f"open surface: {edges} border edges in {count_text(len(large), 'line')}: {_describe(large)}"
        )
    return skin._replace(faces=faces, source=source, notes=tuple(notes))


def find_holes(skin: Skin) -> list[Hole]:
    """Borders of the skin as closed lines, the widest first; lines through a vertex twice are cut there."""
    holes = []
    for border in topology.trace_border(topology.find_adjacency(skin.faces)):
        # A patch runs along the border the other way than the facets beside it.
        for members in _simple_loops(skin.faces[tuple(border[::-1].T)]):
            points = skin.vertices[members]
            holes.append(Hole(members, longest_side(points), points.mean(axis=0)))
    return sorted(holes, key=lambda hole: -hole.width)


def _simple_loops(loop: Ints) -> list[Indices]:
    """Cut a closed line of vertices into loops that pass none twice; two edges there and back are no loop."""
    loops: list[Indices] = []
    line: dict[int, None] = {}
    for vertex in (*loop.tolist(), int(loop[0])):
        if vertex in line:
            gone: list[int] = []
            while (last := line.popitem()[0]) != vertex:
                gone.append(last)
            loops.append(np.array([vertex, *gone[::-1]], dtype=np.int64))
        line[vertex] = None
    return [each for each in loops if len(each) >= 3]


def _is_small(hole: Hole, size: float) -> bool:
    if len(hole.vertices) > MOST_CORNERS:
        return False
    limit = min(SMALL_HOLE * size, LARGEST_CLOSED)
    return hole.width <= (max(limit, MISSING_FACET * size) if len(hole.vertices) <= 4 else limit)


def _contained(rows: Ints, among: Ints) -> Bools:
    """Which rows occur among others, all sorted; a patch must not double a facet."""
    both = np.concatenate([among, rows])
    _, index, counts = np.unique(both, axis=0, return_inverse=True, return_counts=True)
    return counts[index.ravel()[len(among) :]] > 1


def _describe(holes: list[Hole]) -> str:
    shown = "; ".join(
        f"{1e3 * hole.width:.3g} mm wide at {middle_in_mm(hole.middle)}" for hole in holes[:_SHOWN]
    )
    return shown + (f"; and {len(holes) - _SHOWN} more" if len(holes) > _SHOWN else "")


SMALL_FIN = 0.01  #: Loose fins up to this share of the part's area are dropped


def separate_crowded(skin: Skin, path: Path) -> Skin:
    """Make every edge one of at most two facets.

    Small fins, joined to such an edge and open at their ends, are dropped. Where solids touch along an edge,
    each keeps its own two facets and its own vertices; where an odd number of sheets meet, those that are
    joined around the edge's ends stay one, the others become sheets of their own.

    Raises:
        MeshError: Edges are left that belong to more than two facets; names how many, and where the first is.
    """
    if topology.find_edge_faults(skin.faces).crowded == 0:
        return skin
    skin = _drop_fins(skin)
    if topology.find_edge_faults(skin.faces).crowded == 0:
        return skin
    skin = _part_vertices(skin)
    faults = topology.find_edge_faults(skin.faces)
    if faults.crowded:
        raise MeshError(
            f"{path}: the mesh is broken: {faults.crowded} edges are shared by more than two facets, the "
            f"first at {middle_in_mm(skin.vertices[faults.first_crowded])}, so inside and outside are not "
            "defined. Repair the part (make it one manifold solid) and export it again."
        )
    return skin


def _drop_fins(skin: Skin) -> Skin:
    """Drop small pieces between a crowded edge and the open."""
    count, labels = topology.label_pieces(
        topology.facet_links(topology.find_adjacency(skin.faces)), len(skin.faces)
    )
    shared = topology.facets_at_edges(skin.faces)
    hangs, ends = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    hangs[labels[(shared > 2).any(axis=1)]] = True
    ends[labels[(shared == 1).any(axis=1)]] = True
    areas = np.bincount(labels, weights=facet_normals(skin.vertices, skin.faces)[1], minlength=count)
    fins = hangs & ends & (areas <= SMALL_FIN * areas.sum())
    if not fins.any():
        return skin
    gone = fins[labels]
    where = middle_in_mm(skin.vertices[skin.faces[np.argmax(gone)]])
    return skin.keep(
        ~gone,
        f"dropped {gone.sum()} facets of {fins.sum()} loose fins on edges of other facets, the first at "
        f"{where}",
    )


def _part_vertices(skin: Skin) -> Skin:
    """Give facets their own vertices where they only touch along an edge or at a point."""
    start, end, order, key = topology.sorted_half_edges(skin.faces)
    new, counts = topology.equal_runs(key)
    pairs = [np.column_stack(topology.paired_half_edges(order, key))]
    crowded = [order[i : i + n] for i, n in zip(new[counts > 2], counts[counts > 2], strict=True)]
    where = middle_in_mm(skin.vertices[[start[crowded[0][0]], end[crowded[0][0]]]])
    inward = _volume(skin) < 0.0
    pairs += [_wedges(skin, group, start, end, inward) for group in crowded]
    links = np.concatenate(pairs)
    a, b = links[:, 0], links[:, 1]
    ahead_a, ahead_b = 3 * (a // 3) + (a + 1) % 3, 3 * (b // 3) + (b + 1) % 3
    alike = start[a] == start[b]
    corners = np.concatenate(
        [
            np.column_stack([a, np.where(alike, b, ahead_b)]),
            np.column_stack([ahead_a, np.where(alike, ahead_b, b)]),
        ]
    )
    number, labels = topology.label_pieces(corners, 3 * len(skin.faces))
    vertices = np.empty((number, 3))
    vertices[labels] = skin.vertices[skin.faces.ravel()]
    note = (
        f"{len(crowded)} edges of more than two facets: pieces that touch there were separated, the "
        f"first at {where}"
    )
    return skin.noted(note, vertices=vertices, faces=labels.reshape(-1, 3))


def _wedges(skin: Skin, group: Indices, start: Indices, end: Indices, inward: bool) -> Indices:
    """Pair half-edges that bound the same solid wedge around their edge, shape (k, 2); none where that is not
    clear."""
    a = skin.vertices[min(start[group[0]], end[group[0]])]
    b = skin.vertices[max(start[group[0]], end[group[0]])]
    way = (b - a) / np.linalg.norm(b - a)
    third = skin.vertices[skin.faces[group // 3, (group + 2) % 3]] - a
    across = third - (third @ way)[:, None] * way
    x = across[0] / max(np.linalg.norm(across[0]), 1e-300)
    angle = np.mod(np.arctan2(across @ crosses(way, x), across @ x), 2.0 * np.pi)
    order = np.argsort(angle, kind="stable")
    forward = (start[group[order]] < end[group[order]]) != inward
    # The solid lies from a facet that runs backward along the edge on to the next one that runs forward.
    if (forward == np.roll(forward, 1)).any():
        return np.empty((0, 2), dtype=np.int64)
    backward = np.flatnonzero(~forward)
    return np.column_stack([group[order[backward]], group[order[(backward + 1) % len(order)]]])


def _volume(skin: Skin) -> float:
    """Six times the signed volume about the middle of the part; negative if most facets look inwards."""
    corners = skin.vertices[skin.faces] - skin.vertices[skin.faces].mean(axis=(0, 1))
    return np.einsum("mj,mj->", corners[:, 0], crosses(corners[:, 1], corners[:, 2]))
