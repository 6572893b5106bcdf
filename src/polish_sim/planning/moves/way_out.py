"""Whether a lifted tool can leave a place in a straight line, and along which (part, place -> direction)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, norms
from polish_sim.geometry import Surface
from polish_sim.geometry.distance_field import signed_distances
from polish_sim.spatial import perpendicular, unit

DIRECTIONS = 40  #: Directions tried in the half space the tool looks away to, besides up and the tool axis
KEPT = 0.7  #: Share of the clearance the travelling tool keeps from the part
KEPT_LOW = 0.9  #: Where it was lifted less than that: share of the height it had then
SHORTEST_STEP_M = 5e-4
MOST_STEPS = 400


class Ball(NamedTuple):
    """A ball around the part; outside it the tool travels freely."""

    middle: Array
    radius: float


def ball_around(part: Surface, clearance: float) -> Ball:
    """A ball that holds the part and half as much again as the clearance [m]."""
    return Ball(part.middle, part.radius + 1.5 * clearance)


def height_to_keep(part: Surface, tops: Array, clearance: float) -> float:
    """Distance from the part a tool keeps that travels from or to places (n, 3) with a clearance [m]."""
    return float(min(KEPT * clearance, KEPT_LOW * signed_distances(part, tops).min()))


def way_out(part: Surface, ball: Ball, point: Array, axis: Array, up: Array, kept: float) -> Array | None:
    """Find a straight way from a lifted tool at ``point`` (3,) [m] to outside the ball around the part.

    Returns a unit direction (3,): up if that is free, else the tool's axis, else the one nearest to it; None
    without any. The tool keeps ``kept`` [m] from the part.
    """
    if kept <= 0.0:
        return None
    for direction in (up, axis, *_around(axis)):
        if _is_free(part, ball, point, direction, kept):
            return np.asarray(direction)
    return None


def _around(axis: Array) -> Array:
    """Unit directions spread over the half space about an axis, the nearest to it first, shape (n, 3)."""
    k = np.arange(DIRECTIONS) + 0.5
    along, angle = 1.0 - k / DIRECTIONS, k * np.pi * (3.0 - np.sqrt(5.0))
    first = perpendicular(axis)
    second = np.cross(axis, first)
    beside = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second
    return unit(along[:, None] * axis + np.sqrt(1.0 - along**2)[:, None] * beside)


def _is_free(part: Surface, ball: Ball, point: Array, direction: Array, kept: float) -> bool:
    """Walk along a ray in steps no longer than the distance to the part allows."""
    here = point
    for _ in range(MOST_STEPS):
        if np.linalg.norm(here - ball.middle) > ball.radius:
            return True
        height = signed_distances(part, here[None])[0]
        if height < kept:
            return False
        here = here + direction * max(height - kept, SHORTEST_STEP_M)
    return False


# Whether the tool runs into the part on its way through the air (moves -> depths).

RIM_POINTS = 24


def rim_depths(surface: Surface, positions: Array, axes: Array, radius: float) -> Array:
    """How deep the middle or the rim of the pad's face stands in the part [m], 0 where it is clear, shape
    (n,).

    Tool points and unit axes are (n, 3) each; a ``radius`` of 0 looks at the tool point only.
    """
    points = positions[:, None]
    if radius > 0.0:
        first = _beside(surface, axes)
        second = np.cross(axes, first)
        angle = np.arange(RIM_POINTS) * (2.0 * np.pi / RIM_POINTS)
        rim = np.cos(angle)[:, None] * first[:, None] + np.sin(angle)[:, None] * second[:, None]
        points = np.concatenate([points, points + radius * rim], axis=1)
    depth = -signed_distances(surface, points.reshape(-1, 3)).reshape(points.shape[:2])
    return np.maximum(depth, 0.0).max(axis=1)


def _beside(surface: Surface, axes: Array) -> Array:
    """Unit vectors square to axes (n, 3) that turn with the part, as the coordinate axes would not."""
    ways = surface.vertices[:3] - surface.middle
    square = np.cross(axes[:, None], ways)
    size = norms(square)
    # The first that is long enough: rounding does not choose among equals.
    chosen = (size > 0.5 * size.max(axis=1, keepdims=True)).argmax(axis=1)
    rows = np.arange(len(axes))
    return square[rows, chosen] / size[rows, chosen][:, None]
