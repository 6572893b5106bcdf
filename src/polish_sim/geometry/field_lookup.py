"""Look up a distance field, in nanoseconds a point (DistanceField -> contact, collision guard).

Between the nodes the distance is trilinear, so its error is about h^2 (|k1| + |k2|) / 8 for spacing h and
principal curvatures k1, k2, and of order h at creases.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Ints
from polish_sim.kernel_cache import njit
from polish_sim.kernels import Bundle, kernel

CELLS = 8  #: Cells of a brick along each axis
NODES = CELLS + 1  #: Nodes of a brick along each axis; neighbouring bricks share their outer ones
CLIPPED = 0.999  #: From this share of the band on a distance is as good as clipped
OUTSIDE, INSIDE = -1, -2  #: Entries of the table where there is no brick
_THREE, _SEVEN, _NODES = np.uint64(3), np.uint64(7), np.uint64(NODES)
_X, _Y, _Z = np.uint64(NODES * NODES), np.uint64(NODES), np.uint64(1)


class DistanceField(Bundle):
    """Signed distance near a surface, positive outside; see :func:`field_distance`."""

    origin: Array  #: Lowest corner of the grid [m], shape (3,)
    spacing: float  #: Distance between nodes [m]
    band: float  #: Distances are clipped to this magnitude [m]
    table: Ints  #: Brick at each place of the grid, or OUTSIDE or INSIDE, shape (nx, ny, nz)
    bricks: NDArray[np.float32]  #: Distances at the nodes [m], shape (k, 9, 9, 9)


@kernel
def look_up(field, nodes, per_metre, x, y, z):  # type: ignore[no-untyped-def]
    """Signed distance [m] and its gradient at (x, y, z) [m], as (d, gx, gy, gz), for loops over many points.

    The gradient is that of the trilinear interpolant, so its length is one only up to h (|k1| + |k2|) / 2;
    zero beyond the band. ``nodes`` are the ``field.bricks`` flattened, ``per_metre`` is one over the spacing
    [1/m].
    """
    fx = (x - field.origin[0]) * per_metre
    fy = (y - field.origin[1]) * per_metre
    fz = (z - field.origin[2]) * per_metre
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


@njit
def field_distance(field, x, y, z):  # type: ignore[no-untyped-def]
    """Signed distance [m] at (x, y, z) [m] in the surface's frame, clipped to the band; "outside" beyond the
    grid."""
    return look_up(field, field.bricks.reshape(-1), 1.0 / field.spacing, x, y, z)[0]
