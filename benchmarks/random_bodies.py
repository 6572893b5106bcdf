"""Parts of chance: those of `random_draw`, of `field_shapes`, files of the user's, and what all lack (rng ->
mesh).

That are ridges between large facets, bosses, teeth, walls, and scans of one side.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import trimesh
from shapely.geometry import Polygon
from trimesh.creation import annulus, box, cylinder, extrude_polygon, icosphere

from benchmarks.field_shapes import parts
from benchmarks.random_draw import draw_part

Generator = np.random.Generator


def usable_files(folder: Path) -> list[Path]:
    """The STL files of a folder that hold a facet."""
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() == ".stl")
    return [file for file in files if not trimesh.load(file, force="mesh", process=False).is_empty]


def draw_mesh(seed: int, files: Sequence[Path], rng: Generator) -> tuple[str, trimesh.Trimesh]:
    """Draw a part: its name and mesh, of any size; half of them are ``files``, if there are any."""
    if files and rng.random() < 0.5:
        file = files[rng.integers(len(files))]
        return file.name, trimesh.load(file, force="mesh", process=False)
    makes = rng.choice(["drawn", "formula", "body"])
    if makes == "drawn":
        part = draw_part(seed)
        corners = part.triangles.reshape(-1, 3)
        return part.name, trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    shapes = parts() if makes == "formula" else {}
    name = str(rng.choice(list(shapes or BODIES)))
    mesh = shapes[name]() if shapes else BODIES[name](rng)
    mesh.apply_transform(np.diag([*rng.uniform(0.8, 1.25, 3), 1.0]))
    return name, mesh


def log_uniform(rng: Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is even."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _moved(mesh: trimesh.Trimesh, *shift: float) -> trimesh.Trimesh:
    return mesh.apply_translation((*shift, *(0.0,) * (3 - len(shift))))


def _hull(rng: Generator) -> trimesh.Trimesh:
    return trimesh.convex.convex_hull(rng.normal(size=(rng.integers(8, 24), 3)) * (2.0, 2.0, 1.0))


def _tray(rng: Generator) -> trimesh.Trimesh:
    width, wall, height = rng.uniform(0.5, 1.0), rng.uniform(0.04, 0.08), rng.uniform(0.1, 0.4)
    room = _moved(box((1.0 - 2.0 * wall, width - 2.0 * wall, height)), 0.0, 0.0, wall)
    return trimesh.boolean.difference([box((1.0, width, height)), room])


def _bracket(rng: Generator) -> trimesh.Trimesh:
    width, height = rng.uniform(0.4, 1.0), rng.uniform(0.2, 0.7)
    wall = _moved(box((0.08, width, height)), 0.46, 0.0, 0.5 * height)
    return trimesh.boolean.union([box((1.0, width, 0.1)), wall])


def _gear(rng: Generator) -> trimesh.Trimesh:
    teeth = int(rng.integers(7, 18))
    angle = np.linspace(0.0, 2.0 * np.pi, 8 * teeth, endpoint=False)
    radius = 1.0 + rng.uniform(0.04, 0.1) * np.sign(np.sin(teeth * angle + 0.01))
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    bore = cylinder(rng.uniform(0.1, 0.5), 4.0, sections=48)
    return trimesh.boolean.difference([extrude_polygon(Polygon(rim), rng.uniform(0.1, 0.3)), bore])


def _profile(rng: Generator) -> trimesh.Trimesh:
    """An angle with a fillet of a few facets."""
    wide, high, thick, fillet = rng.uniform((0.5, 0.4, 0.06, 0.05), (1.0, 1.0, 0.15, 0.2))
    angle, inner = np.linspace(np.pi, 1.5 * np.pi, rng.integers(4, 24)), thick + fillet
    arc = inner + fillet * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [(0.0, 0.0), (inner + wide, 0.0), (inner + wide, thick)]
    outline = [*ends, *arc[::-1], (thick, inner + high), (0.0, inner + high)]
    return extrude_polygon(Polygon(outline), rng.uniform(0.8, 2.0))


def _ring(rng: Generator) -> trimesh.Trimesh:
    """A tube, a disc or a flange with drilled holes."""
    inner = rng.uniform(0.3, 0.8)
    ring = annulus(inner, 1.0, rng.uniform(0.05, 0.8), sections=int(rng.integers(48, 160)))
    angle = np.linspace(0.0, 2.0 * np.pi, rng.integers(1, 9), endpoint=False)[1:]
    radius, away = rng.uniform(0.1, 0.3) * (1.0 - inner), 0.5 * (1.0 + inner)
    holes = [_moved(cylinder(radius, 4.0, sections=24), away * np.cos(a), away * np.sin(a)) for a in angle]
    return trimesh.boolean.difference([ring, *holes]) if holes else ring


def _bossed(rng: Generator) -> trimesh.Trimesh:
    """A block with a bump or a dimple of coarse or fine facets."""
    width, ball = rng.uniform(0.4, 1.0), icosphere(int(rng.integers(3, 6)), rng.uniform(0.06, 0.3))
    block = box((1.0, width, rng.uniform(0.05, 0.25)))
    depth = rng.uniform(0.3, 0.95) * ball.extents[2] / 2.0
    _moved(ball, rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3) * width, block.extents[2] / 2.0 - depth)
    join = trimesh.boolean.union if rng.random() < 0.5 else trimesh.boolean.difference
    return join([block, ball])


def _pins(rng: Generator) -> trimesh.Trimesh:
    sizes = rng.uniform((0.01, 0.06), (0.06, 0.3), (rng.integers(1, 7), 2))
    places = rng.uniform(-0.45, 0.45, (len(sizes), 2))
    pins = [_moved(cylinder(r, h, sections=32), *place, h / 2.0)
            for (r, h), place in zip(sizes, places, strict=True)]  # fmt: skip
    return trimesh.boolean.union([box((1.0, 1.0, 0.08)), *pins])


def _open_scan(rng: Generator) -> trimesh.Trimesh:
    """The upper side of a part alone, noisy, with patches and single facets missing."""
    count = int(rng.integers(50, 120))
    x, y = np.meshgrid(*[np.linspace(-0.5, 0.5, count)] * 2, indexing="ij")
    height = rng.uniform(0.02, 0.06) * np.sin(3.0 * x) * np.cos(3.0 * y)
    height += rng.normal(scale=rng.uniform(3e-5, 4e-4), size=x.shape)
    rows = np.arange(count * count).reshape(count, count)
    a, b, c, d = (rows[i, j].ravel() for i, j in (
        np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))  # fmt: skip
    points = np.stack([x, y, height], axis=2).reshape(-1, 3)
    mesh = trimesh.Trimesh(points, np.concatenate([np.c_[a, b, c], np.c_[a, c, d]]))
    middles = mesh.triangles_center
    kept = rng.random(len(middles)) > rng.uniform(0.0, 0.003)
    for middle in middles[rng.integers(len(middles), size=rng.integers(0, 5))]:
        kept &= np.linalg.norm(middles - middle, axis=1) > rng.uniform(0.01, 0.08)
    mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()
    return mesh


BODIES: dict[str, Callable[[Generator], trimesh.Trimesh]] = {
    "hull": _hull,
    "tray": _tray,
    "bracket": _bracket,
    "gear": _gear,
    "profile": _profile,
    "ring": _ring,
    "bossed block": _bossed,
    "pins": _pins,
    "open scan": _open_scan,
}
