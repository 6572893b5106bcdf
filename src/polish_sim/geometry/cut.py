"""Cut a surface where a quantity changes sign, along a clean line instead of whole facets (Surface ->
Surface).

`clip` keeps one side, `split` both; `halve_edges` divides facets without gaps. A triangle inside the
parameter domain of a quadratic Bezier triangle is one again, so what is left of a patch lies exactly on the
patch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Indices, Ints, joined, next_corners, norms, some_rows
from polish_sim.geometry.surface import Surface, build_surface
from polish_sim.geometry.topology import find_adjacency

_EDGE_PAIRS = np.array([[0, 1], [1, 2], [2, 0]])
_EQUAL = 1.0 + 1e-6  # of two diagonals or edges of one length the first is taken: rounding


class Clipped(NamedTuple):
    """A surface cut from another one."""

    surface: Surface
    parents: Ints  #: Facet of the original each facet was cut from, shape (k,)


class CutFacets(NamedTuple):
    """Triangles in the parameter domain of their parents."""

    parents: Ints  #: Parent facet, shape (k,)
    barycentric: Array  #: Corners in the parent, shape (k, 3, 3)
    faces: Indices  #: Vertex numbers; cut points are numbered after the vertices, shape (k, 3)


def whole_facets(surface: Surface, facets: Ints) -> CutFacets:
    """Facets (k,) as they are."""
    corners = np.broadcast_to(np.eye(3), (len(facets), 3, 3))
    return CutFacets(facets, corners, surface.faces[facets].astype(np.int64))


def clip(surface: Surface, values: Array, on: float = 0.0) -> Clipped:
    """Keep the part of a surface where a quantity is positive, and the facets it came from.

    ``values`` (m, 6) are the quantity as a quadratic over each patch, equal along shared edges; corners where
    its magnitude is at most ``on`` lie on the cut.
    """
    return _cut_apart(surface, values, on, False)


def split(surface: Surface, values: Array, on: float = 0.0) -> Clipped:
    """Cut a surface like `clip`, but keep both sides, still joined; no facet is on both sides of the cut."""
    return _cut_apart(surface, values, on, True)


def then(first: Clipped, second: Clipped) -> Clipped:
    """The result of a second cut, with the facets of the first one's original."""
    return Clipped(second.surface, first.parents[second.parents])


def _cut_apart(surface: Surface, values: Array, on: float, both: bool) -> Clipped:
    """Divide the facets that are crossed; keep those whose corners' signs are not negative, or ``both``
    sides."""
    sign = np.sign(np.where(np.abs(values[:, :3]) <= on, 0.0, values[:, :3]))
    marked = sign * next_corners(sign) < 0.0
    crossed = marked.any(axis=1)
    kept: Ints = np.flatnonzero(~crossed & (both | (sign >= 0.0).all(axis=1))).astype(np.int32)
    if not crossed.any():
        return Clipped(surface if len(kept) == len(surface.faces) else surface.restrict(kept), kept)
    facets = whole_facets(surface, np.flatnonzero(crossed).astype(np.int32))
    shares = _edge_cuts(surface, values, marked)[crossed]
    cut, places = halve_edges(surface, facets, surface.vertices, marked[crossed], shares)
    # A piece has corners of its parent, and cut points.
    on_side = ((cut.barycentric == 1.0) @ sign[cut.parents, :, None] >= 0.0).all(axis=(1, 2))
    pieces = some_rows(cut, both | on_side)
    cut = CutFacets(*joined([whole_facets(surface, kept), pieces]))
    return Clipped(build_cut(surface, cut, len(places)), cut.parents)


