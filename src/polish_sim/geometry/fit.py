"""Fit quadratic Bezier triangles to the mesh of a part, and to that of the fixture that holds it: creases
stay sharp, planes flat, the skin watertight (mesh -> Surface)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, Ints, by_slices, dots, into_plane, next_corners, norms, unit
from polish_sim.geometry.bezier import area_elements, edge_control, quadratic_normals
from polish_sim.geometry.features import (
    FEATURE_ANGLE,
    SharpLines,
    crease_tangents,
    facet_cross,
    facet_normals,
    sharp_lines,
    smooth_corners,
    smooth_edges,
)
from polish_sim.geometry.jets import fit_vertex_jets
from polish_sim.geometry.mesh import PartMesh, load_part
from polish_sim.geometry.surface import SourcePatches, Surface, build_on, join_surfaces
from polish_sim.geometry.topology import Adjacency, find_adjacency

FLAT_TILT = 1e-7  #: A facet is flat when its corners' normals differ from its own by less than this [rad]
#: A patch folds where its area element, seen along the facet's normal, turns negative by this share
FOLDED = -1e-3
UNFOLD_ROUNDS = 4
STEEPEST = np.radians(45.0)  #: An edge whose end tangents leave the chord by more stays straight [rad]


def fit_surface(mesh: PartMesh, feature_angle: float = FEATURE_ANGLE) -> Surface:
    """Fit one quadratic Bezier triangle to each facet (paper 1, eq. 1-4), in the work frame.

    Edges that bend more than ``feature_angle`` [rad] stay sharp.
    """
    return fit_triangles(mesh.vertices, mesh.faces, feature_angle)


def fit_triangles(vertices: Array, faces: Ints, feature_angle: float = FEATURE_ANGLE) -> Surface:
    """Fit bare triangles, vertices (n, 3) [m] and faces (m, 3); see :func:`fit_surface`."""
    adjacency = find_adjacency(faces)
    normals, _ = facet_normals(vertices, faces)
    smooth = smooth_edges(normals, adjacency, feature_angle)
    corners = smooth_corners(vertices, faces, adjacency, smooth, feature_angle)
    jets = fit_vertex_jets(vertices, faces, adjacency, corners, smooth)
    corner_normals = jets.normals[corners.ids]
    lines = sharp_lines(vertices, faces, smooth)
    control = by_slices(partial(_patches, vertices, lines), faces, adjacency.facets, corner_normals, smooth)
    facet, edge = np.nonzero(smooth & (adjacency.facets < np.arange(len(faces))[:, None]))
    # to the last digit
    control[facet, 3 + edge] = control[adjacency.facets[facet, edge], 3 + adjacency.edges[facet, edge]]
    flat = np.abs(corner_normals - normals[:, None, :]).max(axis=(1, 2)) < FLAT_TILT
    source = SourcePatches(
        by_slices(lambda f, n: quadratic_normals(vertices[f], n), faces, corner_normals),
        np.concatenate([jets.shape, np.zeros((1, 6))]),
        np.where(flat[:, None], np.int32(len(jets.shape)), corners.ids),
    )
    rows, control = np.arange(len(faces), dtype=np.int32), _unfold(control, normals, adjacency)
    return build_on(source, rows, vertices, faces, control, *adjacency, smooth)


def _unfold(control: Array, normals: Array, adjacency: Adjacency) -> Array:
    """Straighten in place the edges of patches that would fold over: slivers beside a strongly curved
    crease."""
    for _ in range(UNFOLD_ROUNDS):
        folded = by_slices(_folds, control, normals)
        if not folded.any():
            break
        straight = np.repeat(folded[:, None], 3, axis=1)
        facet, edge = np.nonzero(straight & (adjacency.facets >= 0))
        straight[adjacency.facets[facet, edge], adjacency.edges[facet, edge]] = True
        middles = 0.5 * (control[:, :3] + next_corners(control[:, :3]))
        control[:, 3:] = np.where(straight[..., None], middles, control[:, 3:])
    return control


def _folds(control: Array, normals: Array) -> Bools:
    """Patches whose normal turns over at a corner or in the middle of an edge, shape (m,)."""
    least = FOLDED * norms(facet_cross(control[:, :3]))
    places = [*np.eye(3), *(0.5 * (1.0 - np.eye(3)))]
    return np.any([dots(area_elements(control, *place), normals) < least for place in places], axis=0)


def _patches(
    vertices: Array, lines: SharpLines, faces: Ints, neighbours: Ints, corner_normals: Array, smooth: Bools
) -> Array:
    """Control points of each facet's patch, shape (m, 6, 3); on an edge the same number from both sides."""
    first, second = faces, next_corners(faces)
    swap = first > second
    low, high = np.where(swap, second, first), np.where(swap, first, second)
    start, end = vertices[low], vertices[high]
    unit_chord = unit(end - start)
    # Along a crease both sides take the crease's own direction; inside, the chord turned into the tangent
    # plane.
    start_way, end_way = crease_tangents(lines, low, high, unit_chord, smooth)
    normal_ahead = next_corners(corner_normals)
    start_normal = np.where(swap[..., None], normal_ahead, corner_normals)
    end_normal = np.where(swap[..., None], corner_normals, normal_ahead)
    turned = (smooth | (neighbours < 0))[..., None]
    start_way = unit(np.where(turned, into_plane(start_way, start_normal), start_way))
    end_way = unit(np.where(turned, into_plane(end_way, end_normal), end_way))
    too_steep = np.minimum(dots(start_way, unit_chord), dots(end_way, unit_chord)) < np.cos(STEEPEST)
    start_way = np.where(too_steep[..., None], unit_chord, start_way)
    end_way = np.where(too_steep[..., None], unit_chord, end_way)
    return np.concatenate([vertices[faces], edge_control(start, end, start_way, end_way)], axis=1)


class Fixture(NamedTuple):
    """What holds the part and the tool must keep clear of: a mesh in the part's own frame, read as a part
    is."""

    mesh: PartMesh
    surface: Surface

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or repaired, for the user; which side is up is the part's affair."""
        return tuple(f"fixture: {note}" for note in self.mesh.notes[:-1])


def load_fixture(file: str, part: PartMesh) -> Fixture | None:
    """Load the fixture of a part, in the part's unit; None without a ``file``.

    Raises:
        MeshError: The file is no usable mesh; the message says why and what to do.
    """
    if not file:
        return None
    mesh = load_part(Path(file), part.unit, "z")
    return Fixture(mesh, fit_surface(mesh))


def joined_meshes(part: PartMesh, fixture: Fixture | None) -> PartMesh:
    """A part and its fixture as one mesh; the part's name and notes."""
    if fixture is None:
        return part
    own = fixture.mesh
    return replace(
        part,
        vertices=np.concatenate([part.vertices, own.vertices]),
        faces=np.concatenate([part.faces, own.faces + len(part.vertices)]).astype(np.int32),
        stl_facets=np.concatenate([part.stl_facets, np.full_like(own.stl_facets, -1)]),
    )


def joined_surfaces(part: Surface, fixture: Fixture | None) -> Surface:
    """A part and its fixture as one surface, the part's facets first."""
    return part if fixture is None else join_surfaces([part, fixture.surface])
