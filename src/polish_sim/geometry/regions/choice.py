"""Choices of a region: by where the part looks, at a point, by facet numbers, within a box or a polygon."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, Indices, longest_side, norms
from polish_sim.errors import InputError, PlanError, place_in_mm, read_bytes
from polish_sim.geometry.bezier import from_corners
from polish_sim.geometry.cut import Clipped, clip, split, then
from polish_sim.geometry.mesh import PartMesh
from polish_sim.geometry.orientation import UP_CONE, check_up
from polish_sim.geometry.polygon_files import read_vertex_column
from polish_sim.geometry.regions.patches import connected, coverable, lies_open, middle_points, restricted
from polish_sim.geometry.surface import ClosestPoints, Surface, connected_facets
from polish_sim.scenario_file import numbers_of

CHOICES = (
    "auto, top, all, all:N,N,.../SIDE, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, polygon:X,Y,Z;X,Y,Z;..., "
    "polygon:FILE, faces:FILE, under:REMOVAL.ply:SHARE (lengths in mm)"
)


def _parse_numbers(argument: str, count: int, form: str) -> list[float]:
    """Numbers separated by commas, as many as asked for."""
    numbers = numbers_of(argument, count)
    if not numbers:
        name = form.partition(":")[0]
        raise InputError(
            f"region '{name}:{argument}' is not {form} ({count} numbers in mm). Valid: {CHOICES}."
        )
    return numbers


def parse_point(argument: str) -> Array:
    """Read a point [m], shape (3,)."""
    return np.array(_parse_numbers(argument, 3, "point:X,Y,Z")) * 1e-3


def parse_box(argument: str) -> Array:
    """Read the least and the greatest corner of a box [m], shape (2, 3).

    Raises:
        InputError: Not six numbers, or a box without volume.
    """
    corners = np.sort(np.reshape(_parse_numbers(argument, 6, "box:X0,Y0,Z0,X1,Y1,Z1"), (2, 3)), axis=0)
    if (corners[0] == corners[1]).any():
        raise InputError(f"region 'box:{argument}' has no volume. Give two opposite corners in mm.")
    return corners * 1e-3


def parse_corners(argument: str) -> Array:
    """Read the corners of a polygon, in the option itself or from a file [m], shape (n, 3).

    Raises:
        InputError: Not a list of three or more corners.
    """
    named = ";" not in argument
    lines = (
        _read(Path(argument), "corners x, y, z in mm, one per line").splitlines()
        if named
        else argument.split(";")
    )
    rows = [_words(line) for line in lines]
    try:
        corners = np.array([[*map(float, row), 0.0][:3] for row in rows if row])
    except ValueError:
        corners = np.empty(0)
    whole = all(len(row) in (0, 2, 3) for row in rows)
    if not whole or corners.ndim != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError(
            f"region 'polygon:{argument}' is not a polygon: give three or more corners X,Y,Z;X,Y,Z;... in "
            "mm, or a text file with x, y, z of one corner per line ('#' for comments)."
        )
    return corners * 1e-3


def _words(line: str) -> list[str]:
    """Of a line of a text, without its comment."""
    return line.partition("#")[0].replace(",", " ").split()


def read_facet_numbers(argument: str) -> Indices:
    """Read facet numbers from a text file, shape (n,).

    Raises:
        InputError: The file cannot be read, or holds something else.
    """
    path = Path(argument)
    lines = _read(path, "facet numbers").splitlines()
    try:
        numbers = np.array([int(word) for line in lines for word in _words(line)], dtype=np.int64)
    except (ValueError, OverflowError):
        raise InputError(
            f"{path}: not a list of facet numbers (whole numbers from 0, '#' for comments)."
        ) from None
    if len(numbers) == 0:
        raise InputError(f"{path}: lists no facet numbers (whole numbers from 0, '#' for comments).")
    return numbers


class PatchNumbers(NamedTuple):
    """Some of the patches of all."""

    numbers: Indices  #: From 1, shape (k,)
    up: Array  #: The side turned up when they were counted, unit vector, shape (3,)


def parse_patches(argument: str) -> PatchNumbers:
    """Read numbers of patches and the side they were counted by, as ``plan --region all`` writes them.

    Raises:
        InputError: Not N,N,.../SIDE.
    """
    words, _, side = argument.partition("/")
    up = check_up(side)
    if up is None or not all(
        word.isdecimal() and 0 < len(word) < 10 and int(word) for word in words.split(",")
    ):
        raise InputError(
            f"region 'all:{argument}' is not all:N,N,.../SIDE: numbers of patches from 1, and the side they "
            f"were counted by, e.g. all:1,3/z. Valid: {CHOICES}."
        )
    return PatchNumbers(np.array([int(word) for word in words.split(",")]), up)


def _read(path: Path, content: str) -> str:
    try:
        return read_bytes(path, f"file of {content}").decode()
    except ValueError:
        raise InputError(f"{path}: is not a text file. Give a text file of {content}.") from None


_ON_CONE = 1e-6  #: Corners whose normal is this close to the cone lie on its edge
_POINT_REACH = 0.1  #: A chosen point may be off the part by this share of the part's size


class Whole(NamedTuple):
    """The part a region is chosen from."""

    surface: Surface  #: Its surface, creases as the user wants them
    mesh: PartMesh  #: The mesh it was fitted to

    @property
    def up(self) -> Array:
        """Unit vector away from the table, shape (3,)."""
        return self.mesh.up

    @property
    def kept(self) -> Clipped:
        """All of it."""
        return Clipped(self.surface, np.arange(len(self.surface.faces), dtype=np.int32))


def pick_auto(whole: Whole, _: str) -> list[Clipped]:
    """Pick the largest smooth face that looks up."""
    above = looking(whole.kept, whole.up)
    return [_largest(above, whole.up, above.surface.smooth)]


def pick_top(whole: Whole, _: str) -> list[Clipped]:
    """Pick the largest connected piece that looks up, over creases."""
    return [_largest(looking(whole.kept, whole.up), whole.up, None)]


def pick_all(whole: Whole, _: str) -> list[Clipped]:
    """Everything, in patches that lie open."""
    return coverable(whole.kept, whole.up)


def pick_patches(whole: Whole, argument: str) -> list[Clipped]:
    """Some patches of all by their numbers."""
    numbers, up = parse_patches(argument)
    patches = coverable(whole.kept, up)
    if numbers.max() > len(patches):
        raise PlanError(
            f"region 'all:{argument}': the part has patches 1 to {len(patches)}, seen with that side up."
        )
    return [patches[number - 1] for number in np.unique(numbers)]


def nearest_on(part: Surface, point: Array, what: str) -> ClosestPoints:
    """The point of a part nearest to one a user names (3,) [m].

    Raises:
        PlanError: It is further off than a tenth of the part's size; says ``what`` is.
    """
    found = part.closest(point)
    distance = norms(found.positions - point)[0]
    if distance > _POINT_REACH * longest_side(part.bounds):
        raise PlanError(
            f"the {what} is {distance * 1e3:.4g} mm away from the part. "
            f"The nearest point of the part is {place_in_mm(found.positions[0])}."
        )
    return found


def pick_point(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the smooth face at a point; of one that goes round, what looks up with it or the way the point
    looks."""
    found = nearest_on(whole.surface, parse_point(argument), f"region's point ({argument}) mm")
    face = _flood(whole.kept, found.facets[0])
    if lies_open(face.surface):
        return [face]
    normal = found.normals[0]
    seen = looking(face, whole.up if normal @ whole.up > np.cos(UP_CONE) else normal)
    return [_flood(seen, seen.surface.closest(found.positions).facets[0])]