def _edge_cuts(surface: Surface, values: Array, cut: Bools) -> Array:
    """Where each edge that is ``cut`` (m, 3) is, as a share of it from corner e on, (m, 3)."""
    first, second = surface.faces, next_corners(surface.faces)
    swap = first > second
    here, ahead = values[:, :3], next_corners(values[:, :3])
    start, end, middle = np.where(swap, ahead, here), np.where(swap, here, ahead), values[:, 3:]
    number = _number_edges(first[cut], second[cut]).of_facet
    # At a crease the quantity may differ from side to side; the cut point must not.
    roots = _root(start[cut], middle[cut], end[cut])
    at = np.full(cut.shape, 0.5)
    at[cut] = (np.bincount(number, weights=roots) / np.bincount(number))[number]
    return np.where(swap, 1.0 - at, at)


def _root(start: Array, middle: Array, end: Array) -> Array:
    """Root in (0, 1) of the quadratic Bezier function whose ends differ in sign."""
    a, b, c = start - 2.0 * middle + end, middle - start, start
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    # a t^2 + 2 b t + c = 0 in the form that does not cancel; the falling or rising branch by the ends' signs.
    return np.clip(c / (-b + np.where(start > 0.0, root, -root)), 1e-9, 1.0 - 1e-9)


def build_cut(surface: Surface, cut: CutFacets, count: int) -> Surface:
    """Cut control nets to the pieces' corners and number the vertices, ``count`` at most, anew."""
    control, normal_control = surface.control[cut.parents], surface.normal_control[cut.parents]
    smaller = np.flatnonzero((cut.barycentric != np.eye(3)).any(axis=(1, 2)))
    control[smaller] = _sub_patches(control[smaller], cut.barycentric[smaller])
    normal_control[smaller] = _sub_patches(normal_control[smaller], cut.barycentric[smaller])
    vertices = np.empty((count, 3))
    vertices[cut.faces] = control[:, :3]
    used, compact = np.unique(cut.faces, return_inverse=True)
    faces = compact.reshape(-1, 3).astype(np.int32)
    adjacency = find_adjacency(faces)
    return build_surface(
        vertices=vertices[used],
        faces=faces,
        control=control,
        normal_control=normal_control,
        shape=cut.barycentric @ surface.shape[cut.parents],
        adjacency=adjacency,
        smooth=_inherited_smooth(surface, cut) & (adjacency.facets >= 0),
    )


def _sub_patches(control: Array, barycentric: Array) -> Array:
    """Control values, shape (k, 6, d), of the triangles with these corners in their parents, shape (k, 3, 3).

    The control value of two corners a, b is the parent's blossom, sum of P_ij a_i b_j.
    """
    net = control[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]
    size = control.shape[2]
    half = np.matmul(barycentric, net.reshape(len(net), 3, 3 * size)).reshape(len(net), 3, 3, size)
    pairs = [(0, 0), (1, 1), (2, 2), *map(tuple, _EDGE_PAIRS)]
    return np.concatenate([np.matmul(barycentric[:, b, None], half[:, a]) for a, b in pairs], axis=1)


def _inherited_smooth(surface: Surface, cut: CutFacets) -> Bools:
    """Edges inside a parent are smooth; edges on a parent's edge are as smooth as that."""
    smooth = np.ones((len(cut.parents), 3), dtype=bool)
    for edge, (a, b) in enumerate(_EDGE_PAIRS):
        for parent_edge in range(3):
            absent = (parent_edge + 2) % 3
            lies_on = (cut.barycentric[:, a, absent] == 0.0) & (cut.barycentric[:, b, absent] == 0.0)
            smooth[:, edge] &= ~lies_on | surface.smooth[cut.parents, parent_edge]
    return smooth


class Edges(NamedTuple):
    """Edges of triangles, each once."""

    ends: Indices  #: Vertex numbers, the lower first, shape (e, 2)
    of_facet: Indices  #: Number of the edge from corner k to corner k + 1, shape (m, 3); of a half-edge (h,)
    first: Indices  #: The first of these, 3 m + k, that is each edge, shape (e,)


def find_edges(faces: Ints | Indices) -> Edges:
    """List the edges of triangles, faces (m, 3)."""
    return _number_edges(faces, next_corners(faces))


