"""Shapes after things that are polished, drawn from formulas: blades, domes, housings, moulds, castings,
scans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _grid(width: float, depth: float, spacing: float) -> tuple[Array, Array, NDArray[np.int64]]:
    """Points of a rectangle about the origin (n,), (n,), and its triangles, up."""
    columns, rows = round(width / spacing) + 1, round(depth / spacing) + 1
    x, y = np.meshgrid(np.linspace(-width / 2, width / 2, columns), np.linspace(-depth / 2, depth / 2, rows))
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    corners = np.column_stack(
        [first, first + 1, first + columns + 1, first, first + columns + 1, first + columns]
    )
    return x.ravel(), y.ravel(), corners.reshape(-1, 3)


def _block(
    width: float, depth: float, spacing: float, height: Callable[[Array, Array], Array]
) -> trimesh.Trimesh:
    """A solid with a flat bottom at z = 0 under a height."""
    x, y, faces = _grid(width, depth, spacing)
    top = np.column_stack([x, y, height(x, y)])
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, index, count = np.unique(edges, axis=0, return_index=True, return_counts=True)
    rim = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)[index[count == 1]]
    n = len(top)
    walls = np.concatenate([np.column_stack([rim[:, 1], rim[:, 0], rim[:, 0] + n]),
                            np.column_stack([rim[:, 1], rim[:, 0] + n, rim[:, 1] + n])])  # fmt: skip
    bottom = top * [1.0, 1.0, 0.0]
    return trimesh.Trimesh(np.concatenate([top, bottom]), np.concatenate([faces, faces[:, ::-1] + n, walls]))


def _step(x: Array, width: float) -> Array:
    """A smooth step from 0 to 1 over a width about 0."""
    t = np.clip(x / width + 0.5, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _box_distance(x: Array, y: Array, a: float, b: float, corner: float) -> Array:
    """Signed distance to a rounded rectangle of half sides a and b in the plane."""
    u, v = np.abs(x) - a + corner, np.abs(y) - b + corner
    return np.hypot(np.maximum(u, 0.0), np.maximum(v, 0.0)) + np.minimum(np.maximum(u, v), 0.0) - corner


def _figurine(noise: float) -> trimesh.Trimesh:
    """A scan: a closed bumpy shape 150 mm tall whose vertices jitter along the normal."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    v = np.array(ball.vertices)
    bumps = 0.18 * np.sin(4.0 * v[:, 0] + 1.0) * np.cos(3.0 * v[:, 1]) + 0.12 * np.sin(
        5.0 * v[:, 2] + 2.0 * v[:, 0]
    )
    points = v * (1.0 + bumps)[:, None] * [45.0, 40.0, 70.0]
    shape = trimesh.Trimesh(points, ball.faces)
    jitter = np.random.default_rng(5).normal(scale=noise, size=len(points))
    return trimesh.Trimesh(points + jitter[:, None] * shape.vertex_normals, ball.faces)


def _blade() -> trimesh.Trimesh:
    """A twisted blade 180 mm long with an airfoil of 70 mm, lying on its side, hub and tip closed."""
    along, around = 60, 80
    t = 2.0 * np.pi * np.arange(around) / around
    chord = 0.5 * (1.0 - np.cos(t))
    thick = 0.6 * (
        0.2969 * np.sqrt(chord) - 0.126 * chord - 0.3516 * chord**2 + 0.2843 * chord**3 - 0.1036 * chord**4
    )
    rings = []
    for s in np.linspace(0.0, 1.0, along):
        size, twist = 70.0 * (1.0 - 0.4 * s), np.radians(5.0 + 25.0 * s)
        x, z = size * (chord - 0.4), size * (np.sign(np.pi - t) * thick + 0.08 * np.sin(np.pi * chord))
        x, z = np.cos(twist) * x + np.sin(twist) * z, -np.sin(twist) * x + np.cos(twist) * z
        rings.append(np.column_stack([x, np.full(around, 180.0 * s), z]))
    k = np.arange(along - 1)[:, None] * around
    i, j = k + np.arange(around), k + (np.arange(around) + 1) % around
    sides = np.stack([i, j, j + around, i, j + around, i + around], axis=-1).reshape(-1, 3)
    ends = [[0, m + 1, m] for m in range(1, around - 1)]
    last = (along - 1) * around
    ends += [[last, last + m, last + m + 1] for m in range(1, around - 1)]
    return trimesh.Trimesh(np.concatenate(rings), np.concatenate([sides, np.array(ends)]))


def _revolved(profile: list[tuple[float, float]]) -> trimesh.Trimesh:
    """A body of revolution about z of a profile of radius and height, its corners cut into short pieces."""
    fine = [np.array(profile[0])]
    for a, b in zip(np.array(profile[:-1]), np.array(profile[1:]), strict=True):
        pieces = max(1, round(float(np.hypot(*(b - a))) / 3.0))
        fine += [a + (b - a) * k / pieces for k in range(1, pieces + 1)]
    return trimesh.creation.revolve(np.array(fine), sections=120)


def _arc(center: tuple[float, float], radius: float, begin: float, end: float) -> list[tuple[float, float]]:
    angles = np.radians(np.linspace(begin, end, 24))
    return [(center[0] + radius * float(np.cos(a)), center[1] + radius * float(np.sin(a))) for a in angles]


