"""How closed turns hang together: a tree over their neighbourhoods, cut into pockets (turns -> pockets).

A pocket is a row of turns, each beside the next, with one line across all of them: the seam along which they become
a double spiral (Zhao et al. 2016, Connected Fermat Spirals for Layered Fabrication).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.spatial import cKDTree

from polish_sim.planning.curve import Curve

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAMPLES = 4
"""Samples per step-over along the turns."""
BESIDE = 1.3
"""Turns nearer than this many step-overs are neighbours."""
APART = 2.3
"""Turns further apart than this many step-overs cannot be joined without a lift."""
BAND = 8.0
"""Length of a seam along the turns, in step-overs."""
SHARE_OF_TURN = 0.3
"""And at most this share of a turn."""
ROOM = 0.75
"""Step-overs kept clear beside a seam."""
SLACK = 0.25
"""By how much turns may miss their distance where a seam crosses them, in step-overs."""


class Contact(NamedTuple):
    """Where two turns run side by side."""

    first: int
    second: int
    length: float
    """How far they do so [m]."""


class Pocket(NamedTuple):
    """Turns side by side, and the seam across them."""

    parent: int
    """Turn the pocket hangs on, -1 if it is the outermost; it is the first of the row then."""
    turns: tuple[int, ...]
    """Numbers of the turns, parent first."""
    s: tuple[float, ...]
    """Arc length at which the seam's middle crosses each [m]."""


@dataclass(eq=False)
class Ground:
    """The turns, who is beside whom, and where seams run already."""

    curves: Sequence[Curve]
    stepover: float
    taken: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    """Middle and half length of the stretches of each turn seams have used [m]."""

    def band(self, turn: int) -> float:
        """Length of a seam on a turn [m]."""
        return min(BAND * self.stepover, SHARE_OF_TURN * self.curves[turn].length)


def find_contacts(curves: Sequence[Curve], stepover: float) -> list[Contact]:
    """Which turns are neighbours, and for how long.

    Args:
        curves: Closed turns.
        stepover: [m].

    Returns:
        Every pair once.
    """
    spacing = stepover / SAMPLES
    stations = [np.linspace(0.0, c.length, max(int(c.length / spacing), 8), endpoint=False) for c in curves]
    points = np.concatenate([c.at(s)[0] for c, s in zip(curves, stations, strict=True)])
    owner = np.repeat(np.arange(len(curves)), [len(s) for s in stations])
    pairs = cKDTree(points).query_pairs(APART * stepover, output_type="ndarray")
    pairs = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]]
    gap = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    contacts = []
    low, high = np.sort(owner[pairs], axis=1).T
    key = low * len(curves) + high
    for pair in np.unique(key):
        mine, first, second = key == pair, int(pair) // len(curves), int(pair) % len(curves)
        near = pairs[mine & (gap < BESIDE * stepover)]
        # Points of the first turn with a point of the second beside them, each counted once.
        count = len(np.unique(near[owner[near] == first]))
        far = 1e-3 * stepover / float(gap[mine].min())
        contacts.append(Contact(first, second, count * spacing + far))
    return contacts


def grow_tree(count: int, contacts: Sequence[Contact], root: int) -> tuple[list[list[int]], list[int]]:
    """The tree of longest contacts that hangs on one turn.

    Args:
        count: Number of turns.
        contacts: Their neighbourhoods.
        root: Turn to start from.

    Returns:
        The children of every turn, and the turns reached.
    """
    beside: list[list[tuple[float, int]]] = [[] for _ in range(count)]
    for contact in contacts:
        beside[contact.first].append((contact.length, contact.second))
        beside[contact.second].append((contact.length, contact.first))
    children: list[list[int]] = [[] for _ in range(count)]
    reached = [root]
    offers = [(length, root, other) for length, other in beside[root]]
    while offers:
        _, parent, child = best = max(offers)
        offers.remove(best)
        if child in reached:
            continue
        reached.append(child)
        children[parent].append(child)
        offers += [(length, child, other) for length, other in beside[child] if other not in reached]
    return children, reached


