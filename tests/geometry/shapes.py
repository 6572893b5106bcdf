"""Meshes with a closed form: points on them, normals and curvatures; solids, parts and regions."""

import struct
import tracemalloc
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from polish_sim.arrays import unit
from polish_sim.errors import MeshError
from polish_sim.geometry import PartMesh, Region, fit_surface, load_part, part_from_arrays, select_region
from polish_sim.geometry.fit import fit_triangles
from polish_sim.geometry.surface import Surface, SurfacePoints

Floats = NDArray[np.float64]

# Solids [mm].
BLOCK = trimesh.creation.box((100.0, 60.0, 20.0))
BALL = trimesh.creation.icosphere(subdivisions=4, radius=50.0)
FINE_BALL = trimesh.creation.icosphere(subdivisions=5, radius=50.0)
TORUS = trimesh.creation.torus(major_radius=40.0, minor_radius=15.0, major_sections=96, minor_sections=48)
RING = trimesh.creation.annulus(r_min=10.0, r_max=30.0, height=20.0, sections=48)


def part_of(mesh: trimesh.Trimesh, up: str = "z", unit: str = "mm") -> PartMesh:
    return part_from_arrays(np.array(mesh.vertices), np.array(mesh.faces), unit=unit, up=up)


def region_of(mesh: trimesh.Trimesh, choice="auto", up="z", margin=0.0, holes=0.0) -> Region:
    part = part_of(mesh, up)
    return select_region(fit_surface(part), part, choice, edge_margin=margin, hole_margin=holes)


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return fit_surface(part_of(mesh))


def fit(mesh: "trimesh.Trimesh | Shape", sunk: float = 0.0) -> Surface:
    """The surface of a mesh in metres, lowered."""
    vertices = np.array(mesh.vertices, dtype=np.float64) - [0.0, 0.0, sunk]
    return fit_triangles(vertices, np.array(mesh.faces, dtype=np.int32))


def prism(outline: Floats, depth: float) -> trimesh.Trimesh:
    """A prism along y, from 0 to its depth, over an outline in the plane of x and z, shape (n, 2)."""
    mesh = trimesh.creation.extrude_polygon(shapely.Polygon(outline), depth)
    return trimesh.Trimesh(mesh.vertices[:, [0, 2, 1]], mesh.faces[:, ::-1], process=False)


def stl_bytes(triangles: Floats) -> bytes:
    """Binary STL with exactly these corners, (m, 3, 3)."""
    record = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    record["c"] = triangles
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + record.tobytes()


def grid_faces(rows: int, columns: int) -> NDArray[np.int32]:
    """Two triangles for each square of a grid of points numbered row by row, square by square."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=-2)
    return faces.reshape(-1, 3).astype(np.int32)


def at_middle(surface: Surface, facets: NDArray[np.int32] | None = None) -> SurfacePoints:
    """Positions and normals of a surface at the middles of facets, of all if none are named."""
    facets = np.arange(len(surface.faces)) if facets is None else facets
    return surface.evaluate(facets, np.full((len(facets), 3), 1.0 / 3.0))


def enclosed(loop: Floats, axis: Floats) -> float:
    """Area within a loop (n, 3) seen against an axis, positive counter-clockwise."""
    return 0.5 * float(np.cross(loop, np.roll(loop, -1, axis=0)).sum(axis=0) @ axis)


@dataclass(frozen=True, eq=False)
class Shape:
    """A mesh with its closed form."""

    vertices: Floats
    faces: NDArray[np.int32]
    foot: Callable[[Floats], Floats]  #: Closest point of the true surface to points near it, (n, 3) -> (n, 3)
    normal: Callable[[Floats], Floats]  #: Outward unit normal at points on it, (n, 3) -> (n, 3)
    curvatures: Callable[[Floats], Floats]
    """Principal curvatures at points on it, larger first, positive = convex, (n, 3) -> (n, 2)."""


def flat(points: Floats) -> Floats:
    return points * [1.0, 1.0, 0.0]


def sphere(subdivisions: int, radius: float = 1.0) -> Shape:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Shape(
        np.array(mesh.vertices),
        np.array(mesh.faces, dtype=np.int32),
        foot=lambda points: radius * unit(points),
        normal=unit,
        curvatures=lambda points: np.full((len(points), 2), 1.0 / radius),
    )


def torus(around: int, major: float = 1.0, minor: float = 0.4, jitter: float = 0.0) -> Shape:
    """Torus about z with facets of about equal sides; jitter moves the vertices on the true surface."""
    along = max(round(around * major / minor), 3)
    mesh, rng = trimesh.creation.torus(major, minor, along, around), np.random.default_rng(1)
    x, y, z = mesh.vertices.T
    shift = 2.0 * np.pi * jitter * rng.uniform(-0.5, 0.5, (2, len(x)))
    a, b = np.arctan2(y, x) + shift[0] / along, np.arctan2(z, np.hypot(x, y) - major) + shift[1] / around
    ring = major + minor * np.cos(b)
    vertices = np.column_stack([ring * np.cos(a), ring * np.sin(a), minor * np.sin(b)])

    def normal(points: Floats) -> Floats:
        return unit(points - major * unit(flat(points)))

    def curvatures(points: Floats) -> Floats:
        ring = np.hypot(points[:, 0], points[:, 1])
        return np.column_stack([np.full(len(points), 1.0 / minor), (ring - major) / (minor * ring)])

    return Shape(
        vertices,
        np.array(mesh.faces, np.int32),
        foot=lambda points: major * unit(flat(points)) + minor * normal(points),
        normal=normal,
        curvatures=curvatures,
    )


def cylinder(around: int, radius: float = 1.0, height: float = 2.0) -> Shape:
    """Open cylinder about z with one long strip of two facets per division, as CAD writes it."""
    mesh = trimesh.creation.revolve([(radius, 0.0), (radius, height)], sections=around)
    return Shape(
        np.array(mesh.vertices),
        np.array(mesh.faces, np.int32),
        foot=lambda points: radius * unit(flat(points)) + points * [0.0, 0.0, 1.0],
        normal=lambda points: unit(flat(points)),
        curvatures=lambda points: np.tile([1.0 / radius, 0.0], (len(points), 1)),
    )


def memory_to_load(file: Path) -> float:
    """Most memory that reading or refusing a part takes at once, in sizes of its file."""
    tracemalloc.start()
    try:
        with suppress(MeshError):  # or what is left is mended
            load_part(file)
        return tracemalloc.get_traced_memory()[1] / file.stat().st_size
    finally:
        tracemalloc.stop()
