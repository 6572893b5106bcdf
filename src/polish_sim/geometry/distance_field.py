"""Signed distance of a surface in a narrow band, looked up in nanoseconds (Surface -> bricks for the contact).

Cubes of 8 x 8 x 8 cells exist only near the surface; between the nodes the distance is trilinear, so its error
is about h^2 (|k1| + |k2|) / 8 for spacing h and principal curvatures k1, k2, and of order h at creases.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import label

from polish_sim.errors import ConfigError
from polish_sim.geometry.signed_distance import Skin, build_skin, signed_distance
from polish_sim.geometry.surface import Surface

Floats = NDArray[np.float64]

CELLS = 8
"""Cells of a brick along each axis."""

NODES = CELLS + 1
"""Nodes of a brick along each axis; neighbouring bricks share their outer ones."""

OUTSIDE, INSIDE = -1, -2
"""Entries of the table where there is no brick."""

_THREE, _SEVEN, _NODES = np.uint64(3), np.uint64(7), np.uint64(NODES)
_X, _Y, _Z = np.uint64(NODES * NODES), np.uint64(NODES), np.uint64(1)

_MOST_NODES = 400_000_000
_BATCH = 256


class DistanceField(NamedTuple):
    """Signed distance near a surface, positive outside; see :func:`field_distance`."""

    origin: Floats
    """Lowest corner of the grid [m], shape (3,)."""
    spacing: float
    """Distance between nodes [m]."""
    band: float
    """Distances are clipped to this magnitude [m]."""
    table: NDArray[np.int32]
    """Brick at each place of the grid, or OUTSIDE or INSIDE, shape (nx, ny, nz)."""
    bricks: NDArray[np.float32]
    """Distances at the nodes [m], shape (k, 9, 9, 9)."""


def build_distance_field(
    surface: Surface,
    spacing: float,
    band: float,
    bounds: Floats | None = None,
    offset: Callable[[Floats], Floats] | None = None,
) -> DistanceField:
    """Sample the signed distance of a surface in a narrow band.

    Args:
        surface: The part's whole surface. On an open one the sign follows the closest point's normal, and
            beyond the border everything is outside.
        spacing: Distance between nodes [m].
        band: Half width of the band around the surface [m].
        bounds: Box to sample, corners (2, 3) [m]; default the whole surface. Beyond it all is "outside".
        offset: Outward shift of the surface [m], (n,), at points (n, 3): bends the part by a form error.

    Returns:
        The field.

    Raises:
        ConfigError: The band is narrower than two spacings, or the field would take too much memory.
    """
    if not (0.0 < 2.0 * spacing <= band):
        raise ConfigError(
            f"distance field: the band ({band:g} m) must be at least twice the spacing ({spacing:g} m), both positive."
        )
    low, high = surface.bounds if bounds is None else np.asarray(bounds, dtype=np.float64)
    margin = band + spacing if bounds is None else 0.0
    origin = low - margin
    side = CELLS * spacing
    shape = np.maximum(np.ceil((high + margin - origin) / side), 1).astype(np.int64)
    skin = build_skin(surface)
    near, hints = _find_near_bricks(skin, origin, side, shape, band)
    if len(near) * NODES**3 > _MOST_NODES:
        raise ConfigError(
            f"distance field: {len(near)} bricks are too many; raise the spacing ({spacing:g} m) or set bounds."
        )
    table = np.full(shape, OUTSIDE, dtype=np.int32)
    table[tuple(near.T)] = np.arange(len(near), dtype=np.int32)
    if not surface.is_open:
        _sign_empty_bricks(skin, table, origin, side)
    bricks = np.empty((len(near), NODES, NODES, NODES), dtype=np.float32)
    for begin in range(0, len(near), _BATCH):
        batch = slice(begin, begin + _BATCH)
        corners = origin + side * near[batch]
        distances = _sample_bricks(skin, corners, hints[batch], spacing, band)
        if offset is not None:
            distances -= offset(_nodes(corners, spacing).reshape(-1, 3)).reshape(distances.shape)
        bricks[batch] = np.clip(distances, -band, band)
    return DistanceField(origin, float(spacing), float(band), table, bricks)


@njit(cache=True)
def field_distance(field, x, y, z):  # type: ignore[no-untyped-def]
    """Signed distance at a point [m], clipped to the band; "outside" beyond the grid.

    Args:
        field: The field.
        x: Point, in the frame of the surface [m].
        y: Point [m].
        z: Point [m].
    """
    per_metre = 1.0 / field.spacing
    fx, fy, fz = (x - field.origin[0]) * per_metre, (y - field.origin[1]) * per_metre, (z - field.origin[2]) * per_metre
    nx, ny, nz = field.table.shape
    if not (0.0 <= fx < nx * CELLS and 0.0 <= fy < ny * CELLS and 0.0 <= fz < nz * CELLS):
        return field.band
    ix, iy, iz = int(fx), int(fy), int(fz)
    brick = field.table[ix >> 3, iy >> 3, iz >> 3]
    if brick < 0:
        return field.band if brick == OUTSIDE else -field.band
    fx, fy, fz = fx - ix, fy - iy, fz - iz
    ix, iy, iz = ix & 7, iy & 7, iz & 7
    d = field.bricks[brick]
    d00 = d[ix, iy, iz] + fz * (d[ix, iy, iz + 1] - d[ix, iy, iz])
    d01 = d[ix, iy + 1, iz] + fz * (d[ix, iy + 1, iz + 1] - d[ix, iy + 1, iz])
    d10 = d[ix + 1, iy, iz] + fz * (d[ix + 1, iy, iz + 1] - d[ix + 1, iy, iz])
    d11 = d[ix + 1, iy + 1, iz] + fz * (d[ix + 1, iy + 1, iz + 1] - d[ix + 1, iy + 1, iz])
    d0, d1 = d00 + fy * (d01 - d00), d10 + fy * (d11 - d10)
    return d0 + fx * (d1 - d0)


@njit(cache=True)
def field_gradient(field, x, y, z):  # type: ignore[no-untyped-def]
    """Signed distance [m] and its gradient at a point, as (d, gx, gy, gz).

    The gradient is that of the trilinear interpolant, so its length is one only up to h (|k1| + |k2|) / 2;
    zero beyond the band.
    """
    return look_up(field, field.bricks.reshape(-1), 1.0 / field.spacing, x, y, z)


@njit(cache=True, error_model="numpy")
def look_up(field, nodes, per_metre, x, y, z):  # type: ignore[no-untyped-def]
    """As ``field_gradient``, for loops over points: the caller flattens the bricks once.

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