def _elbow() -> trimesh.Trimesh:
    """A bend of pipe, 60 mm across, about a radius of 90 mm."""
    along, around = 60, 72
    bend, turn = np.meshgrid(
        np.linspace(0.0, np.pi / 2, along), 2.0 * np.pi * np.arange(around) / around, indexing="ij"
    )
    reach = 90.0 + 30.0 * np.cos(turn)
    points = np.stack([reach * np.cos(bend), reach * np.sin(bend), 30.0 * np.sin(turn)], axis=-1).reshape(
        -1, 3
    )
    k = np.arange(along - 1)[:, None] * around
    i, j = k + np.arange(around), k + (np.arange(around) + 1) % around
    sides = np.stack([i, j + around, j, i, i + around, j + around], axis=-1).reshape(-1, 3)
    ends = [
        [first, first + m, first + m + 1] for first in (0, len(points) - around) for m in range(1, around - 1)
    ]
    return trimesh.Trimesh(points, np.concatenate([sides, np.array(ends)]))


def _helmet() -> trimesh.Trimesh:
    """Half an ellipsoid, open below."""
    shell = trimesh.creation.icosphere(subdivisions=5)
    shell.apply_transform(np.diag([110.0, 90.0, 80.0, 1.0]))
    return shell.slice_plane([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])


def _door(x: Array, y: Array) -> Array:
    return 40.0 - x**2 / 9e3 - y**2 / 4e3 - 6.0 * np.exp(-((x - 90.0) ** 2) / 1800.0 - y**2 / 500.0)


def _bowl(radius: float, rim: float, height: float) -> Callable[[Array, Array], Array]:
    """A spherical hollow of a radius, up to the radius of its rim, in a block of a height."""
    return lambda x, y: height - np.sqrt(np.maximum(radius**2 - np.minimum(np.hypot(x, y), rim) ** 2, 0.0))


def _mould(x: Array, y: Array) -> Array:
    return 50.0 - 15.0 * np.exp(-((x / 55.0) ** 2 + (y / 40.0) ** 2)) - 5.0 * _step(np.abs(y) - 60.0, 2.0)


_BOTTLE = [
    (0.0, 0.0),
    (35.0, 0.0),
    *_arc((25.0, 80.0), 15.0, 0.0, 80.0),
    (14.0, 105.0),
    (14.0, 120.0),
    (0.0, 120.0),
]
_FLANGE = [(15.0, 0.0), (80.0, 0.0), (80.0, 12.0), (35.0, 12.0), (30.0, 40.0), (15.0, 40.0), (15.0, 0.0)]


def _with_holes(plate: trimesh.Trimesh, places: list[tuple[float, float, float]]) -> trimesh.Trimesh:
    """Drill holes of a radius at x, y."""
    drills = [
        trimesh.creation.cylinder(r, 200.0, sections=48).apply_translation([x, y, 0.0]) for x, y, r in places
    ]
    return trimesh.boolean.difference([plate, *drills])


def parts() -> dict[str, Callable[[], trimesh.Trimesh]]:
    """Names and makers of the parts [mm]."""
    scan_noise = np.random.default_rng(7)
    return {
        "dome": lambda: _revolved([(0.0, 0.0), (90.0, 0.0), *_arc((0.0, -110.0), 142.0, 51.0, 90.0)]),
        "blade": _blade,
        "door_panel": lambda: _block(500.0, 350.0, 5.0, _door),
        "housing_pocket": lambda: _block(
            180.0,
            120.0,
            1.5,
            lambda x, y: 30.0 - 18.0 * (1.0 - _step(_box_distance(x, y, 60.0, 35.0, 12.0), 2.0)),
        ),
        "boss_plate": lambda: _block(
            160.0, 160.0, 2.0, lambda x, y: 10.0 + 20.0 * (1.0 - _step(np.hypot(x - 20.0, y) - 22.0, 3.0))
        ),
        "ribbed_casting": lambda: _block(
            200.0,
            150.0,
            2.0,
            lambda x, y: 12.0 + 8.0 * np.exp(-((np.mod(x + 25.0, 50.0) - 25.0) ** 2) / 40.0),
        ),
        "bowl_60": lambda: _block(160.0, 160.0, 2.0, _bowl(60.0, 52.0, 70.0)),
        "bowl_22": lambda: _block(100.0, 100.0, 1.5, _bowl(22.0, 19.0, 40.0)),
        "trough": lambda: _block(200.0, 120.0, 2.0, lambda x, y: 20.0 + y**2 / 160.0),
        "wavy_coarse": lambda: _with_holes(
            _block(105.0, 105.0, 5.0, lambda x, y: 15.0 + 2.0 * np.sin(x / 9.0) * np.cos(y / 11.0)),
            [(8.0, 5.0, 9.0)],
        ),
        "scan_plate": lambda: _block(
            150.0,
            100.0,
            1.5,
            lambda x, y: 20.0 + 3.0 * np.sin(x / 40.0) + scan_noise.normal(scale=0.05, size=len(x)),
        ),
        "scan_figurine": lambda: _figurine(0.08),
        "bolted_plate": lambda: _with_holes(
            trimesh.creation.box([160.0, 120.0, 12.0]).subdivide().subdivide(),
            [(x, y, 4.5) for x in (-65.0, 65.0) for y in (-45.0, 45.0)] + [(0.0, 0.0, 20.0)],
        ),
        "small_cover": lambda: trimesh.creation.box([40.0, 23.0, 5.0]).subdivide().subdivide(),
        "bottle": lambda: _revolved(_BOTTLE),
        "flange": lambda: _revolved(_FLANGE),
        "cone": lambda: trimesh.creation.cone(radius=70.0, height=60.0, sections=96),
        "elbow": _elbow,
        "helmet": _helmet,
        "mould_half": lambda: _block(180.0, 140.0, 2.0, _mould),
    }
