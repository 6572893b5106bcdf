"""Which part of the surface is to be polished (Surface and the user's choice -> Region)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from polish_sim.arrays import Array, Ints
from polish_sim.errors import InputError
from polish_sim.geometry.cut import Clipped
from polish_sim.geometry.features import facet_normals, smooth_edges
from polish_sim.geometry.mesh import PartMesh, check_unit
from polish_sim.geometry.orientation import UP_CONE, check_up
from polish_sim.geometry.regions.choice import CHOICES, PLAIN, WITH_ARGUMENT, Whole, pick_all
from polish_sim.geometry.regions.margin import Room, keep_roomy, trim
from polish_sim.geometry.regions.patches import connected, facing, unpinch
from polish_sim.geometry.surface import Surface, along_edges, border_edges, connected_facets, join_surfaces
from polish_sim.models import part_path

if TYPE_CHECKING:
    from polish_sim.config import PartConfig, PlanConfig


CHORD_ERROR = 1e-5  #: Curved border edges are divided until the polyline is this close to them [m]
SLIVER_SHARE = 1e-3  #: Patches smaller than this share of the largest one are left out


@dataclass(frozen=True, eq=False)
class Region:
    """What is to be polished."""

    surface: Surface  #: The surface restricted to the region; facets at its border may be cut
    facets: Ints  #: Facet of the whole surface each facet of the region belongs to, shape (k,)
    area_m2: float
    up: Array
    """Unit vector from where the region is looked at: away from the table; for a connected region that does
    not look up, its mean normal. Shape (3,)."""
    notes: tuple[str, ...] = ()  #: What was left out or cut, for the user

    @cached_property
    def boundary_loops(self) -> tuple[Array, ...]:
        """Closed polylines [m], each (p, 3), first point repeated at the end, region on the left; component
        by component, of each the outer one first."""
        loops = []
        for edges in border_edges(self.surface):
            line, _ = along_edges(self.surface, edges, CHORD_ERROR)
            loops.append(np.concatenate([line, line[:1]]))
            loops[-1].setflags(write=False)
        return tuple(loops)

    def components(self) -> tuple[Region, ...]:
        """Connected components, each with its own border, the largest first; itself if it is connected."""
        return self._components

    @cached_property
    def _components(self) -> tuple[Region, ...]:
        pieces = connected(Clipped(self.surface, self.facets))
        if len(pieces) == 1:
            return (self,)
        return tuple(_build_region([piece], self.up) for piece in pieces)


def select_region(
    surface: Surface,
    mesh: PartMesh,
    choice: str = "auto",
    feature_angle: float | None = None,
    edge_margin: float = 0.0,
    hole_margin: float = 0.0,
) -> Region:
    """Select the region to polish, with clean borders; several components are possible.

    Args:
        surface: The whole part's surface.
        mesh: The part it was fitted to.
        choice: ``auto`` the largest smooth face that looks up; ``top`` the largest connected piece that
            looks up, over creases; ``all`` everything, in patches; ``all:N,N,.../SIDE`` some of these patches
            by their numbers, counted with a side up; ``point:X,Y,Z`` the smooth face at a point;
            ``box:X0,Y0,Z0,X1,Y1,Z1`` the smooth faces that look up within a box; ``polygon:X,Y,Z;X,Y,Z;...``
            (or a file with a corner per line) those within a polygon seen from above; ``faces:FILE`` the
            facets whose numbers (from 0) in the part's file a text file lists. Lengths in mm, work frame.
        feature_angle: Edges that bend more are creases [rad]; None for the creases of the surface.
        edge_margin: How far the region keeps from its outer borders, measured along the surface [m].
        hole_margin: How far it keeps from the borders of holes [m].

    Raises:
        InputError: The choice cannot be understood; lists the valid ones.
        PlanError: Nothing of the part matches, or nothing is left within the margin.
    """
    check_choice(choice)
    name, _, argument = choice.partition(":")
    pick = (WITH_ARGUMENT if argument else PLAIN)[name].pick
    whole = Whole(_with_creases(surface, mesh, feature_angle), mesh)
    patches, notes = _without_slivers(pick(whole, argument))
    if name == "auto":
        notes += _cut_off(whole, patches)
    return inside_margins(patches, mesh.up, edge_margin, hole_margin, notes)


def patches_of(surface: Surface, mesh: PartMesh) -> list[Clipped]:
    """All of a part in patches that lie open, in the order ``all:N,N,.../SIDE`` counts them with its side
    up."""
    return pick_all(Whole(surface, mesh), "")


def inside_margins(
    patches: Sequence[Clipped], up: Array, edge_margin: float, hole_margin: float, notes: tuple[str, ...] = ()
) -> Region:
    """A region of patches without their margins; arguments and errors as of `select_region`."""
    patches, further = _without_slivers(trim(patches, edge_margin, hole_margin))
    return _build_region(patches, up, notes + further)


def cut_region(region: Region, room: Room, margin: float) -> Region | None:
    """Keep what of a region has more ``room`` than a margin [m], patches tiny beside it left out.

    The region itself if it is all there, None if nothing is.
    """
    patches = connected(Clipped(region.surface, region.facets))
    left = [piece for patch in patches for piece in keep_roomy(patch, room, margin)]
    if not left:
        return None
    return _build_region(_without_slivers(left)[0], region.up, region.notes)


def check_choice(choice: str) -> None:
    """Refuse an invalid choice of a region, see `select_region`, before the part is loaded; a file it names
    is read.

    Raises:
        InputError: It cannot be understood; lists the valid ones.
    """
    name, _, argument = choice.partition(":")
    known = WITH_ARGUMENT if argument else PLAIN
    if name not in known or choice.endswith(":"):
        raise InputError(f"unknown region '{choice}'. Valid: {CHOICES}.")
    known[name].read(argument)


def check_part_words(part: PartConfig, plan: PlanConfig) -> None:
    """Refuse unknown names of part, unit, side and region before the part is loaded.

    Raises:
        InputError: Naming what is valid.
    """
    part_path(part.file)
    check_unit(part.unit)
    check_up(part.up)
    check_choice(plan.region)


def _build_region(patches: Sequence[Clipped], up: Array, notes: tuple[str, ...] = ()) -> Region:
    """Make a region of patches of a part, unconnected; pinched vertices are parted."""
    surface = unpinch(join_surfaces([patch.surface for patch in patches]))
    return Region(
        surface=surface,
        facets=np.concatenate([patch.parents for patch in patches]),
        area_m2=surface.facet_areas.sum(),
        up=_seen_from(surface, up),
        notes=notes,
    )


def merge_regions(components: Sequence[Region], up: Array, notes: tuple[str, ...]) -> Region:
    """Make one region of several unconnected ones of a part; they are its components."""
    return _build_region([Clipped(part.surface, part.facets) for part in components], up, notes)


def _seen_from(surface: Surface, up: Array) -> Array:
    mean = facing(surface)
    length = np.linalg.norm(mean)
    if length < 0.1 or mean @ up > np.cos(UP_CONE) * length:
        return up
    mean = mean / length
    mean.setflags(write=False)
    return mean


def _with_creases(surface: Surface, mesh: PartMesh, feature_angle: float | None) -> Surface:
    """The surface with its creases where the flat facets bend by more than the feature angle."""
    if feature_angle is None:
        return surface
    normals, _ = facet_normals(mesh.vertices, mesh.faces)
    smooth = smooth_edges(normals, surface.adjacency, feature_angle)
    return surface if np.array_equal(smooth, surface.smooth) else replace(surface, smooth=smooth)


def _cut_off(whole: Whole, patches: Sequence[Clipped]) -> tuple[str, ...]:
    """Say how much of the smooth face that was picked looks too far away from up and is left out."""
    labels = connected_facets(whole.surface, whole.surface.smooth)
    face = np.isin(labels, labels[np.concatenate([patch.parents for patch in patches])])
    area = whole.surface.facet_areas[face].sum()
    kept = sum(patch.surface.facet_areas.sum() for patch in patches)
    if kept >= (1.0 - SLIVER_SHARE) * area:
        return ()
    return (
        f"region: {kept * 1e4:.4g} of the {area * 1e4:.4g} cm^2 of the smooth face; what looks more than "
        f"{np.degrees(UP_CONE):g} deg away from up is left out (--region all takes everything, in patches)",
    )


def _without_slivers(patches: list[Clipped]) -> tuple[list[Clipped], tuple[str, ...]]:
    """Leave out patches that are tiny beside the whole, with a note."""
    areas = np.array([patch.surface.facet_areas.sum() for patch in patches])
    large = areas >= SLIVER_SHARE * areas.max()
    if large.all():
        return patches, ()
    count, lost = np.count_nonzero(~large), areas[~large].sum()
    what = "1 patch" if count == 1 else f"{count} patches"
    note = (
        f"left out {what} of the region, below {SLIVER_SHARE:.1%} of the largest: {lost * 1e6:.3g} mm^2 "
        "in all"
    )
    return [patch for patch, keep in zip(patches, large, strict=True) if keep], (note,)