def split_pockets(ground: Ground, children: Sequence[Sequence[int]], root: int) -> list[Pocket]:
    """Cut a tree of turns into rows with a seam across each.

    Args:
        ground: The turns; the seams' places are entered.
        children: The tree.
        root: Its root.

    Returns:
        Pockets, each after the one it hangs on.
    """
    pockets = []
    waiting = [(-1, root)]
    while waiting:
        parent, first = waiting.pop(0)
        pocket = _follow(ground, children, parent, first)
        pockets.append(pocket)
        for turn, s in zip(pocket.turns, pocket.s, strict=True):
            ground.taken.setdefault(turn, []).append((s, 0.5 * ground.band(turn) + ROOM * ground.stepover))
        for turn in pocket.turns[parent >= 0 :]:
            waiting += [(turn, child) for child in children[turn] if child not in pocket.turns]
    return pockets


def subtree_length(ground: Ground, children: Sequence[Sequence[int]], turn: int) -> float:
    """Length of a turn and all that hang on it [m]."""
    return ground.curves[turn].length + sum(subtree_length(ground, children, child) for child in children[turn])


def _follow(ground: Ground, children: Sequence[Sequence[int]], parent: int, first: int) -> Pocket:
    """The longest row from a turn downwards that one line crosses squarely."""
    start = parent if parent >= 0 else first
    curve = ground.curves[start]
    spacing = ground.stepover / SAMPLES
    s = np.linspace(0.0, curve.length, max(int(curve.length / spacing), 16), endpoint=False)
    row, lines, cost = [start], s[:, None], _use(ground, start, s)
    following = [first] if parent >= 0 else list(children[first])
    while following:
        best: tuple[float, int, Array, Array] | None = None
        for child in following:
            feet, price = _step(ground, row, child, lines)
            if parent < 0 or len(row) > 1:
                alive = price < 1.0
            else:
                alive = np.isfinite(price)
            worth = subtree_length(ground, children, child) if alive.any() else 0.0
            if alive.any() and (best is None or worth > best[0]):
                best = (worth, child, feet, price)
        if best is None:
            break
        _, child, feet, price = best
        kept = np.isfinite(price) if len(row) == 1 and parent >= 0 else price < 1.0
        lines = np.column_stack([lines, feet])[kept]
        cost = (cost + price)[kept]
        row.append(child)
        following = list(children[child])
    line = lines[int(np.argmin(np.round(cost, 6)))]
    return Pocket(parent, tuple(row), tuple(float(value) for value in line))


def _step(ground: Ground, row: Sequence[int], child: int, lines: Array) -> tuple[Array, Array]:
    """Where lines cross the next turn, and what a seam there costs; from 1 on it had better not run there."""
    here, there = ground.curves[row[-1]], ground.curves[child]
    points = here.at(lines[:, -1])[0]
    foot = there.nearest(points)
    price = _misfit(ground, row[-1], child, lines[:, -1]) + _use(ground, child, foot.s)
    if len(row) > 1:
        # The next turn must lie on the other side than the last.
        back = ground.curves[row[-2]].at(lines[:, -2])[0] - points
        price = price + np.where(((foot.positions - points) * back).sum(axis=1) < 0.0, 0.0, np.inf)
    return foot.s, price


def _misfit(ground: Ground, turn: int, other: int, s: Array) -> Array:
    """How far two turns miss their distance within a seam's band, as a share of what is tolerable."""
    curve, spacing = ground.curves[turn], ground.stepover / SAMPLES
    count = max(int(curve.length / spacing), 16)
    even = np.arange(count) * (curve.length / count)
    gap = ground.curves[other].nearest(curve.at(even)[0]).distances / ground.stepover
    width = int(ground.band(turn) / (curve.length / count)) | 1
    worst = maximum_filter1d(np.abs(gap - 1.0), width, mode="wrap")
    return np.asarray(worst[np.round(s / curve.length * count).astype(int) % count] / SLACK)


def _use(ground: Ground, turn: int, s: Array) -> Array:
    """Infinite where a seam would overlap another one on the same turn."""
    length, half = ground.curves[turn].length, 0.5 * ground.band(turn)
    price = np.zeros(len(s))
    for middle, other in ground.taken.get(turn, []):
        away = np.abs(np.mod(s - middle + 0.5 * length, length) - 0.5 * length)
        price[away < half + other] = np.inf
    return price
