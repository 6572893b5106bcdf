"""Where a path crosses itself: segment against segment, seen along the surface normal (runs -> places).

Two segments cross where they do so in the plane across their mean normal, on the same side and the same sheet of the
part. A point within a micron of a line counts as left of it, for both segments that meet there: a path through
another's waypoint crosses once, and one that only touches crosses twice at one place, which is not counted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.geometry.topology import label_pieces
from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.quality.located import SAME_PLACE_M, Segments, segments_of
from polish_sim.spatial import unit

ONE_PLACE = 5.0  #: Crossings at segments' ends within this many `SAME_PLACE_M` of each other are at one place


def find_crossings(runs: Sequence[Curve]) -> Array:
    """Every place where runs in contact, open curves, cross themselves or each other [m], shape (k, 3)."""
    if not runs:
        return np.empty((0, 3))
    chords = segments_of(runs)
    places, touching = _crossed(chords, *_near_pairs(chords))
    # Where a path begins or ends it only touches.
    tips = cKDTree(np.concatenate([run.positions[[0, -1]] for run in runs]))
    through, met = places[~touching], places[touching & (tips.query(places)[0] > ONE_PLACE * SAME_PLACE_M)]
    _, label = label_pieces(cKDTree(met).query_pairs(ONE_PLACE * SAME_PLACE_M, output_type="ndarray"), len(met))
    first, counts = np.unique(label, return_index=True, return_counts=True)[1:]
    return np.concatenate([through, met[first[counts % 2 == 1]]])


def _near_pairs(chords: Segments) -> tuple[Indices, Indices]:
    """Pairs of segments that may meet, i < j, neighbours along the path left out.

    Long segments are cut into pieces of the mean length; pieces that meet have middles within one such length.
    """
    length = np.linalg.norm(chords.end - chords.start, axis=1)
    piece = float(length.mean())
    counts = np.ceil(length / piece).astype(np.int64)
    owner = np.repeat(np.arange(len(length)), counts)
    place = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = ((place + 0.5) / counts[owner])[:, None]
    middles = chords.start[owner] + share * (chords.end - chords.start)[owner]
    # Room for the height of chords over one another.
    pairs = cKDTree(middles).query_pairs(1.2 * piece + SAME_PLACE_M, output_type="ndarray")
    pairs = np.sort(owner[pairs], axis=1)
    pairs = pairs[chords.number[pairs[:, 1]] - chords.number[pairs[:, 0]] > 1]
    pairs = np.unique(pairs, axis=0)
    return pairs[:, 0], pairs[:, 1]


def _crossed(chords: Segments, i: Indices, j: Indices) -> tuple[Array, Bools]:
    """Where those of some pairs of segments (n,) that cross do so [m], (k, 3), and whether at an end of one, (k,)."""
    mean_i = unit(chords.start_normals[i] + chords.end_normals[i])
    mean_j = unit(chords.start_normals[j] + chords.end_normals[j])
    normal = unit(mean_i + mean_j)
    p, q = chords.start[i], chords.start[j]
    u, v, w = chords.end[i] - p, chords.end[j] - q, q - p

    def turn(a: Array, b: Array) -> Array:
        return np.asarray((np.cross(a, b) * normal).sum(axis=1))

    def flat(a: Array) -> Array:
        return np.maximum(np.linalg.norm(a - (a * normal).sum(axis=1)[:, None] * normal, axis=1), 1e-300)

    # How far each segment's ends are left of the other one's line.
    ends_i = np.stack([-turn(v, w), turn(v, u - w)]) / flat(v)
    ends_j = np.stack([turn(u, w), turn(u, w + v)]) / flat(u)
    left_i, left_j = ends_i >= -SAME_PLACE_M, ends_j >= -SAME_PLACE_M
    across = (left_i[0] != left_i[1]) & (left_j[0] != left_j[1])
    share_u, share_v = (
        np.divide(ends[0], ends[0] - ends[1], out=np.zeros(len(i)), where=across) for ends in (ends_i, ends_j)
    )
    on_u, on_v = p + share_u[:, None] * u, q + share_v[:, None] * v
    height = np.abs(((on_v - on_u) * normal).sum(axis=1))
    room = SAME_PLACE_M + _sag(chords, i) + _sag(chords, j)
    across &= ((mean_i * mean_j).sum(axis=1) > 0.0) & (height <= room)
    touching = np.abs([*ends_i, *ends_j]).min(axis=0) <= SAME_PLACE_M
    return 0.5 * (on_u + on_v)[across], touching[across]


def _sag(chords: Segments, index: Indices) -> Array:
    """How far a chord may stand off the surface: twice the arc's rise at the turn of its normals, and 5% [m]."""
    length = np.linalg.norm(chords.end[index] - chords.start[index], axis=1)
    bend = np.linalg.norm(chords.end_normals[index] - chords.start_normals[index], axis=1)
    return np.asarray(length * (0.25 * bend + 0.05))
