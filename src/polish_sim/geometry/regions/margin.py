"""Keeping away from edges: a region cut back from its border by a distance along the surface (patches ->
patches)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, dots, foot_on_chord, next_corners, norms
from polish_sim.errors import PlanError
from polish_sim.geometry.bezier import EDGE_MIDDLES
from polish_sim.geometry.cut import (
    Clipped,
    CutFacets,
    build_cut,
    clip,
    find_edges,
    halve_edges,
    spread_to_longest,
    then,
    whole_facets,
)
from polish_sim.geometry.regions.patches import connected
from polish_sim.geometry.surface import Surface, along_edges, border_edges

_SAMPLES_PER_REACH = 16.0  #: The border is sampled this densely, in shares of the distance of interest
_CHORD_ERROR = 1e-6  #: The sampled border is this close to the curved one [m]
_MOST_SAMPLES = 400_000
_ARCS = 4  #: Pieces of the way to the border that are taken for circular arcs
_NEAR = (0.6, 1.001)  #: Outside these shares of the distance of interest the straight distance is good enough


class Room(Protocol):
    """How much room there is at places of a surface; a region keeps the places with more than a margin."""

    @property
    def length(self) -> float:
        """Length of the line there is more room beyond, if known [m]: facets along it are no finer than a
        share."""

    def at(self, points: Array) -> Array:
        """Room at points (n, 3) of the surface [m], shape (n,)."""

    def straight(self, points: Array) -> Array:
        """The same, roughly."""


class BorderDistance(NamedTuple):
    """The border of a surface, ready to be asked for distances."""

    starts: Array  #: Where short pieces of the border start [m], shape (b, 3)
    ends: Array  #: Where they end [m], shape (b, 3)
    tree: cKDTree  #: Search tree over their middles
    reach: float  #: Distances about this are measured along the surface [m]
    length: float  #: Length of the whole border [m]
    surface: Surface  #: The surface with that border

    def at(self, points: Array) -> Array:
        """Distances along the surface (n,) of points (n, 3) on it [m]; far from the reach straight ones.

        The way is the straight line to the nearest point of the border, brought down to the surface at a few
        places between which it is an arc; its length differs from the shortest way's in higher order only.
        """
        feet = self._nearest(points)
        distances = norms(points - feet)
        low, high = _NEAR
        near = np.flatnonzero((distances > low * self.reach) & (distances < high * self.reach))
        if len(near):
            distances[near] = _lengths_along(self.surface, feet[near], points[near])
        return distances

    def straight(self, points: Array) -> Array:
        """Straight distances of points (n, 3) to the border [m], shape (n,)."""
        return norms(points - self._nearest(points))

    def _nearest(self, points: Array) -> Array:
        """Nearest points of the border to points (n, 3) [m], shape (n, 3)."""
        count = min(3, len(self.starts))
        _, pieces = self.tree.query(points, k=count)
        pieces = np.asarray(pieces).reshape(len(points), count)
        start, along = self.starts[pieces], self.ends[pieces] - self.starts[pieces]
        share, away = foot_on_chord(points[:, None] - start, along)
        feet = start + share[..., None] * along
        return feet[np.arange(len(points)), away.argmin(axis=1)]


def _border_distance(surface: Surface, reach: float, border: Indices) -> BorderDistance:
    """Border edges (k, 2), rows of (facet, edge), of an open surface, ready for distances of about ``reach``
    [m]."""
    facet, edge = border.T
    chords = norms(surface.control[facet, (edge + 1) % 3] - surface.control[facet, edge])
    spacing = max(reach / _SAMPLES_PER_REACH, chords.sum() / _MOST_SAMPLES)
    starts, ends = along_edges(surface, border, _CHORD_ERROR, spacing)
    tree, length = cKDTree(0.5 * (starts + ends)), norms(ends - starts).sum()
    return BorderDistance(starts, ends, tree, reach, length, surface)


def _lengths_along(surface: Surface, starts: Array, ends: Array) -> Array:
    """Lengths of the straight lines brought down to the surface [m], shape (n,)."""
    share = np.linspace(0.0, 1.0, _ARCS + 1)[:, None, None]
    straight = (starts + share * (ends - starts)).reshape(-1, 3)
    foot = surface.closest(straight)
    places = foot.positions.reshape(_ARCS + 1, -1, 3)
    normals = foot.normals.reshape(_ARCS + 1, -1, 3)
    chords = places[1:] - places[:-1]
    length = norms(chords)
    # On an arc the normals' difference along the chord is twice the sine of half its angle.
    turn = dots(normals[1:] - normals[:-1], chords) / np.maximum(length, 1e-300)
    half = np.arcsin(np.clip(0.5 * turn, -0.9, 0.9))
    stretch = np.where(np.abs(half) < 1e-6, 1.0, half / np.where(half == 0.0, 1.0, np.sin(half)))
    return (length * stretch).sum(axis=0)


#: Facets that the new border crosses are cut down to this share of the margin where it bends
_FACETS_PER_MARGIN = 8.0
#: They are no smaller than this share of the border's length, however small the margin
_FACETS_ALONG = 1500.0
#: Where the distance is linear over a facet up to this share of the margin, the border is straight
_STRAIGHT = 5e-3
_ON_LINE = 1e-4  #: Corners this close to the new border lie on it, relative to the margin
_ROUNDS = 40
_ZERO_ROUNDS = 12
_ZERO = 1e-7  #: Cut points are found to this share of the margin
_HALVINGS = 8  #: The most room of a patch is found to this power of a half of a margin that is too large


def trim(patches: Sequence[Clipped], margin: float, hole_margin: float) -> list[Clipped]:
    """Cut every patch back from its borders, by ``hole_margin`` [m] from those of holes; what is left, piece
    by piece.

    Raises:
        PlanError: Nothing is left.
    """
    left: list[Clipped] = []
    roomiest = 0.0
    for patch in patches:
        kept = [patch]
        loops = border_edges(patch.surface)
        for borders, away in ((loops[:1], margin), (loops[1:], hole_margin)):
            if not borders or away <= 0.0:
                continue
            distance = _border_distance(patch.surface, away, np.concatenate(borders))
            kept, before = [inner for piece in kept for inner in keep_roomy(piece, distance, away)], kept
            if not kept and not left:
                roomiest = max([roomiest, *(_most_room(piece, distance, away) for piece in before)])
        left += kept
    if not left:
        raise PlanError(
            f"nothing of the region is left {max(margin, hole_margin) * 1e3:.4g} mm inside its border: no "
            f"place is further than about {1e3 * roomiest:.3g} mm from it. Set --edge-margin or "
            "--hole-margin below that, or choose another --region."
        )
    return left


def _most_room(patch: Clipped, room: Room, margin: float) -> float:
    """The most room there is on a patch that has less than a margin everywhere [m]."""
    least, most = 0.0, margin
    for _ in range(_HALVINGS):
        middle = 0.5 * (least + most)
        least, most = (middle, most) if keep_roomy(patch, room, middle) else (least, middle)
    return least


def keep_roomy(patch: Clipped, room: Room, margin: float) -> list[Clipped]:
    """Keep what of a patch has more room than a margin [m]: its connected pieces."""
    fine = then(patch, _refined(patch.surface, room, margin))
    inner = then(fine, clip(fine.surface, _beyond_margin(fine.surface, room, margin), on=_ON_LINE * margin))
    return connected(inner) if len(inner.parents) else []


def _refined(surface: Surface, distance: Room, margin: float) -> Clipped:
    """The same surface with small facets where the new border runs."""
    longest = max(margin / _FACETS_PER_MARGIN, distance.length / _FACETS_ALONG)
    count = len(surface.faces)
    cut = whole_facets(surface, np.arange(count, dtype=np.int32))
    # Straight distances show well enough where small facets are needed.
    places = surface.vertices
    values = distance.straight(surface.vertices)
    for _ in range(_ROUNDS):
        corners = places[cut.faces]
        size = norms(next_corners(corners) - corners).max(axis=1)
        # No value changes faster than the distance: the new border may run where no corner is farther from
        # it.
        near = (np.abs(values[cut.faces] - margin).max(axis=1) <= size) & (size > longest)
        near[near] = _bends(surface, cut, values, np.flatnonzero(near), distance) > _STRAIGHT * margin
        if not near.any():
            break
        edges = find_edges(cut.faces)
        lengths = norms(places[edges.ends[:, 0]] - places[edges.ends[:, 1]])
        marked = np.zeros(len(lengths), dtype=bool)
        marked[edges.of_facet[near]] = True
        marked = spread_to_longest(edges, lengths, marked & (lengths > longest))
        cut, places = halve_edges(surface, cut, places, marked[edges.of_facet])
        values = np.concatenate([values, distance.straight(places[len(values) :])])
    if len(cut.parents) == count:
        return Clipped(surface, cut.parents)
    return Clipped(build_cut(surface, cut, len(places)), cut.parents)


def _bends(surface: Surface, cut: CutFacets, values: Array, facets: Indices, distance: Room) -> Array:
    """How far the distance is from linear over facets (k,), in the middle of edges and of the facet [m],
    shape (k,)."""
    worst = np.zeros(len(facets))
    for place in (*EDGE_MIDDLES, np.full(3, 1.0 / 3.0)):
        barycentric = place @ cut.barycentric[facets]
        points = surface.evaluate(cut.parents[facets], barycentric).positions
        worst = np.maximum(worst, np.abs(distance.straight(points) - values[cut.faces[facets]] @ place))
    return worst


def _beyond_margin(surface: Surface, distance: Room, margin: float) -> Array:
    """Distance beyond the margin as a quadratic over each facet whose zeros on edges are exact [m], shape (m,
    6)."""
    corner = distance.at(surface.vertices) - margin
    here = corner[surface.faces]
    middle = 0.5 * (here + next_corners(here))
    crossed = np.flatnonzero((here.min(axis=1) < 0.0) & (here.max(axis=1) > 0.0))
    edges = find_edges(surface.faces[crossed])
    ends = corner[edges.ends]
    cut = np.flatnonzero(ends.min(axis=1) * ends.max(axis=1) < 0.0)
    row, edge = np.divmod(edges.first[cut], 3)
    facets = crossed[row]
    # From the facet's corner e on, which may be the edge's other end.
    forward = surface.faces[facets, edge] == edges.ends[cut, 0]
    start, end = (np.where(forward, ends[cut, k], ends[cut, 1 - k]) for k in (0, 1))
    share = _zero_along(surface, facets, edge, (start, end), distance, margin)
    # The control value that puts the quadratic's zero there.
    control = ends.mean(axis=1)
    control[cut] = -((1.0 - share) ** 2 * start + share**2 * end) / (2.0 * share * (1.0 - share))
    middle[crossed] = control[edges.of_facet]
    return np.concatenate([here, middle], axis=1)


def _zero_along(
    surface: Surface, facets: Indices, edge: Indices, ends: tuple[Array, Array], distance: Room, margin: float
) -> Array:
    """Where along edges the distance is the margin, by false position (Illinois), shape (k,)."""
    corners = np.eye(3)
    low, high = np.zeros(len(facets)), np.ones(len(facets))
    below, above = ends
    share = np.full(len(facets), 0.5)
    for _ in range(_ZERO_ROUNDS):
        share = np.clip((low * above - high * below) / (above - below), 1e-6, 1.0 - 1e-6)
        barycentric = (1.0 - share)[:, None] * corners[edge] + share[:, None] * corners[(edge + 1) % 3]
        value = distance.at(surface.evaluate(facets, barycentric).positions) - margin
        if np.abs(value).max(initial=0.0) < _ZERO * margin:
            break
        same = np.sign(value) == np.sign(below)
        # The end that stays counts half, so that both ends close in.
        low, high = np.where(same, share, low), np.where(same, high, share)
        below, above = np.where(same, value, 0.5 * below), np.where(same, 0.5 * above, value)
    return share
