"""Random outlines with holes, pockets and creases, and their irregular triangulations (rng -> plane
triangles)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

CLEAR = 0.7
"""Points inside keep this many spacings from lines that have to be edges, so that those are."""
REFINEMENTS = 12


class PlaneShape(NamedTuple):
    """A part seen from above; every loop is counter-clockwise, (n, 2)."""

    outline: Array
    holes: tuple[Array, ...]
    pockets: tuple[Array, ...]
    creases: tuple[Array, ...]
    """Open lines the triangulation has edges along, (n, 2)."""


class PlaneMesh(NamedTuple):
    """Triangles of a shape."""

    points: Array
    """(n, 2)."""
    triangles: Ints
    """Counter-clockwise, (m, 3)."""
    pocket: Ints
    """0 for the top, k for the k-th pocket, (m,)."""


def draw_outline(kind: str, rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    """An outline about one unit across, and the large hole of a ring.

    Args:
        kind: A name in `OUTLINES`.
        rng: Where chance comes from.
    """
    return OUTLINES[kind](rng)


def _rectangle(rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    half = 0.5 * np.array([1.0, rng.uniform(0.35, 1.0)])
    return half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), ()


def _round(rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    return ellipse(np.zeros(2), 0.5, 0.5 * rng.uniform(0.5, 1.0)), ()


def _angle(rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    """An L."""
    a, b = rng.uniform(0.3, 0.6, 2)
    return np.array([[0, 0], [1, 0], [1, a], [b, a], [b, 1], [0, 1]]) - 0.5, ()


def _star(rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    tips = int(rng.integers(4, 8))
    angle = np.pi / tips * np.arange(2 * tips)
    radius = np.where(np.arange(2 * tips) % 2, 0.5 * rng.uniform(0.5, 0.8), 0.5)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), ()


def _ring(rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    inner = 0.5 * rng.uniform(0.3, 0.6)
    middle = rng.uniform(-0.3, 0.3, 2) * (0.5 - inner) * rng.integers(0, 2)
    return ellipse(np.zeros(2), 0.5, 0.5), (ellipse(middle, inner, inner),)


def _blob(rng: np.random.Generator) -> tuple[Array, tuple[Array, ...]]:
    angle = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    wave = sum(rng.uniform(-0.3, 0.3) / k * np.cos(k * angle + rng.uniform(0.0, 6.3)) for k in (2, 3, 4))
    return (0.4 * (1.0 + wave))[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1), ()


OUTLINES = {
    "rectangle": _rectangle,
    "round": _round,
    "L": _angle,
    "star": _star,
    "ring": _ring,
    "blob": _blob,
}


def ellipse(middle: Array, a: float, b: float) -> Array:
    """An ellipse as a polygon of 96 corners."""
    angle = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    return np.asarray(middle + np.stack([a * np.cos(angle), b * np.sin(angle)], axis=1))


def place_discs(
    shape: PlaneShape, count: int, low: float, high: float, gap: float, rng: np.random.Generator
) -> list:
    """Up to `count` discs inside the shape, clear of its lines and of each other by a gap, as polygons."""
    lines = [shape.outline, *shape.holes, *shape.pockets]
    discs: list[Array] = []
    for _ in range(60):
        if len(discs) == count:
            break
        middle, radius = rng.uniform(-0.5, 0.5, (1, 2)), rng.uniform(low, high)
        free = inside(shape.outline, middle)[0] and not any(inside(line, middle)[0] for line in lines[1:])
        if free and min(away(line, middle)[0] for line in [*lines, *discs]) > radius + gap:
            discs.append(ellipse(middle[0], radius, radius))
    return discs


def inside(polygon: Array, points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 2) lie inside a polygon (even-odd rule)."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    return np.asarray((spans & (x < crossing)).sum(axis=1) % 2 == 1)


def away(line: Array, points: Array, closed: bool = True) -> Array:
    """Distance of points (n, 2) from a polygon or an open line."""
    a, b = (line, np.roll(line, -1, axis=0)) if closed else (line[:-1], line[1:])
    along = b - a
    share = ((points[:, None] - a) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-300)
    foot = a + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.asarray(np.linalg.norm(points[:, None] - foot, axis=2).min(axis=1))


def triangulate_shape(
    shape: PlaneShape, spacing: float, jitter: float, rng: np.random.Generator
) -> PlaneMesh:
    """Delaunay triangles of jittered points that have the shape's lines as edges.

    Args:
        shape: What to fill.
        spacing: About the length of edges.
        jitter: How far points leave the even grid, in spacings.
        rng: Where chance comes from.

    Returns:
        The triangles.
    """
    loops = [_divided(loop, spacing, True) for loop in (shape.outline, *shape.holes, *shape.pockets)]
    creases = [_divided(line, spacing, False) for line in shape.creases]
    grid = _grid(spacing) + rng.uniform(-jitter, jitter, (len(_grid(spacing)), 2)) * spacing
    grid = grid[inside(shape.outline, grid)]
    clear = np.minimum.reduce([away(loop, grid) for loop in loops] + [away(c, grid, False) for c in creases])
    grid = grid[clear > CLEAR * spacing]
    far = ellipse(np.zeros(2), 3.0, 3.0)[::8]
    for _ in range(REFINEMENTS):
        points = np.concatenate([*loops, *creases, grid, far])
        triangles = np.asarray(Delaunay(points).simplices, dtype=np.int64)
        missing = _missing(points, triangles, loops, creases)
        if not any(rows.any() for rows in missing):
            break
        loops, creases = _halved(loops, creases, missing)
    middles = points[triangles].mean(axis=1)
    kept = inside(shape.outline, middles)
    for hole in shape.holes:
        kept &= ~inside(hole, middles)
    pocket = np.zeros(len(triangles), dtype=np.int64)
    for number, loop in enumerate(shape.pockets):
        pocket[inside(loop, middles)] = number + 1
    triangles, pocket = _counter_clockwise(points, triangles[kept]), pocket[kept]
    used, compact = np.unique(triangles, return_inverse=True)
    return PlaneMesh(points[used], compact.reshape(-1, 3), pocket)


def _grid(spacing: float) -> Array:
    """Rows of equilateral triangles over a square larger than any shape."""
    count = int(np.ceil(0.7 / spacing))
    i, j = np.meshgrid(np.arange(-count, count + 1), np.arange(-count, count + 1), indexing="ij")
    return np.stack([(i + 0.5 * (j % 2)).ravel(), np.sqrt(0.75) * j.ravel()], axis=1) * spacing


def _divided(line: Array, spacing: float, closed: bool) -> Array:
    """A line's corners with points between them no further apart than the spacing; close corners are
    thinned."""
    ends = np.concatenate([line, line[:1]]) if closed else line
    chords = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    if len(line) > 30:
        s = np.concatenate([[0.0], np.cumsum(chords)])
        count = max(int(np.ceil(s[-1] / spacing)), 8)
        where = np.linspace(0.0, s[-1], count + 1)[: None if not closed else -1]
        return np.stack([np.interp(where, s, ends[:, k]) for k in (0, 1)], axis=1)
    parts = [
        a + np.linspace(0.0, 1.0, max(int(np.ceil(size / spacing)), 1), endpoint=False)[:, None] * (b - a)
        for a, b, size in zip(ends[:-1], ends[1:], chords, strict=True)
    ]
    return np.concatenate(parts if closed else [*parts, ends[-1:]])


def _missing(
    points: Array, triangles: Ints, loops: list[Array], creases: list[Array]
) -> list[NDArray[np.bool_]]:
    """Which pieces of each line are no edge of any triangle."""
    half = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    known = np.unique(half.min(axis=1) * len(points) + half.max(axis=1))
    out, start = [], 0
    for number, line in enumerate([*loops, *creases]):
        here = start + np.arange(len(line) - (number >= len(loops)))
        ahead = start + (here - start + 1) % len(line)
        out.append(~np.isin(np.minimum(here, ahead) * len(points) + np.maximum(here, ahead), known))
        start += len(line)
    return out


def _halved(
    loops: list[Array], creases: list[Array], missing: list[NDArray[np.bool_]]
) -> tuple[list[Array], list[Array]]:
    """Lines with a point more in the middle of each missing piece."""
    lines = []
    for line, rows in zip([*loops, *creases], missing, strict=True):
        at = np.flatnonzero(rows)
        lines.append(np.insert(line, at + 1, 0.5 * (line[at] + line[(at + 1) % len(line)]), axis=0))
    return lines[: len(loops)], lines[len(loops) :]


def _counter_clockwise(points: Array, triangles: Ints) -> Ints:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    turned = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] < 0.0
    return np.where(turned[:, None], triangles[:, ::-1], triangles)
