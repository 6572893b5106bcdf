"""How closed turns hang together: who is beside whom, and the tree of the longest of these contacts (turns -> Tree)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.planning.curves.curve import Curve

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SAMPLES = 4
"""Samples per step-over along the turns."""
BESIDE = 1.3
"""Turns nearer than this many step-overs are neighbours."""
APART = 2.3
"""Turns further apart than this many step-overs cannot be joined without a lift."""


class Contact(NamedTuple):
    """Where two turns run side by side."""

    first: int
    second: int
    length: float
    """How far they do so [m]."""


class Tree(NamedTuple):
    """Turns that hang on one of them."""

    children: tuple[tuple[int, ...], ...]
    """The turns that hang on each directly."""
    reached: tuple[int, ...]
    """All turns of the tree, its root first, each after the one it hangs on."""
    lengths: Array
    """Length of each turn and of all that hang on it [m], shape (n,)."""


def find_contacts(curves: Sequence[Curve], stepover: float) -> list[Contact]:
    """Which turns are neighbours, and for how long.

    Args:
        curves: Closed turns.
        stepover: [m].

    Returns:
        Every pair once.
    """
    points, owner = sample_turns(curves, stepover)
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
        far = 1e-3 * stepover**2 / (stepover + float(gap[mine].min()))
        contacts.append(Contact(first, second, count * stepover / SAMPLES + far))
    return contacts


def sample_turns(curves: Sequence[Curve], stepover: float) -> tuple[Array, Ints]:
    """Evenly spaced points of all turns (n, 3), and whose they are."""
    spacing = stepover / SAMPLES
    stations = [np.linspace(0.0, c.length, max(int(c.length / spacing), 8), endpoint=False) for c in curves]
    points = np.concatenate([c.at(s)[0] for c, s in zip(curves, stations, strict=True)])
    return points, np.repeat(np.arange(len(curves)), [len(s) for s in stations])


def grow_tree(curves: Sequence[Curve], contacts: Sequence[Contact], root: int) -> Tree:
    """The tree of longest contacts that hangs on one turn.

    Args:
        curves: All turns.
        contacts: Their neighbourhoods.
        root: Turn to start from.

    Returns:
        The tree.
    """
    beside: list[list[tuple[float, int]]] = [[] for _ in curves]
    for contact in contacts:
        beside[contact.first].append((contact.length, contact.second))
        beside[contact.second].append((contact.length, contact.first))
    parent_of = {root: -1}
    offers = [(length, root, other) for length, other in beside[root]]
    while offers:
        _, parent, child = best = max(offers)
        offers.remove(best)
        if child in parent_of:
            continue
        parent_of[child] = parent
        offers += [(length, child, other) for length, other in beside[child] if other not in parent_of]
    children: list[list[int]] = [[] for _ in curves]
    lengths = np.array([curve.length for curve in curves])
    for child, parent in list(parent_of.items())[:0:-1]:
        children[parent].insert(0, child)
        lengths[parent] += lengths[child]
    return Tree(tuple(map(tuple, children)), tuple(parent_of), lengths)
