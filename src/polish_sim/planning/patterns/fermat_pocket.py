"""A tree of turns cut into pockets (Tree -> pockets).

A pocket is a row of turns, each beside the next, with one line across all of them: the seam along which they
become a double spiral (Zhao et al. 2016, Connected Fermat Spirals for Layered Fabrication).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Indices, norms, some_rows
from polish_sim.planning.curve import Curve

# How closed turns hang together: who is beside whom, and the tree of the longest of these contacts (turns ->
# Tree).

SAMPLES = 4  #: Samples per step-over along the turns
BESIDE = 1.3  #: Turns nearer than this many step-overs are neighbours
JOINABLE = 2.3  #: Turns further apart than this many step-overs cannot be joined without a lift


class Tree(NamedTuple):
    """A tree of turns."""

    children: tuple[tuple[int, ...], ...]  #: The children of each turn
    reached: tuple[int, ...]  #: All turns of the tree, its root first, each after its parent
    lengths: Array  #: Length of each turn with its whole subtree [m], shape (n,)


def find_contacts(curves: Sequence[Curve], stepover: float) -> coo_array:
    """How far two of some closed turns a step-over [m] apart run side by side [m], every pair once, shape (n,
    n)."""
    points, owner = sample_turns(curves, stepover)
    pairs = cKDTree(points).query_pairs(JOINABLE * stepover, output_type="ndarray")
    pairs = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]]
    gap = norms(points[pairs[:, 0]] - points[pairs[:, 1]])
    low, high = np.sort(owner[pairs], axis=1).T
    key = low * len(curves) + high
    found, lengths = np.unique(key), []
    for pair in found:
        mine = key == pair
        near = pairs[mine & (gap < BESIDE * stepover)]
        # Points of the first turn with a point of the second beside them, each counted once.
        count = len(np.unique(near[owner[near] == pair // len(curves)]))
        far = 1e-3 * stepover**2 / (stepover + gap[mine].min())
        lengths.append(count * stepover / SAMPLES + far)
    return coo_array((lengths, np.divmod(found, len(curves))), shape=(len(curves), len(curves)))


def sample_turns(curves: Sequence[Curve], stepover: float) -> tuple[Array, Indices]:
    """Evenly spaced points of all turns (n, 3), and whose they are."""
    stations = [curve.even(stepover / SAMPLES, 8) for curve in curves]
    points = np.concatenate([c.points(s) for c, s in zip(curves, stations, strict=True)])
    return points, np.repeat(np.arange(len(curves)), [len(s) for s in stations])


def grow_tree(curves: Sequence[Curve], contacts: coo_array, root: int) -> Tree:
    """The tree of longest contacts with the turn ``root`` as its root."""
    lengths = np.array([curve.length for curve in curves])
    reached, parents = breadth_first_order(minimum_spanning_tree(-contacts), root, directed=False)
    children: list[list[int]] = [[] for _ in curves]
    for child in reached[:0:-1].tolist():
        children[parents[child]].insert(0, child)
        lengths[parents[child]] += lengths[child]
    return Tree(tuple(map(tuple, children)), tuple(reached.tolist()), lengths)


#: Largest length of a seam along a turn: in step-overs, and as a share of the turn
BAND, SHARE_OF_TURN = 8.0, 0.35
STEEPEST, GROWTH = 3.2, 1.0
"""Its length on the innermost turn, and on the outermost of a pocket joined to another one, in step-overs:
where a U-turn lies in the wedge between two turns and a line that crosses them, the wedge had better be
short. From turn to turn it grows by no more than the second, so that the lines that cross keep their
distance."""
NARROW, SHARE_OF_LOOP = 2.0, 0.5  #: The same for two turns, which are joined by U-turns alone
ROOM = 0.5  #: Step-overs kept clear beside a seam
SLACK = 0.25  #: By how much turns may miss their distance where a seam crosses them, in step-overs
FREE_HALF = 0.25  #: Midway between two turns nothing is nearer than this share of their distance
BLOCKED = 1e3  #: Distance that stands for turns with another one between them, in step-overs
TOLERABLE = 2.5  #: A line is not followed where it misses by more than this many times as much


class Pocket(NamedTuple):
    """Turns side by side, and the seam across them."""

    parent: int  #: Turn the pocket is joined to, -1 if it is the outermost; it is the first of the row then
    turns: tuple[int, ...]  #: Numbers of the turns, parent first
    s: tuple[float, ...]  #: Arc length at which the seam's middle crosses each [m]
    bands: tuple[float, ...]  #: Length of the seam on each [m]


@dataclass(eq=False)
class Layout:
    """The turns, who is beside whom, and where seams run already."""

    curves: Sequence[Curve]
    stepover: float
    start: Array  #: Where the path should begin [m], shape (3,), or (0,)
    taken: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    """Middle and half length of the stretches of each turn seams have used [m]."""

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(sample_turns(self.curves, self.stepover)[0])

    def distance(self, points: Array) -> Array:
        """Distance from points to the nearest of all turns [m], shape (n,)."""
        return self._tree.query(points)[0]


def split_pockets(layout: Layout, tree: Tree) -> list[Pocket]:
    """Cut a tree of turns into rows with a seam across each; the seams' places are entered in the layout.

    Each pocket comes after the one it is joined to.
    """
    pockets = []
    waiting = [(-1, tree.reached[0])]
    while waiting:
        parent, first = waiting.pop(0)
        pocket = _follow(layout, tree, parent, first)
        if parent >= 0 and len(pocket.turns) == 1:
            # There is no room for a seam: it becomes a stroke of its own.
            parent = -1
            pocket = _follow(layout, tree, parent, first)
        pockets.append(pocket)
        for turn, s, band in zip(pocket.turns, pocket.s, pocket.bands, strict=True):
            layout.taken.setdefault(turn, []).append((s, 0.5 * band + ROOM * layout.stepover))
        for turn in pocket.turns[parent >= 0 :]:
            waiting += [(turn, child) for child in tree.children[turn] if child not in pocket.turns]
    return pockets


class _Lines(NamedTuple):
    """Lines across a row of turns, tried side by side."""

    s: Array  #: Where they cross each turn [m], shape (n, k)
    price: Array  #: What a seam that ends here would cost, shape (n,); inf where there is no room
    wide: Array  #: What a seam of more than two turns would cost, shape (n,)
    away: Array  #: What it costs to begin there, not where wanted, shape (n,)

    @property
    def best(self) -> tuple[float, ...]:
        """The cheapest line."""
        return tuple(float(value) for value in self.s[np.argmin(np.round(self.price + self.away, 6))])


def _follow(layout: Layout, tree: Tree, parent: int, first: int) -> Pocket:
    """The longest row from a turn downwards that one line crosses squarely."""
    row = [parent if parent >= 0 else first]
    curve = layout.curves[row[0]]
    s = curve.even(layout.stepover / SAMPLES, 16)
    free = _use(layout, row[0], s, NARROW), _use(layout, row[0], s, STEEPEST)
    away = np.zeros(len(s))
    if parent < 0 and len(layout.start):
        away = norms(curve.points(s) - layout.start) / layout.stepover
    lines = _Lines(s[:, None], *free, away)
    best = lines.best
    following = [first] if parent >= 0 else list(tree.children[first])
    while following:
        offers = []
        for child in following:
            longer = _step(layout, row, child, lines)
            alive = longer.price < (TOLERABLE * len(row) if len(row) > 1 else BLOCKED)
            if alive.any():
                offers.append((tree.lengths[child], child, longer, alive))
        if not offers:
            break
        _, child, longer, alive = max(offers, key=lambda offer: offer[0])
        best = longer.best
        lines = some_rows(longer, alive)
        row.append(child)
        following = list(tree.children[child])
    return Pocket(parent, tuple(row), best, _even_bands(layout, row, best, parent >= 0))


def _even_bands(
    layout: Layout, row: Sequence[int], line: Sequence[float], hanging: bool
) -> tuple[float, ...]:
    """Length of a seam on each turn of a row, much the same from turn to turn as seen along the seam [m]."""
    step, last = layout.stepover, len(row) - 1
    if last <= 1:
        return tuple(_width(layout, turn, NARROW) for turn in row)
    limits = np.array([_width(layout, turn, BAND) for turn in row])
    ends = [0, last] if hanging else [last]
    limits[ends] = np.minimum(limits[ends], STEEPEST * step)
    scale = np.ones(len(row))
    for k in range(last):
        limits[k] = min(limits[k], _clear_width(layout, row[k], row[k + 1], line[k]))
        here, there = layout.curves[row[k]], layout.curves[row[k + 1]]
        feet = there.nearest(here.points(line[k] + np.array([-step, step]))).s
        span = abs(np.mod(feet[1] - feet[0] + 0.5 * there.length, there.length) - 0.5 * there.length)
        scale[k + 1] = scale[k] * np.clip(span / (2.0 * step), 0.5, 1.5)
    index = np.arange(len(row))
    steps = np.abs(index[:, None] - index)
    even = (limits / scale + GROWTH * step * steps).min(axis=1) * scale
    return tuple(float(band) for band in even)


def _clear_width(layout: Layout, turn: int, other: int, s: float) -> float:
    """Length around a place on a turn along which the next one keeps its distance well [m]."""
    curve = layout.curves[turn]
    away = np.arange(1, 4 * SAMPLES * int(BAND)) * 0.25 * layout.stepover / SAMPLES
    gap = layout.curves[other].nearest(curve.points(s + np.concatenate([-away, away]))).distances
    bad = (np.abs(gap / layout.stepover - 1.0) > SLACK).reshape(2, -1).any(axis=0)
    reach = away[bad.argmax()] if bad.any() else away[-1]
    return max(2.0 * float(reach), NARROW * layout.stepover)


def _step(layout: Layout, row: Sequence[int], child: int, lines: _Lines) -> _Lines:
    """The lines led on to the next turn, and what they cost then."""
    here, there = layout.curves[row[-1]], layout.curves[child]
    s = lines.s[:, -1]
    foot = there.nearest(here.points(s))
    narrow, wide = (
        price + _misfit(layout, row[-1], child, s, steps) + _use(layout, child, foot.s, steps)
        for price, steps in ((lines.price, NARROW), (lines.wide, BAND))
    )
    price = narrow if len(row) == 1 else wide
    return _Lines(np.column_stack([lines.s, foot.s]), price, wide, lines.away)


def _width(layout: Layout, turn: int, steps: float) -> float:
    share = SHARE_OF_LOOP if steps == NARROW else SHARE_OF_TURN
    return min(steps * layout.stepover, share * layout.curves[turn].length)


def _misfit(layout: Layout, turn: int, other: int, s: Array, steps: float) -> Array:
    """How far two turns miss their distance within a seam's length, in units of what is tolerable."""
    curve = layout.curves[turn]
    points = curve.points(curve.even(layout.stepover / SAMPLES, 16))
    count = len(points)
    feet = layout.curves[other].nearest(points)
    gap = feet.distances / layout.stepover
    # A third turn between the two, or the other side of one of them, must not be crossed.
    free = layout.distance(0.5 * (points + feet.positions))
    gap[free < FREE_HALF * feet.distances] = BLOCKED
    width = int(_width(layout, turn, steps) / (curve.length / count)) | 1
    worst = maximum_filter1d(np.abs(gap - 1.0), width, mode="wrap")
    return worst[np.round(s / curve.length * count).astype(int) % count] / SLACK


def _use(layout: Layout, turn: int, s: Array, steps: float) -> Array:
    """Infinite where a seam would overlap another one on the same turn."""
    length = layout.curves[turn].length
    half = 0.5 * _width(layout, turn, steps)
    price = np.zeros(len(s))
    for middle, other in layout.taken.get(turn, []):
        away = np.abs(np.mod(s - middle + 0.5 * length, length) - 0.5 * length)
        price[away < half + other] = np.inf
    return price
