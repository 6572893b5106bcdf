"""Equal-distance stepping on a surface (paper 1, section 1.2, fig. 4): the one primitive all turns are built from."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polish_sim.geometry import ClosestPoints

Array = NDArray[np.float64]

ITERATIONS = 20
TOLERANCE_M = 1e-11


class SurfaceQuery(Protocol):
    """Anything that knows its closest point, so that a test can step on a sphere in closed form."""

    def closest(self, points: Array, hint: NDArray[np.int32] | None = None) -> ClosestPoints:
        """Closest points to points (n, 3) [m]; hint: facets that may be close, shape (n,)."""
        ...


def step_on_surface(
    surface: SurfaceQuery, start: Array, normals: Array, directions: Array, distance: Array | float
) -> ClosestPoints:
    """From points on the surface go along directions to the points at an exact Euclidean distance.

    The end point lies in the plane spanned by direction t and normal n of the start, at
    P + a t + h n with a^2 + h^2 = S^2; Newton's method finds the height h at which it meets the surface.

    Args:
        surface: Where to stay.
        start: Points P on the surface [m], shape (n, 3).
        normals: Unit outward normals there, shape (n, 3).
        directions: Directions t, any length and with any normal part, shape (n, 3).
        distance: S [m], one or shape (n,).

    Returns:
        The end points; where the surface ends before S its closest border point. Zero distances stay.
    """
    step = np.broadcast_to(np.asarray(distance, dtype=float), (len(start),))
    tangents = directions - normals * (directions * normals).sum(axis=1, keepdims=True)
    tangents = tangents / np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-300)
    height = np.zeros(len(start))
    foot = None
    for _ in range(ITERATIONS):
        along = np.sqrt(np.maximum(step**2 - height**2, 0.0))
        trial = start + along[:, None] * tangents + height[:, None] * normals
        foot = surface.closest(trial, None if foot is None else foot.facets)
        gap = (trial - foot.positions) * foot.normals  # signed height of the trial above the surface
        error = gap.sum(axis=1)
        if np.abs(error).max(initial=0.0) < TOLERANCE_M:
            break
        # How fast that gap changes when the trial swings along the circle of radius S.
        swing = normals - (height / np.maximum(along, 1e-12))[:, None] * tangents
        rate = (swing * foot.normals).sum(axis=1)
        update = error / np.where(np.abs(rate) < 0.2, np.copysign(0.2, rate), rate)
        height = np.clip(height - update, -0.95 * step, 0.95 * step)
    assert foot is not None
    return foot
