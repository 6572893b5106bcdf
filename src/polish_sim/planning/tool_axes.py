"""The tool axis at every point: the normal, leaned by lead and tilt, turned gradually over creases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from polish_sim.planning.curve import unit

Array = NDArray[np.float64]

CREASE = np.radians(4.0)
"""Between neighbouring points a smooth part never turns by as much [rad]."""
SAMPLES = 32
"""Samples on the way over which a crease is rounded."""


def lean(normals: Array, tangents: Array, lead: float, tilt: float) -> Array:
    """Turn the normals by a lead angle towards the feed and a tilt angle to its left.

    Args:
        normals: Unit outward normals, shape (n, 3).
        tangents: Feed directions, shape (n, 3).
        lead: Angle [rad].
        tilt: Angle [rad].

    Returns:
        Unit tool axes from the part to the tool, shape (n, 3).
    """
    along = unit(tangents - normals * (tangents * normals).sum(axis=1, keepdims=True))
    across = np.cross(normals, along)
    return unit(normals + np.tan(lead) * along + np.tan(tilt) * across)


def soften_creases(normals: Array, s: Array, reach: float) -> Array:
    """Let the axis turn over a crease on a stretch instead of at a point; elsewhere it stays the normal.

    Args:
        normals: Unit normals along the path, shape (n, 3).
        s: Arc length [m], shape (n,).
        reach: The turn begins and ends this far from the crease [m].

    Returns:
        Unit axes, shape (n, 3).
    """
    turn = np.linalg.norm(np.diff(normals, axis=0), axis=1)
    jumps = 0.5 * (s[1:] + s[:-1])[turn > CREASE]
    if len(jumps) == 0:
        return normals
    even = np.linspace(s[0], s[-1], max(int((s[-1] - s[0]) * SAMPLES / reach), 2) + 1)
    sampled = np.stack([np.interp(even, s, normals[:, k]) for k in range(3)], axis=1)
    mean = uniform_filter1d(sampled, 2 * SAMPLES + 1, axis=0, mode="nearest")
    softened = np.stack([np.interp(s, even, mean[:, k]) for k in range(3)], axis=1)
    index = np.clip(np.searchsorted(jumps, s), 1, max(len(jumps) - 1, 1))
    away = np.minimum(np.abs(s - jumps[index - 1]), np.abs(s - jumps[np.minimum(index, len(jumps) - 1)]))
    far = np.clip(away / reach - 1.0, 0.0, 1.0)[:, None]
    share = far**2 * (3.0 - 2.0 * far)
    return unit(share * normals + (1.0 - share) * softened)
