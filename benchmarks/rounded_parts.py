"""Turned parts and boxes with roundings as a CAD system exports them, against their true faces: how far the
fitted surface is from them, and how far the flat facets are.

    python -m benchmarks.rounded_parts [--first 500] [--count 100]

A seed draws a profile of three to five corners, rounded with radii of up to 8 mm, and what the export allows:
an angle of 5 to 20 degrees and a distance of 0.02 to 0.2 mm. Between its roundings a cone is one facet long.
Of a box with rounded edges and corners it draws the size, the radius and four to nine facets across an edge,
which are as long as the edge.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from polish_sim.arrays import Array, Ints
from polish_sim.geometry.bezier import basis
from polish_sim.geometry.features import facet_normals
from polish_sim.geometry.fit import fit_triangles

END_FACE_DEG = 35.0  #: Least angle between an end face and the cone beside it: it is an edge
_SIXTHS = [(u / 6.0, v / 6.0, 1.0 - (u + v) / 6.0) for u in range(7) for v in range(7 - u)]


class Piece(NamedTuple):
    """A line of a profile, or an arc about a center; points are radius and height [mm]."""

    start: Array
    end: Array
    center: Array | None = None

    def sweep(self) -> tuple[float, float]:
        """Angle an arc begins at and by which it turns [rad]."""
        first, last = (math.atan2(*(point - self.center)[::-1]) for point in (self.start, self.end))
        return first, (last - first + math.pi) % (2.0 * math.pi) - math.pi

    def points(self, angle: float, off: float) -> Array:
        """The points behind the start an export leaves of it."""
        if self.center is None:
            return self.end[None]
        first, turn = self.sweep()
        radius = np.linalg.norm(self.start - self.center)
        count = math.ceil(abs(turn) / min(angle, 2.0 * math.acos(1.0 - min(off / radius, 1.0))))
        at = first + turn * np.arange(1, count + 1) / count
        return self.center + radius * np.column_stack([np.cos(at), np.sin(at)])

    def distance(self, points: Array) -> Array:
        """Distances of points (n, 2) from it [mm]."""
        if self.center is None:
            way = self.end - self.start
            along = np.clip((points - self.start) @ way / (way @ way), 0.0, 1.0)
            return np.linalg.norm(points - self.start - along[:, None] * way, axis=1)
        first, turn = self.sweep()
        from_center = points - self.center
        at = (np.arctan2(*from_center.T[::-1]) - first + math.pi) % (2.0 * math.pi) - math.pi
        share = at / turn
        radius = np.linalg.norm(self.start - self.center)
        off = np.abs(np.linalg.norm(from_center, axis=1) - radius)
        return np.where((share > -1e-9) & (share < 1.0 + 1e-9), off, np.inf)


class RoundedPart(NamedTuple):
    """A part as it is exported, and how far points are from its true faces."""

    vertices: Array  #: [mm], shape (n, 3)
    faces: Ints  #: Shape (m, 3)
    distance: Callable[[Array], Array]  #: Of points (n, 3) from the rounded faces [mm]
    across: int  #: Facets across the narrowest rounding

    def off(self) -> tuple[float, float]:
        """The largest distance of the fitted surface and of the facets from the rounded faces [mm]; end faces
        do not count."""
        normals, _ = facet_normals(self.vertices, self.faces)
        counted = np.abs(normals[:, 2]) < 1.0 - 1e-9
        patches = fit_triangles(1e-3 * self.vertices, self.faces).control[counted]
        fitted = 1e3 * np.einsum("kc,mcx->mkx", [basis(*place) for place in _SIXTHS], patches)
        flat = np.einsum("kc,mcx->mkx", _SIXTHS, self.vertices[self.faces[counted]])
        return self.distance(fitted.reshape(-1, 3)).max(), self.distance(flat.reshape(-1, 3)).max()


def draw_turned_part(seed: int) -> RoundedPart:
    """The part of a seed."""
    rng = np.random.default_rng(seed)
    count = rng.integers(3, 6)
    while True:
        corners = np.column_stack([rng.uniform(12.0, 45.0, count), np.cumsum(rng.uniform(8.0, 30.0, count))])
        ends = np.abs([corners[1] - corners[0], corners[-1] - corners[-2]])
        if np.degrees(np.arctan2(ends[:, 1], ends[:, 0])).min() > END_FACE_DEG:
            break
    profile = _rounded(corners, rng)
    angle, off = math.radians(rng.choice([5.0, 10.0, 15.0, 20.0])), rng.choice([0.02, 0.05, 0.1, 0.2])
    left = [piece.points(angle, off) for piece in profile]
    points = np.concatenate([corners[:1], *left])
    around = math.ceil(2.0 * math.pi / min(angle, 2.0 * math.acos(1.0 - off / points[:, 0].max())))
    turn = 2.0 * math.pi * np.arange(around) / around
    circle = np.column_stack([np.cos(turn), np.sin(turn)])

    def distance(points: Array) -> Array:
        at = np.column_stack([np.linalg.norm(points[:, :2], axis=1), points[:, 2]])
        return np.min([piece.distance(at) for piece in profile], axis=0)

    mesh = _joined([r * circle for r in points[:, 0]], points[:, 1], rng)
    return RoundedPart(*mesh, distance, min(map(len, left[1::2])))


def draw_rounded_box(seed: int, across: int = 0) -> RoundedPart:
    """The box of a seed: a ball cut into octants that are moved apart, ``across`` facets each way if
    given."""
    rng = np.random.default_rng(seed)
    half = rng.uniform(10.0, 40.0, 3)
    radius, across = rng.uniform(2.0, 0.8 * half.min()), across or int(rng.integers(4, 10))
    octant = 0.5 * math.pi * np.arange(across + 1) / across
    turn = np.concatenate([octant + 0.5 * math.pi * quadrant for quadrant in range(4)])
    signs = np.repeat([[1, 1], [-1, 1], [-1, -1], [1, -1]], across + 1, axis=0)
    circle, flats = np.column_stack([np.cos(turn), np.sin(turn)]), signs * (half[:2] - radius)
    rises = np.concatenate([-octant[::-1], octant])
    heights = radius * np.sin(rises) + np.repeat([radius - half[2], half[2] - radius], across + 1)
    outlines = [radius * math.cos(rise) * circle + flats for rise in rises]
    vertices, faces = _joined(outlines, heights, rng)
    vertices, same = np.unique(np.round(vertices, 9), axis=0, return_inverse=True)
    faces = same.ravel()[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)].astype(np.int32)

    def distance(points: Array) -> Array:
        return np.abs(np.linalg.norm(np.maximum(np.abs(points) - half + radius, 0.0), axis=1) - radius)

    return RoundedPart(vertices, faces, distance, across)


def _rounded(corners: Array, rng: np.random.Generator) -> list[Piece]:
    profile, here = list[Piece](), corners[0]
    for before, corner, behind in zip(corners, corners[1:], corners[2:], strict=False):
        lengths = np.linalg.norm([before - corner, behind - corner], axis=1)
        back, ahead = np.array([before - corner, behind - corner]) / lengths[:, None]
        half = 0.5 * math.acos(np.clip(back @ ahead, -1.0, 1.0))
        cut = min(rng.uniform(2.0, 8.0) / math.tan(half), 0.35 * lengths.min())
        middle = (back + ahead) / np.linalg.norm(back + ahead)
        center = corner + middle * cut / math.cos(half)
        profile += [
            Piece(here, corner + cut * back),
            Piece(corner + cut * back, corner + cut * ahead, center),
        ]
        here = corner + cut * ahead
    return [*profile, Piece(here, corners[-1])]


def _joined(outlines: list[Array], heights: Array, rng: np.random.Generator) -> tuple[Array, Ints]:
    """Outlines of as many points one above the other, with a fan at either end; each quadrilateral between is
    cut one way or the other."""
    around = len(outlines[0])
    rings = [np.column_stack([flat, np.full(around, z)]) for flat, z in zip(outlines, heights, strict=True)]
    a = np.arange(around * (len(rings) - 1))
    b = a // around * around + (a + 1) % around
    c, d = a + around, b + around
    one_way = rng.random(len(a)) < 0.5
    first = np.arange(around)
    ahead, bottom, above = (first + 1) % around, around * len(rings), around * (len(rings) - 1)
    faces = [
        np.column_stack([a, b, np.where(one_way, c, d)]),
        np.column_stack([np.where(one_way, b, a), d, c]),
        np.column_stack([np.full(around, bottom), ahead, first]),
        np.column_stack([np.full(around, bottom + 1), above + first, above + ahead]),
    ]
    tips = [ring.mean(axis=0)[None] for ring in (rings[0], rings[-1])]
    return np.concatenate([*rings, *tips]), np.concatenate(faces).astype(np.int32)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each part, then the sums."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--count", type=int, default=100)
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + given.count)
    for name, draw in (("turned part", draw_turned_part), ("rounded box", draw_rounded_box)):
        parts = [draw(seed) for seed in seeds]
        off = np.array([part.off() for part in parts])
        for seed, part, (fitted, flat) in zip(seeds, parts, off, strict=True):
            print(f"{name} {seed}, {part.across} across: surface {fitted:.3f} mm off, facets {flat:.3f} mm")
        one = np.array([part.across == 1 for part in parts])
        for which, across in ((one, "one facet"), (~one, "two facets or more")):
            if which.any():
                fitted, flat = off[which].T
                print(
                    f"{name}, {which.sum()} with {across} across the narrowest rounding: surface "
                    f"{fitted.mean():.3f} mm off in the mean, {fitted.max():.2f} mm at most; facets "
                    f"{flat.mean():.3f} and {flat.max():.2f} mm; ratio {np.median(fitted / flat):.2f} in the "
                    f"median, {np.max(fitted / flat):.1f} at most"
                )


if __name__ == "__main__":
    main()
