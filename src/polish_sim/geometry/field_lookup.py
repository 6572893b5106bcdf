"""The distance field read in a tight loop: value and gradient of many points (DistanceField -> contact)."""

from __future__ import annotations

import numpy as np
from numba import njit

from polish_sim.geometry.distance_field import CELLS, NODES, OUTSIDE

_THREE, _SEVEN, _NODES = np.uint64(3), np.uint64(7), np.uint64(NODES)
_X, _Y, _Z = np.uint64(NODES * NODES), np.uint64(NODES), np.uint64(1)


@njit(cache=True, error_model="numpy")
def look_up(field, nodes, per_metre, x, y, z):  # type: ignore[no-untyped-def]
    """As ``field_gradient``, twice as fast in a loop over points: flat nodes, unsigned indices.

    Args:
        field: The field.
        nodes: ``field.bricks`` flattened.
        per_metre: One over the spacing [1/m].
        x: Point, in the frame of the surface [m].
        y: Point [m].
        z: Point [m].
    """
    fx, fy, fz = (x - field.origin[0]) * per_metre, (y - field.origin[1]) * per_metre, (z - field.origin[2]) * per_metre
    nx, ny, nz = field.table.shape
    if not (0.0 <= fx < nx * CELLS and 0.0 <= fy < ny * CELLS and 0.0 <= fz < nz * CELLS):
        return field.band, 0.0, 0.0, 0.0
    # Unsigned indices spare the compiler's check for negative ones.
    ix, iy, iz = np.uint64(fx), np.uint64(fy), np.uint64(fz)
    brick = field.table[ix >> _THREE, iy >> _THREE, iz >> _THREE]
    if brick < 0:
        return (field.band if brick == OUTSIDE else -field.band), 0.0, 0.0, 0.0
    fx, fy, fz = fx - np.int64(ix), fy - np.int64(iy), fz - np.int64(iz)
    first = (np.uint64(brick) * _NODES + (ix & _SEVEN)) * _NODES + (iy & _SEVEN)
    node = first * _NODES + (iz & _SEVEN)
    n00, n01 = nodes[node], nodes[node + _Y]
    n10, n11 = nodes[node + _X], nodes[node + _X + _Y]
    s00, s01 = nodes[node + _Z] - n00, nodes[node + _Y + _Z] - n01
    s10, s11 = nodes[node + _X + _Z] - n10, nodes[node + _X + _Y + _Z] - n11
    d00, d01 = n00 + fz * s00, n01 + fz * s01
    d10, d11 = n10 + fz * s10, n11 + fz * s11
    d0, d1 = d00 + fy * (d01 - d00), d10 + fy * (d11 - d10)
    s0, s1 = s00 + fy * (s01 - s00), s10 + fy * (s11 - s10)
    gy = (d01 - d00) + fx * ((d11 - d10) - (d01 - d00))
    return d0 + fx * (d1 - d0), (d1 - d0) * per_metre, gy * per_metre, (s0 + fx * (s1 - s0)) * per_metre
