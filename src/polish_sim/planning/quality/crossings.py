"""Where a path crosses itself: segment against segment, seen along the surface normal (runs -> pairs, places).

Two segments cross where they do so in the plane across their mean normal, on the same side and the same sheet of the
part. Places closer than a micron are the same place: paths that meet there are judged by where they come from and
where they go, so that a path through another's waypoint crosses once and one that only touches not at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices
from polish_sim.geometry.topology import label_pieces
from polish_sim.planning.curves.curve import Curve, foot_on_chord
from polish_sim.planning.quality.located import SAME_PLACE_M, Segments, segments_of
from polish_sim.planning.toolpath import arc_length, interpolate
from polish_sim.spatial import perpendicular, unit

# Contacts, places where paths meet within a micron, cross or only touch.
#
# Rare, so plain Python: a chain of touching segment pairs is one place. The second path crosses the first one there if
# it comes from one side and leaves to the other; if either path begins or ends there, it only touches.

END_PAIRS = 60  #: Pairs of segments looked at from either end of a place where paths meet


def _crossings_with_contacts(
    chords: Segments, i: Indices, j: Indices, proper: Bools, contact: Bools, places: Array
) -> Array:
    """Judge every chain of contacts between segments ``i`` and ``j`` (n,) [m], the second one later along the path.

    ``proper`` pairs cross each other's inside, ``contact`` pairs meet in any other way, at ``places`` (n, 3) [m].
    Returns where paths cross, away from contacts first [m], shape (k, 3); a crossing beside a contact belongs to it.
    """
    rows = np.flatnonzero(proper | contact)
    label = _chains(chords, i[rows], j[rows])
    touched = np.unique(label[contact[rows]])
    alone = rows[~np.isin(label, touched)]
    order = np.argsort(label, kind="stable")
    order = order[np.isin(label[order], touched)]
    through = []
    for chain in np.split(rows[order], np.flatnonzero(np.diff(label[order])) + 1):
        if len(chain) and _crosses(chords, i[chain], j[chain]):
            through.append(places[chain[len(chain) // 2]])
    return np.concatenate([places[alone], np.array(through).reshape(-1, 3)])


def _chains(chords: Segments, i: Indices, j: Indices) -> Indices:
    """Label of the chain each pair belongs to: pairs follow each other over a waypoint at which paths meet, (n,)."""
    place = {pair: row for row, pair in enumerate(zip(i.tolist(), j.tolist(), strict=True))}
    follows = np.append(np.diff(chords.number) == 1, False)
    links = []
    for (a, b), row in place.items():
        for step_a, step_b in ((0, 1), (1, 0), (1, 1), (1, -1)):
            other = place.get((a + step_a, b + step_b))
            if other is None or (step_a and not follows[a]) or (step_b and not follows[b + min(step_b, 0)]):
                continue
            if _meet_between(chords, a, b, step_a, step_b):
                links.append((row, other))
    return label_pieces(np.array(links, dtype=np.int64).reshape(-1, 2), len(i))[1].astype(np.int64)


def _meet_between(chords: Segments, a: int, b: int, step_a: int, step_b: int) -> bool:
    """Whether the waypoints between two neighbouring pairs of segments lie where the paths meet."""
    on_a, on_b = chords.end[a], chords.start[b] if step_b < 0 else chords.end[b]
    if step_a and step_b:
        return float(np.linalg.norm(on_a - on_b)) <= 3.0 * SAME_PLACE_M
    point, k = (on_a, b) if step_a else (on_b, a)
    return _Line(np.stack([chords.start[k], chords.end[k]])).foot(point)[1] <= 3.0 * SAME_PLACE_M


def _crosses(chords: Segments, i: Indices, j: Indices) -> bool:
    """Whether the paths of a chain of pairs change sides."""
    if chords.number[j.min()] - chords.number[i.max()] <= 2:
        return False  # the path's own hairpin: both ways are one turn
    normal = unit((chords.start_normals[i] + chords.start_normals[j]).sum(axis=0))
    # Where paths run together for long only the ends of that stretch count.
    order = np.argsort(j, kind="stable")
    before, after = (_sides(chords, i[some], j[some], normal) for some in (order[:END_PAIRS], order[-END_PAIRS:]))
    return before[0] * after[1] < 0


def _sides(chords: Segments, i: Indices, j: Indices, normal: Array) -> tuple[int, int]:
    """Sides of the first path from which the second one arrives at their first meeting and leaves their last one."""
    first = perpendicular(normal)
    frame = np.stack([first, np.cross(normal, first)])
    middle = chords.start[i].mean(axis=0)
    one, other = (_Line((_around(chords, which) - middle) @ frame.T) for which in (i, j))
    places = _meetings(one, other)
    if not len(places):
        return 0, 0
    return _side(one, other, places[0], ahead=False), _side(one, other, places[-1], ahead=True)


def _around(chords: Segments, which: Indices) -> Array:
    """Points of a path along a chain's segments, and one segment more on either side where there is one, (p, 3)."""
    low, high = int(which.min()), int(which.max())
    number = chords.number
    if low > 0 and number[low] - number[low - 1] == 1:
        low -= 1
    if high + 1 < len(number) and number[high + 1] - number[high] == 1:
        high += 1
    return np.concatenate([chords.start[low : high + 1], chords.end[high : high + 1]])


