"""What share of the region the pad reaches: strictly, and by its contact disc at the set force (path -> shares)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from polish_sim.config import PadConfig
from polish_sim.planning.triangulation import Triangulation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STRICT = 0.55
"""A place counts as covered if the path passes within this many step-overs."""


def strictly_covered(mesh: Triangulation, positions: Array, normals: Array, stepover: float) -> Mask:
    """Vertices within 0.55 step-overs of the path, on its side of the part.

    Args:
        mesh: The region.
        positions: Dense points of the path in contact [m], shape (n, 3).
        normals: Unit surface normals there, shape (n, 3).
        stepover: [m].

    Returns:
        Mask over the vertices, shape (k,).
    """
    distance, index = cKDTree(positions).query(mesh.vertices, distance_upper_bound=STRICT * stepover)
    near = np.isfinite(distance)
    index = np.where(near, index, 0)
    return np.asarray(near & ((normals[index] * mesh.normals).sum(axis=1) > 0.0))


def share_of_area(areas: Array, covered: Mask) -> float:
    """Share of the area around covered vertices; areas [m^2] and mask (n,)."""
    return float(areas[covered].sum() / areas.sum())


def pad_depths(curvatures: Array, pad: PadConfig, force: float) -> Array:
    """How deep the pad's middle must go so that the elastic foundation carries a force.

    The disc of radius R is a bed of springs, K / (pi R^2) per area; over a place of curvatures k1, k2 the
    compression is delta - (k1 x^2 + k2 y^2) / 2 where that is positive.

    Args:
        curvatures: Principal curvatures [1/m], positive convex, shape (n, 2).
        pad: Radius and stiffness.
        force: [N].

    Returns:
        Depths delta [m], shape (n,).
    """
    height = 0.5 * curvatures @ (_disc_points(pad.radius_m) ** 2).T  # how far the part falls away, (n, q)
    mean_depth = force / pad.stiffness_n_m
    # The force rises convexly with the depth: Newton's method from full contact comes from above.
    depth = mean_depth + np.maximum(height.max(axis=1), 0.0)
    for _ in range(50):
        compressed = np.maximum(depth[:, None] - height, 0.0)
        excess = compressed.mean(axis=1) - mean_depth
        depth = depth - excess / np.maximum((compressed > 0.0).mean(axis=1), 1e-9)
        if np.abs(excess).max() < 1e-12:
            break
    return np.asarray(depth)


def pad_covered(
    points: Array, point_normals: Array, positions: Array, axes: Array, curvatures: Array, pad: PadConfig, force: float
) -> Mask:
    """Points of the region that lie under the pad's compressed area somewhere along the path.

    Args:
        points: Points of the region [m], shape (k, 3).
        point_normals: Unit surface normals there, shape (k, 3).
        positions: Path points in contact [m], shape (n, 3), no further apart than a fifth of the pad's radius.
        axes: Unit tool axes, shape (n, 3).
        curvatures: Principal curvatures of the part there [1/m], shape (n, 2).
        pad: Radius and stiffness.
        force: Contact force [N].

    Returns:
        Mask over the points, shape (k,).
    """
    depths = pad_depths(curvatures, pad, force)
    covered = np.zeros(len(points), dtype=bool)
    tree = cKDTree(points)
    for position, axis, depth in zip(positions, axes, depths, strict=True):
        near = np.array(tree.query_ball_point(position, pad.radius_m * 1.05), dtype=np.int64)
        near = near[~covered[near]]
        if len(near) == 0:
            continue
        offset = points[near] - position
        height = offset @ axis
        radial2 = (offset**2).sum(axis=1) - height**2
        touched = (height > -depth) & (radial2 < pad.radius_m**2) & (point_normals[near] @ axis > 0.0)
        covered[near[touched]] = True
    return covered


def _disc_points(radius: float, count: int = 400) -> Array:
    """Points of equal area on a disc (sunflower) [m], shape (q, 2)."""
    k = np.arange(count)
    angle = k * np.pi * (3.0 - np.sqrt(5.0))
    return np.asarray(radius * np.sqrt((k[:, None] + 0.5) / count) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
