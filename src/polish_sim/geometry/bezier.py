"""Quadratic Bezier triangles: evaluation, derivatives and rules for their edge control points (paper 1, eq.
1-4).

Control points of a patch, shape (6, 3), are ordered P_200, P_020, P_002, P_110, P_011, P_101: the three
corners, then the point of the edge from corner e to corner e + 1. Barycentric coordinates are (u, v, w).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from polish_sim.arrays import Array, crosses, dots, into_plane, next_corners, norms, unit
from polish_sim.kernel_cache import njit

EDGE_MIDDLES = 0.5 * np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]])  #: Barycentric, by edge
_AGREEMENT = np.cos(np.radians(15.0))


def edge_middle(start: Array, end: Array, start_way: Array, end_way: Array) -> Array:
    """Middle (..., 3) [m] of the cubic Hermite curve whose end tangents are as long as the chord (paper 1,
    eq. 3, 4).

    On a circle it is off by R phi^4 / 8, phi half the angle; with tangents as long as the chord's projection
    by three times that. Points are (..., 3) [m], ``start_way`` and ``end_way`` unit tangents there.
    """
    length = norms(end - start)[..., None]
    return 0.5 * (start + end) + 0.125 * (length * start_way - length * end_way)


def edge_control(start: Array, end: Array, start_way: Array, end_way: Array) -> Array:
    """Control points of the quadratic curves through the `edge_middle`, so 2 M - (P0 + P1) / 2.

    With M itself as the control point, the paper's text taken literally, the surface of a sphere of 1280
    facets is 100 times as far off.
    """
    return 2.0 * edge_middle(start, end, start_way, end_way) - 0.5 * (start + end)


def edge_along(start: Array, end: Array, start_normal: Array, end_normal: Array) -> Array:
    """Control points of curves between points along a surface, by unit normals there (paper 1, eq. 3, 4)."""
    chord = end - start
    ways = (unit(into_plane(chord, normal)) for normal in (start_normal, end_normal))
    return edge_control(start, end, *ways)


def edge_points(start: Array, middle: Array, end: Array, share: Array) -> Array:
    """Points of quadratic curves at shares of their parameter; ``middle`` is the control point, arrays
    broadcast."""
    return (1.0 - share) ** 2 * start + 2.0 * share * (1.0 - share) * middle + share**2 * end


@njit(inline="always")
def basis(u: float, v: float, w: float) -> Any:
    """Bernstein polynomials of degree two (paper 1, eq. 2)."""
    return u * u, v * v, w * w, 2.0 * u * v, 2.0 * v * w, 2.0 * w * u


@njit
def blend(control, facets, barycentric):  # type: ignore[no-untyped-def]
    """Evaluate quadratic triangles ``facets`` (n,) at ``barycentric`` (n, 3): positions, normals or other
    values.

    From the control values (m, 6, d) of all triangles, shape (n, d).
    """
    count = len(facets)
    size = control.shape[2]
    out = np.empty((count, size))
    for i in range(count):
        b0, b1, b2, b3, b4, b5 = basis(barycentric[i, 0], barycentric[i, 1], barycentric[i, 2])
        patch = control[facets[i]]
        for k in range(size):
            out[i, k] = (
                b0 * patch[0, k]
                + b1 * patch[1, k]
                + b2 * patch[2, k]
                + b3 * patch[3, k]
                + b4 * patch[4, k]
                + b5 * patch[5, k]
            )
    return out


def area_elements(control: Array, u: float, v: float, w: float) -> Array:
    """Derivative along u times derivative along v of patches (m, 6, 3): normals as long as the area element,
    (m, 3)."""
    a, b, c, d, e, f = np.moveaxis(control, 1, 0)
    to_u, to_v, to_w = u * a + v * d + w * f, u * d + v * b + w * e, u * f + v * e + w * c
    return crosses(2.0 * (to_u - to_w), 2.0 * (to_v - to_w))


def patch_areas(control: Array) -> Array:
    """Areas of patches, control points (m, 6, 3) [m], by a rule of three points [m^2], shape (m,)."""
    areas = np.zeros(len(control))
    for k in range(3):
        u, v, w = ((4.0 if j == k else 1.0) / 6.0 for j in range(3))
        areas += norms(area_elements(control, u, v, w)) / 6.0
    return areas


def from_corners(corners: Array) -> Array:
    """Write values that vary linearly over triangles, shape (m, 3, d), as quadratic ones, shape (m, 6, d)."""
    middles = 0.5 * (corners + next_corners(corners))
    return np.concatenate([corners, middles], axis=1)


def quadratic_normals(corners: Array, normals: Array) -> Array:
    """Normal field that is quadratic over each triangle (not normalised), continuous across shared edges.

    In the middle of an edge stands the mean of its ends' normals mirrored at the plane across the edge, which
    is exact on spheres, cylinders and cones; it is one order more accurate there than normals varying
    linearly. From corners (m, 3, 3) [m] and unit normals there, the control values (m, 6, 3).
    """
    edges = next_corners(corners) - corners
    both = normals + next_corners(normals)
    lean = 2.0 * dots(edges, both) / np.maximum(dots(edges, edges), 1e-300)
    middle = unit(both - lean[..., None] * edges)
    # Where the ends' normals disagree wildly the mirror image means nothing.
    agrees = dots(middle, both) > _AGREEMENT * norms(both)
    middle = np.where(agrees[..., None], middle, 0.5 * both)
    return np.concatenate([normals, 2.0 * middle - 0.5 * both], axis=1)