def _number_edges(start: Ints | Indices, end: Ints | Indices) -> Edges:
    """Number the edges that half-edges from vertices, (m, 3) or (h,), to others are, whichever way they
    run."""
    low, high = np.sort([start, end], axis=0).astype(np.int64)
    size = high.max(initial=0) + 1
    keys, first, which = np.unique(low * size + high, return_index=True, return_inverse=True)
    return Edges(np.stack(np.divmod(keys, size), axis=1), which, first)


def spread_to_longest(edges: Edges, lengths: Array, marked: Bools) -> Bools:
    """Mark (e,) the longest edge of every facet with a marked edge too, so that facets stay well shaped when
    halved."""
    of_facet = lengths[edges.of_facet]
    longest = edges.of_facet[
        np.arange(len(of_facet)), (of_facet * _EQUAL >= of_facet.max(axis=1)[:, None]).argmax(1)
    ]
    marked = marked.copy()
    while True:
        touched = marked[edges.of_facet].any(axis=1)
        if marked[longest[touched]].all():
            return marked
        marked[longest[touched]] = True


#: What a triangle is split into by how many edges are halved, those first: corners 0, 1, 2, and 3, 4, 5
#: the middles of edges 0-1, 1-2, 2-0
_HALVED = (
    ((0, 1, 2),),
    ((0, 3, 2), (3, 1, 2)),
    ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
)
_OTHER_DIAGONAL = ((3, 1, 4), (0, 3, 2), (3, 4, 2))
ALIKE = 1.0 + 1e-9  #: Lengths that differ by less are equal: rounding must not decide how patches are split


def halve_edges(
    surface: Surface, cut: CutFacets, places: Array, marked: Bools, shares: Array | float = 0.5
) -> tuple[CutFacets, Array]:
    """Split triangles without gaps at the middles of their ``marked`` edges (m, 3), or at other ``shares`` of
    them: triangles and vertices [m].

    An edge is marked in both its triangles. New vertices follow those of ``places`` (n, 3) [m].
    """
    # Corner by corner, so that of the two triangles at an edge the one of the lower corner evaluates its
    # middle.
    edge, facet = np.nonzero(marked.T)
    _, which, first = _number_edges(cut.faces[facet, edge], cut.faces[facet, (edge + 1) % 3])
    split = np.full(cut.faces.shape, -1)
    split[facet, edge] = len(places) + which
    facet, edge = facet[first], edge[first]
    share, corners = np.asarray(shares)[..., None], cut.barycentric
    nodes = np.concatenate([corners, (1.0 - share) * corners + share * next_corners(corners)], axis=1)
    added = surface.evaluate(cut.parents[facet], nodes[facet, 3 + edge]).positions
    places = np.concatenate([places, added])
    ids = np.concatenate([cut.faces, split], axis=1)
    count = (split >= 0).sum(axis=1)
    parts = []
    for number, pieces in enumerate(_HALVED):
        rows = np.flatnonzero(count == number)
        # Turn each triangle so that its halved edges stand first.
        halved = split[rows] >= 0
        turn = np.argmax(halved & ~np.roll(halved, 1, axis=1), axis=1)[:, None] + np.arange(3)
        order = np.concatenate([turn % 3, 3 + turn % 3], axis=1)
        usual, others, row = np.ones((len(rows), 1), dtype=bool), pieces, rows[:, None]
        if number == 2:  # what is left beside the corner between both edges is cut along its shorter diagonal
            others, ends = _OTHER_DIAGONAL, places[ids[row, order]]
            one, other = (norms(ends[:, a] - ends[:, b]) for a, b in ((0, 4), (2, 3)))
            usual = (one <= ALIKE * other)[:, None]
        for pair in zip(pieces, others, strict=True):
            at = np.take_along_axis(order, np.where(usual, *pair), 1)
            parts.append((cut.parents[rows], nodes[row, at], ids[row, at]))
    return CutFacets(*joined(parts)), places