def _find_near_bricks(
    skin: Skin, origin: Floats, side: float, shape: NDArray[np.int64], band: float
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Bricks that meet the band, shape (k, 3), and a facet near each, shape (k,)."""
    marked = np.zeros(shape, dtype=np.bool_)
    _mark_boxes(skin.control, origin, side, band, marked)
    candidates = np.argwhere(marked)
    facets = _nearest_facets(skin, origin + side * (candidates + 0.5), band + 0.5 * np.sqrt(3.0) * side)
    return candidates[facets >= 0], facets[facets >= 0]


@njit(cache=True)
def _mark_boxes(control, origin, side, band, marked):  # type: ignore[no-untyped-def]
    """Mark the bricks that meet the box of a patch, widened by the band."""
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for facet in range(len(control)):
        for k in range(3):
            low = (control[facet, :, k].min() - band - origin[k]) / side
            high = (control[facet, :, k].max() + band - origin[k]) / side
            first[k] = max(int(np.floor(low)), 0)
            last[k] = min(int(np.floor(high)) + 1, marked.shape[k])
        marked[first[0] : last[0], first[1] : last[1], first[2] : last[2]] = True


@njit(cache=True)
def _nearest_facets(skin, centers, limit):  # type: ignore[no-untyped-def]
    """Closest facet of each center within the limit, -1 beyond."""
    facets = np.empty(len(centers), np.int32)
    hint = -1
    for i in range(len(centers)):
        _, facet = signed_distance(skin, centers[i, 0], centers[i, 1], centers[i, 2], hint, limit)
        facets[i] = facet
        if facet >= 0:
            hint = facet
    return facets


def _sign_empty_bricks(skin: Skin, table: NDArray[np.int32], origin: Floats, side: float) -> None:
    """Mark the empty bricks inside a closed surface; each connected group is on one side."""
    groups, count = label(table < 0)
    for group in range(1, count + 1):
        place = np.unravel_index(int(np.argmax(groups == group)), table.shape)
        x, y, z = origin + side * (np.array(place) + 0.5)
        if signed_distance(skin, x, y, z, -1, np.inf)[0] < 0.0:
            table[groups == group] = INSIDE


def _nodes(corners: Floats, spacing: float) -> Floats:
    """Positions of the bricks' nodes [m], shape (k, 9, 9, 9, 3)."""
    steps = spacing * np.arange(NODES)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1)
    return corners[:, None, None, None, :] + grid


@njit(cache=True)
def _sample_bricks(skin, corners, hints, spacing, band):  # type: ignore[no-untyped-def]
    """Signed distances at the nodes of bricks, shape (k, 9, 9, 9), clipped to the band.

    A brick is 27 blocks of 3 x 3 x 3 nodes; a block whose middle is far enough is outside the band as a whole.
    """
    out = np.empty((len(corners), NODES, NODES, NODES))
    for b in range(len(corners)):
        hint = hints[b]
        for block in range(27):
            i, j, k = 3 * (block // 9), 3 * (block // 3 % 3), 3 * (block % 3)
            x, y, z = corners[b, 0] + spacing * i, corners[b, 1] + spacing * j, corners[b, 2] + spacing * k
            limit = band + 1.7321 * spacing if block > 0 else np.inf
            distance, facet = signed_distance(skin, x + spacing, y + spacing, z + spacing, hint, limit)
            if facet >= 0:
                hint = facet
                hint = _sample_block(
                    skin, out[b, i : i + 3, j : j + 3, k : k + 3], x, y, z, hint, spacing, band, distance
                )
            else:
                # On the same side as the block before: a change of side takes more than twice the band.
                before = out[b, i, j, k - 1] if k > 0 else (out[b, i, j - 1, 0] if j > 0 else out[b, i - 1, 0, 0])
                out[b, i : i + 3, j : j + 3, k : k + 3] = -band if before < 0.0 else band
    return out


@njit(cache=True)
def _sample_block(skin, out, x, y, z, hint, spacing, band, middle):  # type: ignore[no-untyped-def]
    """Fill a block of 3 x 3 x 3 nodes from its lowest corner; return a facet near its end."""
    for i in range(3):
        for j in range(3):
            for k in range(3):
                distance, facet = signed_distance(skin, x + spacing * i, y + spacing * j, z + spacing * k, hint, band)
                if facet >= 0:
                    hint = facet
                else:
                    distance = -band if middle < 0.0 else band
                out[i, j, k] = distance
    return hint
