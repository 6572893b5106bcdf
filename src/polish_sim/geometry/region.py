"""Which part of the surface is to be polished (Surface and the user's choice -> Region)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError, PlanError
from polish_sim.geometry.bezier import from_corners
from polish_sim.geometry.boundary import boundary_loops
from polish_sim.geometry.clip import Clipped, clip
from polish_sim.geometry.mesh import PartMesh
from polish_sim.geometry.orientation import UP_CONE
from polish_sim.geometry.surface import Surface
from polish_sim.geometry.topology import Adjacency, facet_links, label_pieces

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]

CHOICES = "auto, top, all, point:X,Y,Z, box:X0,Y0,Z0,X1,Y1,Z1, faces:FILE (lengths in mm)"

_ON_BOX = 1e-7
"""Vertices this close to a face of the box lie on it [m]."""

_POINT_REACH = 0.1
"""A chosen point may be off the part by this share of the part's size."""


@dataclass(frozen=True, eq=False)
class Region:
    """What is to be polished."""

    surface: Surface
    """The surface restricted to the region; facets at its border may be cut."""
    facets: Ints
    """Facet of the whole surface each facet of the region belongs to, shape (k,)."""
    boundary_loops: tuple[Floats, ...]
    """Closed polylines [m], each (p, 3), first point repeated at the end, region on the left; outer first."""
    area_m2: float
    up: Floats
    """Unit vector away from the table, shape (3,)."""


def select_region(surface: Surface, mesh: PartMesh, choice: str = "auto") -> Region:
    """Select the region to polish.

    Args:
        surface: The whole part's surface.
        mesh: The part it was fitted to.
        choice: ``auto`` the largest smooth face that looks up; ``top`` the largest connected piece that
            looks up, over creases; ``all``; ``point:X,Y,Z`` the smooth face at a point;
            ``box:X0,Y0,Z0,X1,Y1,Z1`` the largest smooth face that looks up within a box;
            ``faces:FILE`` the STL facets whose numbers (from 0) a text file lists. Lengths in mm, work frame.

    Returns:
        The region, with clean borders.

    Raises:
        InputError: The choice cannot be understood; lists the valid ones.
        PlanError: Nothing of the part matches.
    """
    name, _, argument = choice.partition(":")
    plain = {"auto": _auto, "top": _top, "all": _all}
    with_argument: dict[str, Callable[[Surface, PartMesh, str], Clipped]]
    with_argument = {"point": _around_point, "box": _in_box, "faces": _listed}
    if name in plain and not argument:
        clipped = plain[name](surface, mesh)
    elif name in with_argument and argument:
        clipped = with_argument[name](surface, mesh, argument)
    else:
        raise InputError(f"unknown region '{choice}'. Valid: {CHOICES}.")
    return Region(
        surface=clipped.surface,
        facets=clipped.parents,
        boundary_loops=boundary_loops(clipped.surface, mesh.up),
        area_m2=float(clipped.surface.facet_areas.sum()),
        up=mesh.up,
    )


def _all(surface: Surface, mesh: PartMesh) -> Clipped:
    everything = np.arange(len(surface.faces), dtype=np.int32)
    return Clipped(surface, everything)


def _auto(surface: Surface, mesh: PartMesh) -> Clipped:
    return _largest_piece(_looking(_all(surface, mesh), mesh.up), mesh.up, over_creases=False)


def _top(surface: Surface, mesh: PartMesh) -> Clipped:
    return _largest_piece(_looking(_all(surface, mesh), mesh.up), mesh.up, over_creases=True)


def _in_box(surface: Surface, mesh: PartMesh, argument: str) -> Clipped:
    x0, y0, z0, x1, y1, z1 = _numbers(argument, 6, "box:X0,Y0,Z0,X1,Y1,Z1")
    low, high = np.minimum([x0, y0, z0], [x1, y1, z1]), np.maximum([x0, y0, z0], [x1, y1, z1])
    if (low == high).any():
        raise InputError(f"region 'box:{argument}' has no volume. Give two opposite corners in mm.")
    kept = _all(surface, mesh)
    for axis in range(3):
        for side, limit in ((1.0, low[axis]), (-1.0, high[axis])):
            values = side * (kept.surface.control[:, :, axis] - limit * 1e-3)
            kept = _then(kept, clip(kept.surface, values, on=_ON_BOX))
            if len(kept.parents) == 0:
                bounds = " .. ".join(_millimetres(corner) for corner in surface.bounds)
                raise PlanError(f"the region 'box:{argument}' contains nothing of the part ({bounds} mm).")
    return _largest_piece(_looking(kept, mesh.up), mesh.up, over_creases=False)


