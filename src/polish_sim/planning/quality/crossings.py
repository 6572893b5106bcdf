"""Where a path crosses itself: segment against segment, seen along the surface normal (runs -> places).

Two segments cross where they do so in the plane across their mean normal, on the same side and the same sheet
of the part. Where they meet within a micron the later one counts as moved aside a little, all of it the same
way. Pairs that follow each other over such places are one meeting: paths that cross there do so an odd number
of times, those that only touch, or run together for a while and part to the side they came from, an even one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import (
    Array,
    Bools,
    Indices,
    Ints,
    dots,
    in_groups,
    into_plane,
    joined,
    norms,
    some_rows,
    unit,
)
from polish_sim.geometry.topology import label_pieces
from polish_sim.planning.curve import Curve

SAME_PLACE_M = 1e-6  #: Points closer than this are the same place [m]
#: The way the later segment counts as moved, along no plane of a part
ASIDE = np.array([0.6143, 0.5517, 0.5642])


class Segments(NamedTuple):
    """All chords of all runs."""

    start: Array  #: [m], shape (n, 3)
    end: Array
    start_normals: Array  #: Unit surface normals, shape (n, 3)
    end_normals: Array
    s: Array  #: Arc length of the start along its run [m], shape (n,)
    run: Indices  #: Number of the run, shape (n,)
    number: Indices  #: Follow each other by one only where segments share a point, shape (n,)


def _segments(runs: Sequence[Curve]) -> Segments:
    """All chords of open curves, those of no length left out."""
    ends = ((curve.positions, curve.normals, curve.knots) for curve in runs)
    columns = ((at[:-1], at[1:], up[:-1], up[1:], s[:-1]) for at, up, s in ends)
    start, end, first, last, s = joined(columns)
    run = np.repeat(np.arange(len(runs)), [len(curve.positions) - 1 for curve in runs])
    every = Segments(start, end, first, last, s, run, np.arange(len(run)) + 2 * run)
    return some_rows(every, norms(end - start) > 0.0)


class Crossings(NamedTuple):
    """Where runs cross themselves or each other."""

    places: Array  #: [m], shape (k, 3)
    runs: Indices  #: Numbers of the two that cross, or twice the same, shape (k, 2)
    s: Array  #: Arc lengths there along both [m], shape (k, 2)


def find_crossings(runs: Sequence[Curve]) -> Crossings:
    """Every place where runs in contact, open curves, cross themselves or each other."""
    if not runs:
        return Crossings(np.empty((0, 3)), np.empty((0, 2), dtype=np.int64), np.empty((0, 2)))
    chords = _segments(runs)
    i, j = _near_pairs(chords)
    pairs = _look_at(chords, i, j)
    met = np.flatnonzero(pairs.meets.any(axis=0))
    label = _chains(chords, i[met], j[met], pairs.meets[:, met])
    # Where a path begins or ends it only touches.
    begins, ends = (np.diff(chords.number, **{end: -9}) != 1 for end in ("prepend", "append"))
    at_tip = (pairs.meets & np.stack([begins[i], ends[i], begins[j], ends[j]])).any(axis=0)
    times, touched = (np.bincount(label, kind[met], minlength=len(met)) for kind in (pairs.across, at_tip))
    through = met[pairs.across[met] & ((times % 2 == 1) & (touched == 0))[label]]
    _, first = np.unique(label[np.isin(met, through)], return_index=True)
    alone = pairs.across.copy()
    alone[met] = False
    found = np.append(np.flatnonzero(alone), through[first])
    places, both = pairs.places[found], np.stack([i[found], j[found]], axis=1)
    return Crossings(places, chords.run[both], chords.s[both] + norms(places[:, None] - chords.start[both]))


def _near_pairs(chords: Segments) -> tuple[Indices, Indices]:
    """Pairs of segments that may meet, i < j, neighbours along the path left out.

    Long segments are cut into pieces of the mean length; pieces that meet have middles within one such
    length.
    """
    length = norms(chords.end - chords.start)
    piece = length.mean()
    counts = np.ceil(length / piece).astype(np.int64)
    owner, place = in_groups(counts)
    share = ((place + 0.5) / counts[owner])[:, None]
    middles = chords.start[owner] + share * (chords.end - chords.start)[owner]
    # Room for the height of chords over one another.
    pairs = cKDTree(middles).query_pairs(1.2 * piece + SAME_PLACE_M, output_type="ndarray")
    pairs = np.sort(owner[pairs], axis=1)
    pairs = pairs[chords.number[pairs[:, 1]] - chords.number[pairs[:, 0]] > 1]
    pairs = np.unique(pairs, axis=0)
    return pairs[:, 0], pairs[:, 1]


class _Pairs(NamedTuple):
    """How pairs of segments lie to each other."""

    places: Array  #: Where those that cross do so [m], shape (n, 3)
    across: Bools  #: Whether they cross, shape (n,)
    #: Which ends lie on the other one: the first one's start and end, the second one's, shape (4, n)
    meets: Bools


def _look_at(chords: Segments, i: Indices, j: Indices) -> _Pairs:
    """Look at pairs of segments in the plane across their mean normal."""
    mean_i = unit(chords.start_normals[i] + chords.end_normals[i])
    mean_j = unit(chords.start_normals[j] + chords.end_normals[j])
    normal = unit(mean_i + mean_j)
    p, q = chords.start[i], chords.start[j]
    u, v, w = (into_plane(a, normal) for a in (chords.end[i] - p, chords.end[j] - q, q - p))

    def turn(a: Array, b: Array) -> Array:
        return dots(np.cross(a, b), normal)

    lines = []
    for way, ends, aside in ((v, (-w, u - w), -ASIDE), (u, (w, w + v), ASIDE)):
        long = np.maximum(norms(way), 1e-300)
        left = np.stack([turn(way, end) for end in ends]) / long
        on_line = np.abs(left) <= SAME_PLACE_M
        along = np.stack([dots(way, end) for end in ends]) / long
        within = (along >= -SAME_PLACE_M) & (along <= long + SAME_PLACE_M)
        is_left = np.where(on_line, (np.cross(normal, way) @ aside) > 0.0, left > 0.0)
        crosses = is_left[0] != is_left[1]
        share = np.divide(left[0], left[0] - left[1], out=np.zeros(len(i)), where=crosses)
        lines.append((on_line & within, crosses, share[:, None]))
    (meets_i, crossed_j, share_u), (meets_j, crossed_i, share_v) = lines
    on_u, on_v = p + share_u * (chords.end[i] - p), q + share_v * (chords.end[j] - q)
    room = SAME_PLACE_M + _sag(chords, i) + _sag(chords, j)
    near = (dots(mean_i, mean_j) > 0.0) & (np.abs(dots(on_v - on_u, normal)) <= room)
    return _Pairs(
        0.5 * (on_u + on_v), near & crossed_i & crossed_j, near & np.concatenate([meets_i, meets_j])
    )


def _chains(chords: Segments, i: Indices, j: Indices, meets: Bools) -> Ints:
    """Label of the meeting each pair (n,) belongs to: pairs follow each other over a waypoint that lies on
    both."""
    follows, count = np.append(np.diff(chords.number) == 1, False), len(chords.number)
    code = i * count + j
    links = [np.empty((0, 2), dtype=np.int64)]
    _, end_i, start_j, end_j = meets
    for step_i, step_j, over in (
        (0, 1, end_j),
        (1, 0, end_i),
        (1, 1, end_i & end_j),
        (1, -1, end_i & start_j),
    ):
        at = np.searchsorted(code, code + step_i * count + step_j).clip(max=len(code) - 1)
        there = over & (code[at] == code + step_i * count + step_j)
        there &= (follows[i] | (step_i == 0)) & (follows[j + min(step_j, 0)] | (step_j == 0))
        links.append(np.column_stack([np.flatnonzero(there), at[there]]))
    return label_pieces(np.concatenate(links), len(code))[1]


def _sag(chords: Segments, index: Indices) -> Array:
    """How far a chord may stand off the surface: twice the arc's rise at the turn of its normals, and 5%
    [m]."""
    length = norms(chords.end[index] - chords.start[index])
    bend = norms(chords.end_normals[index] - chords.start_normals[index])
    return length * (0.25 * bend + 0.05)
