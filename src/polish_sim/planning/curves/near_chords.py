"""Nearest points on the two chords that meet in a point of a polyline (curve and points -> feet); compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

TINY = 1e-300


@njit(cache=True, error_model="numpy")
def near_chords(positions, normals, knots, count, closed, points, index):  # type: ignore[no-untyped-def]
    """Nearest points on the chords before and behind given points of a polyline.

    Args:
        positions: Its points [m], a closed one's first repeated at the end, shape (k, 3).
        normals: Normals there, shape (k, 3).
        knots: Arc lengths there [m], shape (k,).
        count: Number of points, the repeated one not counted.
        closed: Whether it is closed.
        points: Where from [m], shape (n, 3).
        index: Between which chords to look: the point of the polyline they meet in, shape (n,).

    Returns:
        Arc lengths (n,), feet (n, 3), normals there, not normalised, (n, 3), and distances (n,).
    """
    n = len(points)
    s, gap, foot, normal = np.empty(n), np.empty(n), np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        best, best_k, best_share = np.inf, 0, 0.0
        for before in (1, 0):
            k = index[i] - before
            k = k % count if closed else min(max(k, 0), count - 2)
            length2, along = 0.0, 0.0
            for c in range(3):
                chord = positions[k + 1, c] - positions[k, c]
                along += (points[i, c] - positions[k, c]) * chord
                length2 += chord * chord
            share = min(max(along / max(length2, TINY), 0.0), 1.0)
            away2 = 0.0
            for c in range(3):
                away2 += (points[i, c] - positions[k, c] - share * (positions[k + 1, c] - positions[k, c])) ** 2
            if away2 < best:
                best, best_k, best_share = away2, k, share
        gap[i] = np.sqrt(best)
        s[i] = knots[best_k] + best_share * (knots[best_k + 1] - knots[best_k])
        for c in range(3):
            foot[i, c] = positions[best_k, c] + best_share * (positions[best_k + 1, c] - positions[best_k, c])
            normal[i, c] = normals[best_k, c] + best_share * (normals[best_k + 1, c] - normals[best_k, c])
    return s, foot, normal, gap
