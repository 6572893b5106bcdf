"""Make all facets of a piece run the same way round (faces -> faces)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.geometry.topology import equal_pairs, sorted_half_edges

Ints = NDArray[np.int32]


def wind_consistently(faces: Ints) -> tuple[Ints, int, bool]:
    """Flip facets until neighbours agree about which side is outside; the majority of a piece stays.

    Args:
        faces: Vertex indices, shape (m, 3).

    Returns:
        The faces, how many were flipped, and whether the surface has two sides at all.
    """
    start, _, order, key = sorted_half_edges(faces)
    first, second = equal_pairs(key)
    a, b = order[first], order[second]
    agrees = start[a] != start[b]
    if agrees.all():
        return faces, 0, True
    neighbours = np.full((len(faces), 3), -1, dtype=np.int64)
    same = np.ones((len(faces), 3), dtype=np.bool_)
    neighbours[a // 3, a % 3], neighbours[b // 3, b % 3] = b // 3, a // 3
    same[a // 3, a % 3] = same[b // 3, b % 3] = agrees
    flip, two_sided = _flood(neighbours, same)
    wound = faces.copy()
    wound[flip] = wound[flip][:, ::-1]
    return wound, int(flip.sum()), bool(two_sided)


@njit(cache=True)
def _flood(neighbours, same):  # type: ignore[no-untyped-def]
    """Walk each piece, remember which facets must flip; flip the smaller half."""
    count = len(neighbours)
    state = np.zeros(count, np.int8)  # 0 unseen, 1 keep, -1 flip
    queue = np.empty(count, np.int64)
    two_sided = True
    for seed in range(count):
        if state[seed] != 0:
            continue
        state[seed] = 1
        queue[0] = seed
        head, tail, kept = 0, 1, 0
        while head < tail:
            facet = queue[head]
            head += 1
            kept += state[facet]
            for edge in range(3):
                other = neighbours[facet, edge]
                if other < 0:
                    continue
                wanted = state[facet] if same[facet, edge] else -state[facet]
                if state[other] == 0:
                    state[other] = wanted
                    queue[tail] = other
                    tail += 1
                elif state[other] != wanted:
                    two_sided = False
        if kept < 0:
            for i in range(tail):
                state[queue[i]] = -state[queue[i]]
    return state < 0, two_sided