def _around_point(surface: Surface, mesh: PartMesh, argument: str) -> Clipped:
    point = np.array(_numbers(argument, 3, "point:X,Y,Z")) * 1e-3
    found = surface.closest(point[None])
    distance = float(np.linalg.norm(found.positions[0] - point))
    if distance > _POINT_REACH * float(np.ptp(surface.bounds, axis=0).max()):
        raise PlanError(
            f"the region's point ({argument}) mm is {distance * 1e3:.4g} mm away from the part. "
            f"The nearest point of the part is ({_millimetres(found.positions[0])}) mm."
        )
    normal = found.normals[0]
    towards = mesh.up if normal @ mesh.up > np.cos(UP_CONE) else normal
    looking = _looking(_all(surface, mesh), towards)
    labels = _label(looking.surface, over_creases=False)
    at = looking.surface.closest(found.positions).facets[0]
    piece = np.flatnonzero(labels == labels[at]).astype(np.int32)
    return Clipped(looking.surface.restrict(piece), looking.parents[piece])


def _listed(surface: Surface, mesh: PartMesh, argument: str) -> Clipped:
    numbers = _read_facet_numbers(Path(argument))
    place = np.full(mesh.stl_facets.max() + 1, -1, dtype=np.int32)
    place[mesh.stl_facets] = np.arange(len(mesh.stl_facets), dtype=np.int32)
    known = (numbers >= 0) & (numbers < len(place))
    if not known.all():
        raise InputError(
            f"{argument}: facet {numbers[~known][0]} does not exist; facets of the part run from 0 to {len(place) - 1}."
        )
    facets = np.unique(place[numbers])
    facets = facets[facets >= 0]
    return Clipped(surface.restrict(facets), facets)


def _looking(kept: Clipped, direction: Floats) -> Clipped:
    """Keep what looks this way, cut along the line where the normal leaves the cone."""
    corner_normals = kept.surface.normal_control[:, :3]
    values = from_corners((corner_normals @ direction - np.cos(UP_CONE))[..., None])[..., 0]
    looking = _then(kept, clip(kept.surface, values, on=1e-6))
    if len(looking.parents) == 0:
        raise PlanError(
            f"nothing of the region looks up (within {np.degrees(UP_CONE):g} deg). "
            "Set --up to the side to polish, or choose a --region: " + CHOICES + "."
        )
    return looking


def _largest_piece(kept: Clipped, up: Floats, over_creases: bool) -> Clipped:
    labels = _label(kept.surface, over_creases)
    middle = np.full((len(labels), 3), 1.0 / 3.0)
    height = kept.surface.evaluate(np.arange(len(labels), dtype=np.int32), middle).normals @ up
    area = np.bincount(labels, weights=kept.surface.facet_areas * np.maximum(height, 0.0))
    piece = np.flatnonzero(labels == area.argmax()).astype(np.int32)
    return Clipped(kept.surface.restrict(piece), kept.parents[piece])


def _label(surface: Surface, over_creases: bool) -> Ints:
    adjacency = Adjacency(surface.neighbours, surface.neighbour_edges)
    passable = np.ones_like(surface.smooth) if over_creases else surface.smooth
    return label_pieces(facet_links(adjacency, passable), len(surface.faces))[1]


def _then(first: Clipped, second: Clipped) -> Clipped:
    return Clipped(second.surface, first.parents[second.parents])


def _numbers(argument: str, count: int, form: str) -> list[float]:
    try:
        numbers = [float(word) for word in argument.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"region '{argument}' is not {form} ({count} numbers in mm). Valid: {CHOICES}.")
    return numbers


def _read_facet_numbers(path: Path) -> NDArray[np.int64]:
    try:
        lines = path.read_text().splitlines()
        words = [word for line in lines for word in line.partition("#")[0].replace(",", " ").split()]
        numbers = np.array([int(word) for word in words], dtype=np.int64)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}). Give a text file of facet numbers.") from None
    except ValueError:
        raise InputError(f"{path}: not a list of facet numbers (whole numbers from 0, '#' for comments).") from None
    if len(numbers) == 0:
        raise InputError(f"{path}: lists no facet numbers (whole numbers from 0, '#' for comments).")
    return numbers


def _millimetres(point: Floats) -> str:
    return ", ".join(f"{value * 1e3:.4g}" for value in point)
