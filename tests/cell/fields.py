"""Signed distance fields of parts with a formula, sampled from it: what the contact touches in tests."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from polish_sim.arrays import Array
from polish_sim.cell import RealPart
from polish_sim.cell.real_part import FIELD_BAND, FIELD_SPACING
from polish_sim.geometry.field_lookup import CELLS, NODES, DistanceField

Distance = Callable[[Array], Array]


def sampled(distance: Distance, low: Sequence[float], high: Sequence[float]) -> DistanceField:
    """Field of a distance function, points (..., 3) to distances (...), in a box [m]."""
    side = CELLS * FIELD_SPACING
    origin = np.array(low, dtype=float)
    shape = np.ceil((np.array(high) - origin) / side).astype(int)
    table = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    corners = origin + side * np.argwhere(table >= 0)
    steps = FIELD_SPACING * np.arange(NODES)
    nodes = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    bricks = np.clip(distance(corners[:, None, None, None, :] + nodes), -FIELD_BAND, FIELD_BAND)
    return DistanceField(origin, FIELD_SPACING, FIELD_BAND, table, bricks.astype(np.float32, order="C"))


@cache
def plane() -> DistanceField:
    """The plane z = 0, solid below."""
    return sampled(lambda p: p[..., 2], (-0.06, -0.06, -0.016), (0.06, 0.06, 0.016))


@cache
def sphere(radius: float) -> DistanceField:
    """The top of a ball of this radius [m], its highest point at the origin."""
    middle = np.array([0.0, 0.0, -radius])
    low, high = (-0.04, -0.04, -0.032), (0.04, 0.04, 0.008)
    return sampled(lambda p: np.linalg.norm(p - middle, axis=-1) - radius, low, high)


def wall(x: float, height: float = 0.4) -> DistanceField:
    """A wall that fills everything beyond x [m], 0.24 m wide and so high from z = 0 [m]."""
    return sampled(lambda p: x - p[..., 0], (x - 0.016, -0.12, 0.0), (x + 0.016, 0.12, height))


def part_at(field: DistanceField, rotation: Array | None = None, position=(0.0, 0.0, 0.0)) -> RealPart:
    """A part of one field, for contact and crash alike, at a pose in the base frame."""
    R = np.eye(3) if rotation is None else np.ascontiguousarray(rotation)
    return RealPart(field, field, R, np.array(position, dtype=float))
