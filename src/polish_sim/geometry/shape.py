"""How the surface bends at each vertex: shape operators fitted to neighbours (positions, normals -> curvature)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from polish_sim.geometry.features import SmoothCorners, facet_normals

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

_FLAT = 1e-9
_RIDGE = 1e-6
_CUBIC_RIDGE = 1e-3


def vertex_shape(vertices: Floats, faces: Ints, corners: SmoothCorners) -> Floats:
    """Fit a cubic height function with its slopes to the neighbours of each smooth vertex.

    The model after Goldfeather and Interrante (2004): heights and normals of the neighbours over the tangent
    plane. The shape operator S turns a step into the change of the normal, dn = S dx: +1/R on a sphere.

    Args:
        vertices: Vertices [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        corners: Smooth vertices and their normals.

    Returns:
        Shape operators at the facets' corners [1/m], packed xx, yy, zz, xy, yz, zx, shape (m, 3, 6);
        zero on flat facets.
    """
    size = _mean_edge(vertices, faces, corners.ids, len(corners.normals))
    frames = _tangent_frames(corners.normals)
    normal_equations = _accumulate(vertices, faces, corners.ids, corners.normals, frames, size)
    matrix, right = normal_equations[:, :, :7], normal_equations[:, :, 7:]
    trace = np.maximum(np.trace(matrix, axis1=1, axis2=2), 1e-300)
    ridge = np.array([_RIDGE] * 3 + [_CUBIC_RIDGE] * 4)
    fitted = np.linalg.solve(matrix + trace[:, None, None] * np.diag(ridge), right)[:, :3, 0] / size[:, None]
    packed = _pack(frames, fitted)[corners.ids]
    own, _ = facet_normals(vertices, faces)
    tilt = np.abs(corners.normals[corners.ids] - own[:, None, :]).max(axis=(1, 2))
    packed[tilt < _FLAT] = 0.0
    return packed


def unpack(shape: Floats) -> Floats:
    """Symmetric matrices (n, 3, 3) from packed ones (n, 6)."""
    return shape[:, [[0, 3, 5], [3, 1, 4], [5, 4, 2]]]


def _pack(frames: Floats, fitted: Floats) -> Floats:
    first, second = frames[:, 0], frames[:, 1]
    a, b, c = fitted.T

    def entry(i: int, j: int) -> Floats:
        mixed = first[:, i] * second[:, j] + second[:, i] * first[:, j]
        return a * first[:, i] * first[:, j] + b * mixed + c * second[:, i] * second[:, j]

    return np.stack([entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(1, 2), entry(2, 0)], axis=1)


def _tangent_frames(normals: Floats) -> Floats:
    """Two unit tangents for each normal, shape (k, 2, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=1)


def _mean_edge(vertices: Floats, faces: Ints, index: Ints, count: int) -> Floats:
    length = np.linalg.norm(np.roll(vertices[faces], -1, axis=1) - vertices[faces], axis=2)
    both = length + np.roll(length, 1, axis=1)
    total = np.bincount(index.ravel(), weights=both.ravel(), minlength=count)
    return total / (2.0 * np.bincount(index.ravel(), minlength=count))


@njit(cache=True)
def _accumulate(vertices, faces, index, normals, frames, size):  # type: ignore[no-untyped-def]
    """Normal equations (k, 7, 8) of the fits, lengths in units of each vertex's mean edge."""
    sums = np.zeros((len(normals), 7, 8))
    row = np.zeros((3, 8))
    for facet in range(len(faces)):
        for here in range(3):
            at = index[facet, here]
            first, second, normal = frames[at, 0], frames[at, 1], normals[at]
            for step in range(1, 3):
                there = (here + step) % 3
                x = y = z = a = b = c = 0.0
                other = normals[index[facet, there]]
                for k in range(3):
                    d = (vertices[faces[facet, there], k] - vertices[faces[facet, here], k]) / size[at]
                    x += d * first[k]
                    y += d * second[k]
                    z += d * normal[k]
                    a += other[k] * first[k]
                    b += other[k] * second[k]
                    c += other[k] * normal[k]
                if c < 0.2:
                    continue
                far = np.sqrt(x * x + y * y + z * z)
                row[0] = 0.5 * x * x, x * y, 0.5 * y * y, x**3, x * x * y, x * y * y, y**3, -z
                row[0] /= far
                row[1] = x, y, 0.0, 3 * x * x, 2 * x * y, y * y, 0.0, a / c
                row[2] = 0.0, x, y, 0.0, x * x, 2 * x * y, 3 * y * y, b / c
                weight = 1.0 / (far * far)
                for r in range(3):
                    for i in range(7):
                        for j in range(8):
                            sums[at, i, j] += weight * row[r, i] * row[r, j]
    return sums
