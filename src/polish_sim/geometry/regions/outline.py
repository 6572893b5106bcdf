"""Choices by an outline: a box, or a polygon seen from above (outline -> what looks up within it)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError, PlanError, place_in_mm
from polish_sim.geometry.clip import Clipped, clip, split, then
from polish_sim.geometry.regions.choice import Whole, looking
from polish_sim.geometry.regions.patches import connected, restricted
from polish_sim.geometry.regions.words import parse_box, parse_corners
from polish_sim.geometry.surface import Surface

Floats = NDArray[np.float64]

_ON_OUTLINE = 1e-7
"""Vertices this close to an outline lie on it [m]."""

_MOST_CORNERS = 1000


def pick_box(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the smooth faces that look up within a box."""
    low, high = parse_box(argument)
    kept = _between(whole.kept, np.eye(3), low, high)
    if len(kept.parents) == 0:
        raise _nothing_in(f"box:{argument}", whole.surface)
    return _faces_above(kept, whole.up)


def pick_polygon(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the smooth faces that look up within a polygon seen from above."""
    corners = parse_corners(argument)
    frame = _plane_across(whole.up, corners)
    flat = corners @ frame.T
    _check_polygon(flat, argument)
    kept = _between(whole.kept, frame, flat.min(axis=0), flat.max(axis=0))
    if len(kept.parents) == 0:
        raise _nothing_in(f"polygon:{argument}", whole.surface)
    kept = looking(kept, whole.up)
    for start, end in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        side = end - start
        length = float(np.linalg.norm(side))
        if length > _ON_OUTLINE:
            across = np.array([-side[1], side[0]]) / length
            values = kept.surface.control @ (across @ frame) - float(across @ start)
            kept = then(kept, split(kept.surface, values, on=_ON_OUTLINE))
    inside = _inside(_middles(kept.surface) @ frame.T, flat)
    if not inside.any():
        raise _nothing_in(f"polygon:{argument}", whole.surface)
    kept = restricted(kept, np.flatnonzero(inside).astype(np.int32))
    return connected(kept, kept.surface.smooth)


def _faces_above(kept: Clipped, up: Floats) -> list[Clipped]:
    seen = looking(kept, up)
    return connected(seen, seen.surface.smooth)


def _between(kept: Clipped, frame: Floats, low: Floats, high: Floats) -> Clipped:
    """Cut to coordinates between limits (d,) [m] along unit vectors, rows of the frame (d, 3)."""
    for axis, least, most in zip(frame, low, high, strict=True):
        for side, limit in ((1.0, least), (-1.0, most)):
            values = side * (kept.surface.control @ axis - limit)
            kept = then(kept, clip(kept.surface, values, on=_ON_OUTLINE))
            if len(kept.parents) == 0:
                return kept
    return kept


def _plane_across(up: Floats, corners: Floats) -> Floats:
    """Two unit vectors across up, the first along the polygon's longest side seen from above, shape (2, 3)."""
    sides = np.roll(corners, -1, axis=0) - corners
    level = sides - (sides @ up)[:, None] * up
    length = np.linalg.norm(level, axis=1)
    longest = int(length.argmax())
    if length[longest] <= _ON_OUTLINE:
        raise InputError("the region's polygon is a point seen from above. Give corners around an area, or set --up.")
    first = level[longest] / length[longest]
    return np.stack([first, np.cross(up, first)])


def _check_polygon(flat: Floats, argument: str) -> None:
    if len(flat) > _MOST_CORNERS:
        raise InputError(f"the region's polygon has {len(flat)} corners, at most {_MOST_CORNERS} are taken.")
    if (np.ptp(flat, axis=0) <= _ON_OUTLINE).any():
        raise InputError(
            f"the corners of region 'polygon:{argument}' lie on a line seen from above. "
            "Give corners around an area, or set --up to the side it is seen from."
        )
    crossing = _first_crossing(flat)
    if crossing is not None:
        one, other = (f"from corner {side + 1} to {(side + 1) % len(flat) + 1}" for side in crossing)
        raise InputError(
            f"the outline of region 'polygon:{argument}' crosses itself: its sides {one} and {other}. "
            "Give the corners in order, once around the area."
        )


def _first_crossing(flat: Floats) -> tuple[int, int] | None:
    """Two sides of a closed polygon (k, 2) that cross, not only touch; None if there are none."""
    ends = np.roll(flat, -1, axis=0)
    for k in range(len(flat) - 1):
        others = slice(k + 1, None)
        crossed = _on_both_sides(flat[k], ends[k], flat[others], ends[others])
        crossed &= _on_both_sides(flat[others], ends[others], flat[k], ends[k])
        if crossed.any():
            return k, k + 1 + int(crossed.argmax())
    return None


def _on_both_sides(a: Floats, b: Floats, p: Floats, q: Floats) -> NDArray[np.bool_]:
    """Whether the line through a and b parts p from q; points (2,) or (m, 2), result (m,)."""
    along = b - a
    length = np.maximum(np.linalg.norm(along, axis=-1), _ON_OUTLINE)
    low, high = np.sort(
        [(along[..., 0] * (r - a)[..., 1] - along[..., 1] * (r - a)[..., 0]) / length for r in (p, q)], axis=0
    )
    return np.asarray((low < -_ON_OUTLINE) & (high > _ON_OUTLINE))


def _inside(points: Floats, polygon: Floats) -> NDArray[np.bool_]:
    """Whether points (n, 2) are within a closed polygon (k, 2): a ray from them crosses it an odd number of times."""
    odd = np.zeros(len(points), dtype=bool)
    for start, end in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        spans = (start[1] > points[:, 1]) != (end[1] > points[:, 1])
        rise = end[1] - start[1]
        across = (end[0] - start[0]) * (points[:, 1] - start[1]) - (points[:, 0] - start[0]) * rise
        odd ^= spans & ((across > 0.0) == (rise > 0.0))
    return odd


def _middles(surface: Surface) -> Floats:
    count = len(surface.faces)
    return surface.evaluate(np.arange(count, dtype=np.int32), np.full((count, 3), 1.0 / 3.0)).positions


def _nothing_in(choice: str, surface: Surface) -> PlanError:
    low, high = (place_in_mm(corner) for corner in surface.bounds)
    return PlanError(f"the region '{choice}' contains nothing of the part, which lies between {low} and {high}.")
