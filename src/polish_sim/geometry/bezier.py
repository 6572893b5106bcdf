"""Quadratic Bezier triangles: evaluation, derivatives and rules for their edge control points (paper 1, eq. 1-4).

Control points of a patch, shape (6, 3), are ordered P_200, P_020, P_002, P_110, P_011, P_101: the three
corners, then the point of the edge from corner e to corner e + 1. Barycentric coordinates are (u, v, w).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.kernel_cache import njit
from polish_sim.spatial import unit

Floats = NDArray[np.float64]

TangentRule = Callable[[Floats, Floats], Floats]
"""Maps chords [m] and unit tangent directions, each (k, 3), to end tangents of a Hermite curve [m], (k, 3)."""

ControlRule = Callable[[Floats, Floats, Floats], Floats]
"""Maps both ends of an edge and the Hermite curve's mid-point M, each (k, 3) [m], to the control point."""


_AGREEMENT = np.cos(np.radians(15.0))


def unit_tangents(chords: Floats, directions: Floats) -> Floats:
    """End tangents as long as the chord, |P1 - P0| t/|t| (paper 1, eq. 4); mid-point error R phi^4/8 on a circle."""
    return np.linalg.norm(chords, axis=-1, keepdims=True) * directions


def projected_tangents(chords: Floats, directions: Floats) -> Floats:
    """End tangents as long as the chord's projection; mid-point error 3 R phi^4/8 on a circle."""
    return (chords * directions).sum(axis=-1, keepdims=True) * directions


def through_midpoint(start: Floats, end: Floats, middle: Floats) -> Floats:
    """Control point of the quadratic curve that passes through M: 2 M - (P0 + P1)/2."""
    return 2.0 * middle - 0.5 * (start + end)


def literal_midpoint(start: Floats, end: Floats, middle: Floats) -> Floats:
    """M itself, the paper's text taken literally; the curve then misses M. For comparison only."""
    return middle


def hermite_midpoint(start: Floats, end: Floats, start_tangent: Floats, end_tangent: Floats) -> Floats:
    """Middle of the cubic Hermite curve, P(1/2) = (P0 + P1)/2 + (P0' - P1')/8 (paper 1, eq. 3)."""
    return 0.5 * (start + end) + 0.125 * (start_tangent - end_tangent)


@njit(cache=True, inline="always")
def basis(u: float, v: float, w: float) -> Any:
    """Bernstein polynomials of degree two (paper 1, eq. 2)."""
    return u * u, v * v, w * w, 2.0 * u * v, 2.0 * v * w, 2.0 * w * u


@njit(cache=True)
def blend(control, facets, barycentric):  # type: ignore[no-untyped-def]
    """Evaluate quadratic triangles: positions, normals or whatever the control values mean.

    Args:
        control: Control values, shape (m, 6, d).
        facets: Which triangle, shape (n,).
        barycentric: Where in it, shape (n, 3).

    Returns:
        Values, shape (n, d).
    """
    count, size = len(facets), control.shape[2]
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


def differentiate(control: Floats, facets: NDArray[np.int32], barycentric: Floats) -> tuple[Floats, Floats]:
    """Derivatives along u and along v (w = 1 - u - v), each (n, d)."""
    patch = control[facets]
    u, v, w = (barycentric[:, k, None] for k in range(3))
    along_w = 2.0 * (u * patch[:, 5] + v * patch[:, 4] + w * patch[:, 2])
    along_u = 2.0 * (u * patch[:, 0] + v * patch[:, 3] + w * patch[:, 5]) - along_w
    along_v = 2.0 * (u * patch[:, 3] + v * patch[:, 1] + w * patch[:, 4]) - along_w
    return along_u, along_v


@njit(cache=True, inline="always")
def cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Cross product of two vectors."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, error_model="numpy")
def area_element(patch, u, v, w):  # type: ignore[no-untyped-def]
    """Derivative along u times derivative along v of one patch (6, 3): its normal, as long as its area element."""
    a, b, c, d, e, f = patch[0], patch[1], patch[2], patch[3], patch[4], patch[5]
    wx, wy, wz = u * f[0] + v * e[0] + w * c[0], u * f[1] + v * e[1] + w * c[1], u * f[2] + v * e[2] + w * c[2]
    ux, uy, uz = u * a[0] + v * d[0] + w * f[0], u * a[1] + v * d[1] + w * f[1], u * a[2] + v * d[2] + w * f[2]
    vx, vy, vz = u * d[0] + v * b[0] + w * e[0], u * d[1] + v * b[1] + w * e[1], u * d[2] + v * b[2] + w * e[2]
    return cross(2.0 * (ux - wx), 2.0 * (uy - wy), 2.0 * (uz - wz), 2.0 * (vx - wx), 2.0 * (vy - wy), 2.0 * (vz - wz))


@njit(cache=True, error_model="numpy")
def patch_areas(control):  # type: ignore[no-untyped-def]
    """Areas of patches, control points (m, 6, 3) [m], by a rule of three points [m^2]."""
    areas = np.zeros(len(control))
    for facet in range(len(control)):
        for k in range(3):
            u, v, w = (4.0 if k == 0 else 1.0) / 6.0, (4.0 if k == 1 else 1.0) / 6.0, (4.0 if k == 2 else 1.0) / 6.0
            x, y, z = area_element(control[facet], u, v, w)
            areas[facet] += np.sqrt(x * x + y * y + z * z) / 6.0
    return areas


def from_corners(corners: Floats) -> Floats:
    """Write values that vary linearly over triangles, shape (m, 3, d), as quadratic ones, shape (m, 6, d)."""
    middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
    return np.concatenate([corners, middles], axis=1)


def quadratic_normals(corners: Floats, normals: Floats) -> Floats:
    """Normal field that is quadratic over each triangle (not normalised), continuous across shared edges.

    In the middle of an edge stands the mean of its ends' normals mirrored at the plane across the edge, which is
    exact on spheres, cylinders and cones; it is one order more accurate there than normals varying linearly.

    Args:
        corners: Corners of the triangles [m], shape (m, 3, 3).
        normals: Unit normals at them, shape (m, 3, 3).

    Returns:
        Control values, shape (m, 6, 3).
    """
    edges = np.roll(corners, -1, axis=1) - corners
    both = normals + np.roll(normals, -1, axis=1)
    lean = 2.0 * (edges * both).sum(axis=-1) / (edges**2).sum(axis=-1)
    middle = unit(both - lean[..., None] * edges)
    # Where the ends' normals disagree wildly the mirror image means nothing.
    agrees = (middle * both).sum(axis=-1) > _AGREEMENT * np.linalg.norm(both, axis=-1)
    middle = np.where(agrees[..., None], middle, 0.5 * both)
    return np.concatenate([normals, 2.0 * middle - 0.5 * both], axis=1)
