"""How deep the pad sinks in at a force: an elastic foundation on a curved place (curvature, tilt -> depth)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.config import PadConfig

Array = NDArray[np.float64]

SPRINGS = 400
ROUNDS = 60
DONE_M = 1e-10


def pad_depths(curvatures: Array, pad: PadConfig, force: float | Array, tilts: Array | None = None) -> Array:
    """How deep the pad's middle must go so that the elastic foundation carries a force.

    The disc of radius R is a bed of springs, K / (pi R^2) per area; over a place of curvatures k1, k2 the
    compression is delta - (k1 x^2 + k2 y^2) / 2 + a x + b y where that is positive, a and b the tool axis' slopes.

    Args:
        curvatures: Principal curvatures [1/m], positive convex, shape (n, 2).
        pad: Radius and stiffness.
        force: [N], one for all or shape (n,).
        tilts: Components of the tool axis along both principal directions, shape (n, 2); None: it is the normal.

    Returns:
        Depths delta [m], shape (n,); below zero where the middle stays off.
    """
    count = len(curvatures)
    mean_depths = np.broadcast_to(np.asarray(force, dtype=np.float64) / pad.stiffness_n_m, (count,))
    tilts = np.zeros((count, 2)) if tilts is None else tilts
    springs = _disc_points(pad.radius_m)
    columns = (np.ascontiguousarray(a, dtype=np.float64) for a in (curvatures, tilts, mean_depths))
    return np.asarray(_solve(*columns, springs))


@njit(cache=True, error_model="numpy")
def _solve(curvatures, tilts, mean_depths, springs):  # type: ignore[no-untyped-def]
    depths = np.empty(len(curvatures))
    falls = np.empty(len(springs))
    for i in range(len(curvatures)):
        highest = 0.0
        for q in range(len(springs)):
            x, y = springs[q, 0], springs[q, 1]
            # How far the part falls away from the pad's face.
            falls[q] = 0.5 * (curvatures[i, 0] * x * x + curvatures[i, 1] * y * y) - tilts[i, 0] * x - tilts[i, 1] * y
            highest = max(highest, falls[q])
        # The force rises convexly with the depth: Newton's method from full contact comes from above.
        depth = mean_depths[i] + highest
        for _ in range(ROUNDS):
            total, touching = 0.0, 0
            for q in range(len(springs)):
                if depth > falls[q]:
                    total += depth - falls[q]
                    touching += 1
            excess = total / len(springs) - mean_depths[i]
            depth -= excess * len(springs) / max(touching, 1)
            if abs(excess) < DONE_M:
                break
        depths[i] = depth
    return depths


def _disc_points(radius: float) -> Array:
    """Points of equal area on a disc (sunflower) [m], shape (q, 2)."""
    k = np.arange(SPRINGS)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    return np.asarray(radius * np.sqrt((k[:, None] + 0.5) / SPRINGS) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