class _Line:
    """A polyline in the plane or in space."""

    def __init__(self, points: Array) -> None:
        """Take its points [m], shape (p, 2) or (p, 3)."""
        self.points = points
        self.s = arc_length(points)

    def at(self, s: float) -> Array:
        """The point at an arc length [m], shape (2,)."""
        return interpolate(np.array([s]), self.s, self.points)[0]

    def feet(self, points: Array) -> tuple[Array, Array]:
        """Arc lengths of the nearest points, and their distances [m], each (k,)."""
        share, gap = foot_on_chord(points[:, None] - self.points[:-1], np.diff(self.points, axis=0))
        nearest = gap.argmin(axis=1)
        rows = np.arange(len(points))
        return self.s[nearest] + share[rows, nearest] * np.diff(self.s)[nearest], gap[rows, nearest]

    def foot(self, point: Array) -> tuple[float, float]:
        """Arc length of the nearest point, and its distance [m]."""
        s, gap = self.feet(point[None])
        return float(s[0]), float(gap[0])

    def beyond(self, s: float, ahead: bool) -> Array | None:
        """The next point after an arc length, or the last before it; None at the line's end."""
        rows = np.flatnonzero(self.s > s + 2.0 * SAME_PLACE_M if ahead else self.s < s - 2.0 * SAME_PLACE_M)
        return self.points[rows[0 if ahead else -1]] if len(rows) else None


def _meetings(one: _Line, other: _Line) -> Array:
    """Arc lengths of the other line where it begins, ends or touches the first one, in order, shape (k,)."""
    own = other.s[one.feet(other.points)[1] <= SAME_PLACE_M]
    s, gap = other.feet(one.points)
    return np.sort(np.concatenate([own, s[gap <= SAME_PLACE_M], _cuts(one, other)]))


def _cuts(one: _Line, other: _Line) -> Array:
    """Arc lengths of the other line at which it runs through the inside of a segment of the first one, shape (k,)."""
    a, b = other.points[:-1, None], other.points[1:, None]
    c, d = one.points[None, :-1], one.points[None, 1:]
    from_a, from_b = _turn(d - c, a - c), _turn(d - c, b - c)
    from_c, from_d = _turn(b - a, c - a), _turn(b - a, d - a)
    k, found = np.nonzero((from_a * from_b < 0.0) & (from_c * from_d < 0.0))
    share = from_a[k, found] / (from_a - from_b)[k, found]
    return np.asarray(other.s[k] + np.diff(other.s)[k] * share)


def _turn(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _side(one: _Line, other: _Line, s: float, ahead: bool) -> int:
    """On which side of the first line the other one lies just after (before) a meeting: 1 left, -1 right, 0 neither."""
    place = other.at(s)
    here = one.foot(place)[0]
    back, on, away = one.beyond(here, False), one.beyond(here, True), other.beyond(s, ahead)
    if back is None or on is None or away is None:
        return 0
    corner = one.at(here)
    to_back, to_on, to_away = (np.arctan2(*(point - corner)[::-1]) for point in (back, on, away))
    left_wedge, angle = (float(np.mod(to - to_on, 2.0 * np.pi)) for to in (to_back, to_away))
    return 1 if angle < left_wedge else -1


def find_crossings(runs: Sequence[Curve]) -> Array:
    """Every place where runs in contact, open curves, cross themselves or each other [m], shape (k, 3)."""
    if not runs:
        return np.empty((0, 3))
    chords = segments_of(runs)
    i, j = _near_pairs(chords)
    signs, near, places = _classify(chords, i, j)
    proper = near & (signs[:, 0] * signs[:, 1] < 0) & (signs[:, 2] * signs[:, 3] < 0)
    contact = near & ~proper
    if not contact.any():
        return places[proper]
    return _crossings_with_contacts(chords, i, j, proper, contact, places)


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


def _classify(chords: Segments, i: Indices, j: Indices) -> tuple[Indices, Bools, Array]:
    """How pairs lie to each other in the plane across their mean normal.

    Returns on which side of the other segment's line i's ends and j's ends lie, (n, 4) of -1, 0 and 1; whether the
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


def _sag(chords: Segments, index: Indices) -> Array:
    """How far a chord may stand off the surface: twice the arc's rise at the turn of its normals, and 5% [m]."""
    length = np.linalg.norm(chords.end[index] - chords.start[index], axis=1)
    bend = np.linalg.norm(chords.end_normals[index] - chords.start_normals[index], axis=1)
    return np.asarray(length * (0.25 * bend + 0.05))


def _closest(u: Array, v: Array, w: Array, normal: Array, across: Bools, sides: Array) -> tuple[Array, Array, Array]:
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
