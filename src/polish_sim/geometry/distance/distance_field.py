"""Sample the signed distance of a surface in a narrow band (Surface -> bricks for the contact).

Cubes of 8 x 8 x 8 cells exist only near the surface; :mod:`field_lookup` reads them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import label

from polish_sim.errors import ConfigError
from polish_sim.geometry.distance.field_lookup import (
    CELLS,
    INSIDE,
    NODES,
    OUTSIDE,
    DistanceField,
    field_distance,
    field_gradient,
)
from polish_sim.geometry.distance.signed_distance import Skin, build_skin, signed_distance
from polish_sim.geometry.surface import Surface

__all__ = ["DistanceField", "bend_field", "build_distance_field", "field_distance", "field_gradient"]

Floats = NDArray[np.float64]

_MOST_NODES = 400_000_000
_BATCH = 256


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
        bricks[batch] = _sample_bricks(skin, corners, hints[batch], spacing, band)
    field = DistanceField(origin, float(spacing), float(band), table, bricks)
    return field if offset is None else bend_field(field, offset)


def bend_field(field: DistanceField, offset: Callable[[Floats], Floats]) -> DistanceField:
    """The field of the same part bent by a form error: outward shift of the surface [m], (n,), at points (n, 3)."""
    places = np.argwhere(field.table >= 0)
    corners = np.empty((len(field.bricks), 3))
    corners[field.table[tuple(places.T)]] = field.origin + CELLS * field.spacing * places
    bricks = np.empty_like(field.bricks)
    for begin in range(0, len(bricks), _BATCH):
        batch = slice(begin, begin + _BATCH)
        shift = offset(_nodes(corners[batch], field.spacing).reshape(-1, 3)).reshape(bricks[batch].shape)
        bricks[batch] = np.clip(field.bricks[batch] - shift, -field.band, field.band)
    return field._replace(bricks=bricks)


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