def pick_faces(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the facets a file lists by their numbers in the part's file."""
    numbers = read_facet_numbers(argument)
    last = whole.mesh.last_facet
    unknown = numbers[(numbers < 0) | (numbers > last)]
    if len(unknown):
        raise InputError(
            f"{argument}: facet {unknown[0]} does not exist; facets of the part run from 0 to {last}."
        )
    # A facet of the file may be several of ours, and one that closes a hole is none of the file's.
    facets = np.flatnonzero(np.isin(whole.mesh.stl_facets, numbers))
    if len(facets) == 0:
        raise PlanError(
            f"{argument}: all facets it lists were dropped when the part was repaired. List others."
        )
    return coverable(restricted(whole.kept, facets), whole.up)


def looking(kept: Clipped, direction: Array) -> Clipped:
    """Keep what looks this way, cut along the line where the normal leaves the cone.

    Raises:
        PlanError: Nothing does.
    """
    corner_normals = kept.surface.normal_control[:, :3]
    values = from_corners((corner_normals @ direction - np.cos(UP_CONE))[..., None])[..., 0]
    seen = then(kept, clip(kept.surface, values, on=_ON_CONE))
    if len(seen.parents) == 0:
        raise PlanError(
            f"nothing of the region looks up (within {np.degrees(UP_CONE):g} deg). "
            "Set --up to the side to polish, or choose a --region: " + CHOICES + "."
        )
    return seen


FINE = 0.005  #: A map of removal is looked at in pieces no wider than this [m]


class RemovalLimit(NamedTuple):
    """Where a run took off less than a share of its mean."""

    places: Array  #: Vertices of its map [m], shape (n, 3)
    relative: Array  #: Removal there over its mean [-], shape (n,)
    share: float


def parse_under(argument: str) -> RemovalLimit:
    """Read a map of removal and the share of its mean below which a place is to be polished.

    Raises:
        InputError: Not FILE:SHARE, or no such map.
    """
    file, _, word = argument.rpartition(":")
    try:
        share = float(word)
    except ValueError:
        share = math.nan
    if not 0.0 < share < 10.0 or not file:
        raise InputError(
            f"region 'under:{argument}' is not under:REMOVAL.ply:SHARE, e.g. under:removal.ply:0.8."
        )
    return RemovalLimit(*read_vertex_column(Path(file), ("relative",)), share)


def pick_under(whole: Whole, argument: str) -> list[Clipped]:
    """Pick what looks up and has lost less than a share of the mean in a run.

    Raises:
        PlanError: Nothing has.
    """
    removed = parse_under(argument)
    kept = looking(whole.kept, whole.up)
    for axis in np.eye(3):
        heights = kept.surface.control @ axis
        for level in np.arange(heights.min() + FINE, heights.max(), FINE):
            kept = then(kept, split(kept.surface, kept.surface.control @ axis - level, on=_ON_OUTLINE))
    away, nearest = cKDTree(removed.places).query(kept.surface.vertices)
    missing = np.where(away < FINE, removed.share - removed.relative[nearest], -1.0)
    kept = then(kept, clip(kept.surface, from_corners(missing[kept.surface.faces][..., None])[..., 0]))
    if len(kept.parents) == 0:
        raise PlanError(f"region 'under:{argument}': nowhere has less come off. Give a larger share.")
    return connected(kept, kept.surface.smooth)


def _largest(kept: Clipped, up: Array, passable: Bools | None) -> Clipped:
    """Keep the piece that is largest seen from above; of equals the first."""
    labels = connected_facets(kept.surface, passable)
    height = middle_points(kept.surface).normals @ up
    area = np.bincount(labels, weights=kept.surface.facet_areas * np.maximum(height, 0.0))
    best = np.flatnonzero(area >= (1.0 - 1e-9) * area.max())[0]
    return restricted(kept, np.flatnonzero(labels == best))


def _flood(kept: Clipped, start: int) -> Clipped:
    """Keep all that is smoothly joined to a facet."""
    labels = connected_facets(kept.surface, kept.surface.smooth)
    return restricted(kept, np.flatnonzero(labels == labels[start]))


_ON_OUTLINE = 1e-7  #: Vertices this close to an outline lie on it [m]
_MOST_CORNERS = 1000


def pick_box(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the smooth faces that look up within a box."""
    low, high = parse_box(argument)
    seen = looking(_between(whole, np.eye(3), low, high, f"box:{argument}"), whole.up)
    return connected(seen, seen.surface.smooth)


def pick_polygon(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the smooth faces that look up within a polygon seen from above."""
    from matplotlib.path import Path as Outline  # slow to import

    corners = parse_corners(argument)
    frame = _plane_across(whole.up, corners)
    flat = corners @ frame.T
    _check_polygon(flat, argument)
    kept = looking(
        _between(whole, frame, flat.min(axis=0), flat.max(axis=0), f"polygon:{argument}"), whole.up
    )
    for start, end in zip(flat, np.roll(flat, -1, axis=0), strict=True):
        side = end - start
        length = np.linalg.norm(side)
        if length > _ON_OUTLINE:
            across = np.array([-side[1], side[0]]) / length
            values = kept.surface.control @ (across @ frame) - (across @ start)
            kept = then(kept, split(kept.surface, values, on=_ON_OUTLINE))
    inside = Outline(flat).contains_points(middle_points(kept.surface).positions @ frame.T)
    if not inside.any():
        raise _nothing_in(f"polygon:{argument}", whole.surface)
    kept = restricted(kept, np.flatnonzero(inside))
    return connected(kept, kept.surface.smooth)


def _between(whole: Whole, frame: Array, low: Array, high: Array, choice: str) -> Clipped:
    """Cut to coordinates between limits (d,) [m] along unit vectors, rows of the frame (d, 3).

    Raises:
        PlanError: Nothing is there; names the choice.
    """
    kept = whole.kept
    for axis, least, most in zip(frame, low, high, strict=True):
        for side, limit in ((1.0, least), (-1.0, most)):
            values = side * (kept.surface.control @ axis - limit)
            kept = then(kept, clip(kept.surface, values, on=_ON_OUTLINE))
            if len(kept.parents) == 0:
                raise _nothing_in(choice, whole.surface)
    return kept


def _plane_across(up: Array, corners: Array) -> Array:
    """Two unit vectors across up, the first along the polygon's longest side seen from above, shape (2,
    3)."""
    sides = np.roll(corners, -1, axis=0) - corners
    level = sides - (sides @ up)[:, None] * up
    length = norms(level)
    longest = length.argmax()
    if length[longest] <= _ON_OUTLINE:
        raise InputError(
            "the region's polygon is a point seen from above. Give corners around an area, or set --up."
        )
    first = level[longest] / length[longest]
    return np.stack([first, np.cross(up, first)])


def _check_polygon(flat: Array, argument: str) -> None:
    if len(flat) > _MOST_CORNERS:
        raise InputError(f"the region's polygon has {len(flat)} corners, at most {_MOST_CORNERS} are taken.")
    if (np.ptp(flat, axis=0) <= _ON_OUTLINE).any():
        raise InputError(
            f"the corners of region 'polygon:{argument}' lie on a line seen from above. "
            "Give corners around an area, or set --up to the side it is seen from."
        )
    if crossing := _first_crossing(flat):
        one, other = (f"from corner {side + 1} to {(side + 1) % len(flat) + 1}" for side in crossing)
        raise InputError(
            f"the outline of region 'polygon:{argument}' crosses itself: its sides {one} and {other}. "
            "Give the corners in order, once around the area."
        )


def _first_crossing(flat: Array) -> tuple[int, int] | None:
    """Two sides of a closed polygon (k, 2) that cross, not only touch; None if there are none."""
    ends = np.roll(flat, -1, axis=0)
    for k in range(len(flat) - 1):
        others = slice(k + 1, None)
        crossed = _on_both_sides(flat[k], ends[k], flat[others], ends[others])
        crossed &= _on_both_sides(flat[others], ends[others], flat[k], ends[k])
        if crossed.any():
            return k, k + 1 + int(crossed.argmax())
    return None


def _on_both_sides(a: Array, b: Array, p: Array, q: Array) -> Bools:
    """Whether the line through a and b parts p from q; points (2,) or (m, 2), result (m,)."""
    along = b - a
    length = np.maximum(norms(along), _ON_OUTLINE)
    low, high = np.sort(
        [(along[..., 0] * (r - a)[..., 1] - along[..., 1] * (r - a)[..., 0]) / length for r in (p, q)], axis=0
    )
    return (low < -_ON_OUTLINE) & (high > _ON_OUTLINE)


def _nothing_in(choice: str, surface: Surface) -> PlanError:
    low, high = (place_in_mm(corner) for corner in surface.bounds)
    return PlanError(
        f"the region '{choice}' contains nothing of the part, which lies between {low} and {high}."
    )


class Choice(NamedTuple):
    """How a region is chosen."""

    pick: Callable[[Whole, str], list[Clipped]]  #: Patches of the part, from the argument
    #: Reads the argument, to refuse a wrong one before the part is loaded
    read: Callable[[str], object] = str


PLAIN: Mapping[str, Choice] = {"auto": Choice(pick_auto), "top": Choice(pick_top), "all": Choice(pick_all)}
WITH_ARGUMENT: Mapping[str, Choice] = {
    "all": Choice(pick_patches, parse_patches),
    "point": Choice(pick_point, parse_point),
    "box": Choice(pick_box, parse_box),
    "polygon": Choice(pick_polygon, parse_corners),
    "faces": Choice(pick_faces, read_facet_numbers),
    "under": Choice(pick_under, parse_under),
}
