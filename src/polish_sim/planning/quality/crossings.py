"""Where a path crosses itself: segment against segment, seen along the surface normal (runs -> pairs, places).

Two segments cross where they do so in the plane across their mean normal, on the same side and the same sheet of the
part. Places closer than a micron are the same place: paths that meet there are judged by where they come from and
where they go, so that a path through another's waypoint crosses once and one that only touches not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curves.curve import Curve
from polish_sim.planning.quality.contact_places import crossings_through_contacts
from polish_sim.planning.quality.segments import SAME_PLACE_M, Segments, segments_of
from polish_sim.spatial import unit

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Crossings(NamedTuple):
    """Where paths cross."""

    places: Array
    """Points [m], shape (k, 3)."""


def count_self_crossings(runs: Sequence[Curve]) -> int:
    """Number of crossings on the same side of the part, within runs and between them; see `find_crossings`."""
    return len(find_crossings(runs).places)


def find_crossings(runs: Sequence[Curve]) -> Crossings:
    """Find every place where runs cross themselves or each other.

    Args:
        runs: Each run in contact, an open curve.

    Returns:
        The crossings; none without runs.
    """
    if not runs:
        return Crossings(np.empty((0, 3)))
    chords = segments_of(runs)
    i, j = _near_pairs(chords)
    signs, near, places = _classify(chords, i, j)
    proper = near & (signs[:, 0] * signs[:, 1] < 0) & (signs[:, 2] * signs[:, 3] < 0)
    contact = near & ~proper
    if not contact.any():
        return Crossings(places[proper])
    # A crossing beside a contact is part of what happens there.
    alone, through = crossings_through_contacts(chords, i, j, proper, contact, places)
    return Crossings(np.concatenate([places[alone], through]))


def _near_pairs(chords: Segments) -> tuple[Ints, Ints]:
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


def _classify(chords: Segments, i: Ints, j: Ints) -> tuple[Ints, NDArray[np.bool_], Array]:
    """How pairs lie to each other in the plane across their mean normal.

    Returns:
        On which side of the other segment's line i's ends and j's ends lie, (n, 4) of -1, 0 and 1; whether the
        segments come within a micron of each other, on the same sheet and side; where [m], (n, 3).
    """
    mean_i = unit(chords.start_normals[i] + chords.end_normals[i])
    mean_j = unit(chords.start_normals[j] + chords.end_normals[j])
    same_side = (mean_i * mean_j).sum(axis=1) > 0.0
    normal = unit(mean_i + mean_j)
    p, q = chords.start[i], chords.start[j]
    u, v, w = chords.end[i] - p, chords.end[j] - q, q - p

    def turn(a: Array, b: Array) -> Array:
        return np.asarray((np.cross(a, b) * normal).sum(axis=1))

    def flat(a: Array) -> Array:
        return np.asarray(np.linalg.norm(a - (a * normal).sum(axis=1)[:, None] * normal, axis=1))

    long_u, long_v = np.maximum(flat(u), 1e-300), np.maximum(flat(v), 1e-300)
    sides = np.stack([-turn(v, w), turn(v, u - w), turn(u, w), turn(u, w + v)], axis=1)
    sides /= np.stack([long_v, long_v, long_u, long_u], axis=1)
    signs = np.where(np.abs(sides) <= SAME_PLACE_M, 0, np.sign(sides)).astype(np.int64)
    across = (signs[:, 0] * signs[:, 1] < 0) & (signs[:, 2] * signs[:, 3] < 0)
    share_u, share_v, gap = _closest(u, v, w, normal, across, sides)
    on_u, on_v = p + share_u[:, None] * u, q + share_v[:, None] * v
    height = np.abs(((on_v - on_u) * normal).sum(axis=1))
    room = SAME_PLACE_M + _sag(chords, i) + _sag(chords, j)
    near = same_side & (height <= room) & (across | (gap <= SAME_PLACE_M))
    return signs, near, 0.5 * (on_u + on_v)


def _sag(chords: Segments, index: Ints) -> Array:
    """How far a chord may stand off the surface: twice the arc's rise at the turn of its normals, and 5% [m]."""
    length = np.linalg.norm(chords.end[index] - chords.start[index], axis=1)
    bend = np.linalg.norm(chords.end_normals[index] - chords.start_normals[index], axis=1)
    return np.asarray(length * (0.25 * bend + 0.05))


def _closest(
    u: Array, v: Array, w: Array, normal: Array, across: NDArray[np.bool_], sides: Array
) -> tuple[Array, Array, Array]:
    """Shares along both segments of where they cross or come closest in the plane, and the distance there [m]."""
    flat_u, flat_v, flat_w = (a - (a * normal).sum(axis=1)[:, None] * normal for a in (u, v, w))
    uu, vv = (np.maximum((a**2).sum(axis=1), 1e-300) for a in (flat_u, flat_v))

    def foot(point: Array, along: Array, square: Array) -> Array:
        return np.asarray(np.clip((point * along).sum(axis=1) / square, 0.0, 1.0))

    nothing, everything = np.zeros(len(u)), np.ones(len(u))
    ways = [
        (foot(flat_w, flat_u, uu), nothing),
        (foot(flat_w + flat_v, flat_u, uu), everything),
        (nothing, foot(-flat_w, flat_v, vv)),
        (everything, foot(flat_u - flat_w, flat_v, vv)),
    ]
    gaps = np.stack([np.linalg.norm(a[:, None] * flat_u - flat_w - b[:, None] * flat_v, axis=1) for a, b in ways])
    best = gaps.argmin(axis=0)
    rows = np.arange(len(u))
    share_u, share_v = (np.stack([way[k] for way in ways])[best, rows] for k in (0, 1))
    cut_u = np.divide(sides[:, 0], sides[:, 0] - sides[:, 1], out=nothing.copy(), where=across)
    cut_v = np.divide(sides[:, 2], sides[:, 2] - sides[:, 3], out=nothing.copy(), where=across)
    return np.where(across, cut_u, share_u), np.where(across, cut_v, share_v), gaps[best, rows]
