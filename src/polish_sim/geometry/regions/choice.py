"""Choices by where the part looks: the largest smooth face, everything above, all of it, the face at a point."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError, PlanError, place_in_mm
from polish_sim.geometry.bezier import from_corners
from polish_sim.geometry.boundary import connected_facets
from polish_sim.geometry.clip import Clipped, clip, then
from polish_sim.geometry.orientation import UP_CONE
from polish_sim.geometry.regions.patches import coverable, lies_open, middle_normals, restricted
from polish_sim.geometry.regions.words import CHOICES, parse_point, read_facet_numbers
from polish_sim.geometry.surface import Surface

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_ON_CONE = 1e-6
"""Corners whose normal is this close to the cone lie on its edge."""

_POINT_REACH = 0.1
"""A chosen point may be off the part by this share of the part's size."""


class Whole(NamedTuple):
    """The part a region is chosen from."""

    surface: Surface
    """Its surface, creases as the user wants them."""
    up: Floats
    """Unit vector away from the table, shape (3,)."""
    stl_facets: NDArray[np.int32]
    """Number of each facet in the file, -1 where there is none, shape (m,)."""

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


def pick_point(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the smooth face at a point; of one that goes round, what looks up with it or the way the point looks."""
    point = parse_point(argument)
    found = whole.surface.closest(point[None])
    distance = float(np.linalg.norm(found.positions[0] - point))
    if distance > _POINT_REACH * float(np.ptp(whole.surface.bounds, axis=0).max()):
        raise PlanError(
            f"the region's point ({argument}) mm is {distance * 1e3:.4g} mm away from the part. "
            f"The nearest point of the part is {place_in_mm(found.positions[0])}."
        )
    face = _flood(whole.kept, int(found.facets[0]))
    if lies_open(face.surface):
        return [face]
    normal = found.normals[0]
    seen = looking(face, whole.up if normal @ whole.up > np.cos(UP_CONE) else normal)
    return [_flood(seen, int(seen.surface.closest(found.positions).facets[0]))]


def pick_faces(whole: Whole, argument: str) -> list[Clipped]:
    """Pick the facets a file lists by their numbers in the part's file."""
    numbers = read_facet_numbers(argument)
    highest = int(whole.stl_facets.max())
    unknown = numbers[(numbers < 0) | (numbers > highest)]
    if len(unknown):
        raise InputError(f"{argument}: facet {unknown[0]} does not exist; facets of the part run from 0 to {highest}.")
    # A facet of the file may be several of ours, and one that closes a hole is none of the file's.
    facets = np.flatnonzero(np.isin(whole.stl_facets, numbers)).astype(np.int32)
    if len(facets) == 0:
        raise PlanError(f"{argument}: all facets it lists were dropped when the part was repaired. List others.")
    return coverable(restricted(whole.kept, facets), whole.up)


def looking(kept: Clipped, direction: Floats) -> Clipped:
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


def _largest(kept: Clipped, up: Floats, passable: Bools | None) -> Clipped:
    """Keep the piece that is largest seen from above; of equals the first."""
    labels = connected_facets(kept.surface, passable)
    height = middle_normals(kept.surface) @ up
    area = np.bincount(labels, weights=kept.surface.facet_areas * np.maximum(height, 0.0))
    best = int(np.flatnonzero(area >= (1.0 - 1e-9) * area.max())[0])
    return restricted(kept, np.flatnonzero(labels == best).astype(np.int32))


def _flood(kept: Clipped, start: int) -> Clipped:
    """Keep all that is smoothly joined to a facet."""
    labels = connected_facets(kept.surface, kept.surface.smooth)
    return restricted(kept, np.flatnonzero(labels == labels[start]).astype(np.int32))
