"""The part as the user gives it: read, put in metres, merged, mended, turned up (file or arrays ->
PartMesh)."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from polish_sim.arrays import Array, Ints, longest_side, summed
from polish_sim.errors import MeshError, check_name
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.mesh_file import read_mesh_file
from polish_sim.geometry.orientation import choose_up
from polish_sim.geometry.polygon import FileTriangles
from polish_sim.geometry.repair.facets import drop_bad_facets, flip_needles, split_t_junctions
from polish_sim.geometry.repair.holes import close_holes, separate_crowded
from polish_sim.geometry.repair.scan_noise import smooth_noise
from polish_sim.geometry.repair.skin import (
    NOISELESS,
    ScanNoise,
    Skin,
    describe_crossing_facets,
    describe_shells,
    merge_vertices,
    turn_outward,
    wind_alike,
)
from polish_sim.geometry.topology import find_adjacency

METRES_PER_UNIT = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "inch": 0.0254}  #: Length of one file unit [m]
SMALLEST_PART = 5e-3  #: Largest extent of the smallest part one could polish [m]
UNIT_WORDS = {
    **dict.fromkeys(("millimetre", "millimeter", "millimetres", "millimeters"), "mm"),
    **dict.fromkeys(("centimetre", "centimeter", "centimetres", "centimeters"), "cm"),
    **dict.fromkeys(("metre", "meter", "metres", "meters"), "m"),
    **dict.fromkeys(("in", "inches", '"'), "inch"),
}
"""Other words for the units, asked back."""
LARGEST_PART = 2.0  #: Largest extent of the largest part [m]: twice what the arm reaches
SENSIBLE_PART = 2e-2  #: Smaller ones are read so only if asked: they leave pads of 10 mm no path [m]
AUTO_UNIT = "auto"  #: mm, or where that makes no part the only unit that makes a sensible one
_ROUNDING = 1e-6  #: Of numbers in a file, relative

#: Facets without a neighbour: more than this many and this share are no surface
MOST_ALONE, SHARE_ALONE = 100, 0.25


def check_unit(unit: str) -> None:
    """Refuse what is neither a unit nor ``auto``."""
    if unit != AUTO_UNIT:
        metres_per_unit(unit)


def metres_per_unit(unit: str) -> float:
    """Return the length of one file unit [m]; unknown names are an error that lists the known ones."""
    check_name("unit", unit, METRES_PER_UNIT, UNIT_WORDS)
    return METRES_PER_UNIT[unit]


def _unit_of(extent: float, asked: str, stated: str, path: Path) -> tuple[str, tuple[str, ...]]:
    """The unit in which a part with this longest side [file units] is read, and a note where it was found.

    ``stated`` is the unit the file itself states, if it does.

    Raises:
        MeshError: Its size is implausible; names the units that would fit.
    """
    unit = stated or (next(iter(METRES_PER_UNIT)) if asked == AUTO_UNIT else asked)
    size = extent * metres_per_unit(unit)
    if _plausible(size):
        return unit, ()
    others = {} if stated else METRES_PER_UNIT
    sensible = [name for name, metres in others.items() if _plausible(extent * metres, SENSIBLE_PART)]
    if asked == AUTO_UNIT and len(sensible) == 1:
        only = sensible[0]
        return only, (
            f"the only unit that makes a sensible part of {extent:.6g} is {only} (assumed; --units sets it)",
        )
    fitting = [name for name, metres in others.items() if _plausible(extent * metres)]
    problem = "small" if size < SMALLEST_PART else "large"
    advice = (
        "Is the unit right? These would fit: " + ", ".join(f"--units {name}" for name in fitting) + "."
        if fitting
        else "No known unit fits: scale the part."
    )
    raise MeshError(
        f"{path}: the part is too {problem}: {extent:.6g} {unit} at its largest "
        f"(wanted: {SMALLEST_PART * 1e3:g} to {LARGEST_PART * 1e3:g} mm). {advice}"
    )


def _plausible(size: float, smallest: float = SMALLEST_PART) -> bool:
    """Whether a part of this size [m] could be polished; a limit that is met but for rounding is met."""
    return smallest * (1.0 - _ROUNDING) <= size <= LARGEST_PART * (1.0 + _ROUNDING)


@dataclass(frozen=True, eq=False)
class PartMesh:
    """A part's checked triangle mesh in the work frame (the file's frame in metres)."""

    vertices: Array  #: Vertices [m], shape (n, 3)
    faces: Ints  #: Vertex indices, counter-clockwise seen from outside, shape (m, 3)
    up: Array  #: Unit vector away from the table, shape (3,)
    name: str
    path: Path
    sha256: str  #: Hash of the file (of the arrays, where there was none)
    unit: str  #: Unit the file was read in
    stl_facets: Ints  #: Number of each facet in the file, -1 where it closes a hole, shape (m,)
    last_facet: int  #: Number of the file's last facet, which repair may have dropped
    notes: tuple[str, ...]  #: What was assumed or repaired, for the user
    noise: ScanNoise = NOISELESS  #: Of a scan, what smoothing left of it


def load_part(path: str | Path, unit: str = AUTO_UNIT, up: str = "auto") -> PartMesh:
    """Load a part from an STL, PLY, OBJ or STEP file in ``unit`` (mm, cm, m, inch or auto), in metres.

    A STEP file states its own unit. The part is checked, and what can be repaired without guessing is
    repaired and noted. ``up`` is the side that looks away from the table: x, y, z, -x, -y, -z, or auto for
    the side with the largest smooth face.

    Raises:
        MeshError: The file is no usable part; the message says why and what to do.
        InputError: Unknown unit or side.
    """
    path = Path(path)
    check_unit(unit)
    triangles, content = read_mesh_file(path)
    return _build_part(triangles, path, hashlib.sha256(content).hexdigest(), unit, up)


def part_from_arrays(
    vertices: ArrayLike, faces: ArrayLike, unit: str = "m", up: str = "auto", name: str = "part"
) -> PartMesh:
    """Make a part in metres of a mesh in memory, (n, 3) in ``unit`` and (m, 3), at full precision; else as
    `load_part`.

    ``name`` is what messages and files call the part.

    Raises:
        MeshError: The arrays are no usable part.
        InputError: Unknown unit or side.
    """
    points = np.array(vertices, dtype=np.float64)
    corners = np.array(faces)
    if points.ndim != 2 or points.shape[1:] != (3,) or corners.ndim != 2 or corners.shape[1:] != (3,):
        raise MeshError(
            f"{name}: wanted vertices of shape (n, 3) and faces of shape (m, 3), got {points.shape} and "
            f"{corners.shape}. Pass a triangle mesh."
        )
    if len(corners) == 0 or not np.issubdtype(corners.dtype, np.integer):
        raise MeshError(f"{name}: the faces must be whole numbers, at least one row. Pass a triangle mesh.")
    if corners.min() < 0 or corners.max() >= len(points):
        raise MeshError(
            f"{name}: the faces refer to vertices that do not exist (valid: 0 to {len(points) - 1})."
        )
    if not np.isfinite(points).all():
        raise MeshError(f"{name}: vertices are NaN or infinite. Repair the mesh.")
    digest = hashlib.sha256(points.tobytes() + corners.astype(np.int64).tobytes()).hexdigest()
    triangles = FileTriangles(points[corners], np.arange(len(corners), dtype=np.int32))
    return _build_part(triangles, Path(name), digest, unit, up)


def _build_part(triangles: FileTriangles, path: Path, sha256: str, unit: str, up: str) -> PartMesh:
    extent = longest_side(triangles.corners.reshape(-1, 3))
    unit, unit_notes = _unit_of(extent, unit, triangles.unit, path)
    skin = mend(triangles.corners * metres_per_unit(unit), path)
    direction, up_note = choose_up(skin.vertices, skin.faces, up)
    used, compact = np.unique(skin.faces, return_inverse=True)
    vertices = skin.vertices[used]
    faces = compact.reshape(-1, 3).astype(np.int32)
    stl_facets = np.where(skin.source >= 0, triangles.numbers[skin.source], -1).astype(np.int32)
    x, y, z = np.ptp(vertices, axis=0) * 1e3
    size_note = f"read in {unit}: {x:.4g} x {y:.4g} x {z:.4g} mm, {len(faces)} facets"
    for array in (vertices, faces, direction, stl_facets):
        array.setflags(write=False)
    return PartMesh(
        vertices=vertices,
        faces=faces,
        up=direction,
        name=path.stem,
        path=path,
        sha256=sha256,
        unit=unit,
        stl_facets=stl_facets,
        last_facet=int(triangles.numbers.max()),
        notes=(size_note, *unit_notes, *triangles.notes, *skin.notes, up_note),
        noise=skin.noise,
    )


def mend(triangles: Array, path: Path) -> Skin:
    """Repair what can be repaired of triangles (m, 3, 3) [m] without guessing; note what was done and what
    was left.

    Every edge of the skin has one or two facets, wound alike, closed pieces outward. Borders, bodies and
    facets that pass through each other are left and noted. Messages name the file ``path``.

    Raises:
        MeshError: Inside and outside are not defined; names the place.
    """
    vertices, faces, notes = merge_vertices(triangles)
    _refuse_soup(faces, len(vertices), path)
    skin = Skin(vertices, faces, np.arange(len(faces), dtype=np.int32), notes)
    skin = drop_bad_facets(skin, path)
    skin = wind_alike(skin, path)
    skin = wind_alike(separate_crowded(split_t_junctions(skin), path), path)
    skin = close_holes(flip_needles(skin))
    skin = turn_outward(skin)
    skin = smooth_noise(skin)
    return skin._replace(notes=(*skin.notes, *describe_shells(skin), *describe_crossing_facets(skin)))


def _refuse_soup(faces: Ints, vertices: int, path: Path) -> None:
    """Refuse facets that do not hang together, as bytes lost from a file leave them: repair would take
    minutes."""
    if vertices < 0.55 * len(faces):  # a closed skin has half as many vertices as facets
        return
    alone = (find_adjacency(faces).facets < 0).all(axis=1)
    if alone.sum() > MOST_ALONE and alone.mean() > SHARE_ALONE:
        raise MeshError(
            f"{path}: {alone.sum()} of {len(faces)} facets have no neighbour, the first is facet "
            f"{alone.argmax()}: this is no surface. Was the file damaged on the way? Copy or export it again."
        )


MUCH_FINER = 4.0  #: Times the wanted number of facets


class LighterMesh(NamedTuple):
    """Triangles of a mesh or of a lighter copy."""

    vertices: Array  #: [m], shape (n, 3)
    faces: Ints  #: Vertex indices, shape (m, 3)


def lighter_mesh(vertices: Array, faces: Ints, most_facets: int) -> LighterMesh:
    """Collapse edges of a fine mesh (n, 3) [m], (m, 3), those that change the shape least first, to
    ``most_facets``.

    A mesh that is light enough stays as it is. The vertices of one that is much finer are joined on a grid
    first: on some, collapsing all these edges took a minute and did not end.
    """
    if len(faces) > MUCH_FINER * most_facets:
        vertices, faces = _joined_on_grid(vertices, faces, most_facets)
    if len(faces) <= most_facets:
        return LighterMesh(vertices, faces)
    from fast_simplification import simplify  # slow to import

    size = longest_side(vertices)  # its tolerances are lengths
    points, triangles = simplify(vertices / size, faces.astype(np.int32), target_count=most_facets)
    return LighterMesh(size * points.astype(np.float64), triangles.astype(np.int32))


def _joined_on_grid(vertices: Array, faces: Ints, most_facets: int) -> LighterMesh:
    """Join the vertices in each cube of half the edge that triangles of the wanted number have."""
    area = facet_normals(vertices, faces)[1].sum()
    cubes = np.floor(vertices / (0.5 * math.sqrt(2.0 * area / most_facets))).astype(np.int64)
    cube = np.unique(cubes, axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(cube)
    middles = summed(cube, vertices, len(count)) / count[:, None]
    joined = cube[faces]
    whole = (joined != np.roll(joined, 1, axis=1)).all(axis=1)
    return LighterMesh(middles, joined[whole].astype(np.int32))
