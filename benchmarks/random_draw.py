"""A part of chance, the same for the same seed: shape, top, noise, damage, place, request (seed -> part and
plan)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.random_outline import (
    OUTLINES,
    PlaneShape,
    away,
    draw_outline,
    inside,
    place_discs,
    triangulate_shape,
)
from benchmarks.random_solid import DAMAGES, Solid, add_slivers, raise_solid
from polish_sim.config import PadConfig, PlanConfig

Array = NDArray[np.float64]

LOWEST = 0.15
"""Height of the lowest place of the top in sizes of the part."""
GENTLE = np.radians(28.0)
"""Steepest slope of the bumps together, about."""


@dataclass(frozen=True, eq=False)
class RandomPart:
    """A part, its truth and a request."""

    seed: int
    name: str
    """What it is, in words."""
    solid: Solid
    """The part before damage, in place [m]."""
    triangles: Array
    """What its file holds [m], shape (m, 3, 3)."""
    up: Array
    """Unit vector the top looks along, shape (3,)."""
    smooth: bool
    """The top is one smooth face, so it is the region a person expects."""
    as_file: bool
    """Whether it comes as an STL file."""
    plan: PlanConfig
    pad: PadConfig


def draw_part(seed: int, pattern: str = "spiral", region: str = "") -> RandomPart:
    """Draw a part.

    Args:
        seed: The same seed draws the same part.
        pattern: Pattern to plan.
        region: Kind of region to plan on; empty = drawn too.

    Returns:
        The part and what to plan on it.
    """
    rng = np.random.default_rng([seed, 20])
    spacing, words = 1.0 / rng.uniform(14.0, 36.0), []
    shape = _draw_shape(spacing, rng, words)
    height, creases, smooth = _draw_top(shape, spacing, rng, words)
    shape = shape._replace(creases=creases)
    plane = triangulate_shape(shape, spacing, rng.choice([0.0, 0.2, 0.35]), rng)
    if rng.random() < 0.3:
        plane = add_slivers(plane, 0.05, rng)
        words.append("slivers")
    rough = float(rng.choice([0.0, 0.01, 0.03], p=[0.7, 0.2, 0.1]))
    if rough:
        words.append(f"noise {rough:g}")
    noise = np.column_stack(
        [np.zeros((len(plane.points), 2)), rough * spacing * rng.normal(size=len(plane.points))]
    )
    base = float(height(plane.points).min()) - LOWEST
    floors = [float(height(pocket).min()) - base - rng.uniform(0.02, 0.08) for pocket in shape.pockets]
    solid = raise_solid(plane, lambda points: height(points) - base, floors, spacing, noise)
    size, turn, shift = _draw_place(rng)
    words.append(f"{1e3 * size:.0f} mm")
    solid = solid._replace(vertices=turn.apply(size * solid.vertices) + shift)
    triangles, as_file = solid.vertices[solid.faces], bool(rng.random() < 0.6)
    if rng.random() < 0.25:
        damage = str(rng.choice(list(DAMAGES)))
        triangles, as_file, words = DAMAGES[damage](triangles, solid.top, rng), True, [*words, damage]
    plan, pad = _draw_request(solid, turn, pattern, region, rng)
    name = ", ".join(words)
    return RandomPart(seed, name, solid, triangles, turn.apply([0.0, 0.0, 1.0]), smooth, as_file, plan, pad)


def _draw_shape(spacing: float, rng: np.random.Generator, words: list[str]) -> PlaneShape:
    kind = str(rng.choice(list(OUTLINES)))
    shape = PlaneShape(*draw_outline(kind, rng), (), ())
    gap = 2.0 * spacing
    holes = place_discs(shape, int(rng.integers(0, 4)), 0.02, 0.1, gap, rng)
    shape = shape._replace(holes=(*shape.holes, *holes))
    pockets = place_discs(shape, int(rng.random() < 0.25), 0.04, 0.12, gap, rng)
    words += [kind, *([f"{len(holes)} holes"] if holes else []), *(["pocket"] if pockets else [])]
    return shape._replace(pockets=tuple(pockets))


def _draw_top(
    shape: PlaneShape, spacing: float, rng: np.random.Generator, words: list[str]
) -> tuple[Callable[[Array], Array], tuple[Array, ...], bool]:
    """Height over the plane, lines along which it bends sharply, and whether it is one smooth face."""
    terms: list[Callable[[Array], Array]] = []
    creases: list[Array] = []
    smooth = not shape.pockets
    if rng.random() < 0.6:
        terms.append(_bumps(rng))
        words.append("bumps")
    if rng.random() < 0.3:
        slope = np.tan(np.radians(rng.uniform(0.0, 12.0))) * _direction(rng)
        terms.append(lambda points: points @ slope)
        words.append("tilted")
    feature = rng.choice(["", "fold", "step"], p=[0.65, 0.2, 0.15])
    if feature:
        across, middle = _direction(rng), rng.uniform(-0.15, 0.15)
        angle = np.radians(rng.uniform(5.0, 22.0)) * rng.choice([-1.0, 1.0])
        width, rise = 0.4 * spacing, rng.uniform(0.5, 3.0) * spacing
        if feature == "fold":
            terms.append(lambda points: np.tan(angle) * np.abs(points @ across - middle))
            levels = [middle]
        else:
            terms.append(lambda points: rise * np.clip((points @ across - middle) / width, 0.0, 1.0))
            levels = [middle, middle + width]
        lines = [_line_inside(shape, across, level, spacing) for level in levels]
        creases = [line for line in lines if len(line) > 3]
        smooth &= feature == "fold" and abs(angle) < np.radians(12.0)
        words.append(f"fold {2 * np.degrees(angle):.0f} deg" if feature == "fold" else "step")
    return (
        (lambda points: sum((term(points) for term in terms), np.zeros(len(points)))),
        tuple(creases),
        smooth,
    )


def _direction(rng: np.random.Generator) -> Array:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _bumps(rng: np.random.Generator) -> Callable[[Array], Array]:
    count = int(rng.integers(1, 5))
    middles, sizes = rng.uniform(-0.5, 0.5, (count, 2)), rng.uniform(0.12, 0.35, count)
    # A Gaussian bump is steepest at 0.6 height / width.
    heights = rng.uniform(-1.0, 1.0, count) * np.tan(GENTLE) * sizes / 0.6 / np.sqrt(count)

    def height(points: Array) -> Array:
        away2 = ((points[:, None] - middles) ** 2).sum(axis=2)
        return np.asarray((heights * np.exp(-0.5 * away2 / sizes**2)).sum(axis=1))

    return height


def _line_inside(shape: PlaneShape, across: Array, level: float, spacing: float) -> Array:
    """The longest piece inside the shape of a straight line, kept clear of its loops."""
    s = np.arange(-0.8, 0.8, 0.5 * spacing)
    points = level * across + s[:, None] * np.array([-across[1], across[0]])
    loops = [shape.outline, *shape.holes, *shape.pockets]
    free = inside(shape.outline, points) & ~np.any(
        [inside(loop, points) for loop in loops[1:]] or [s > 9.0], axis=0
    )
    free &= np.minimum.reduce([away(loop, points) for loop in loops]) > 0.8 * spacing
    pieces = np.split(np.arange(len(s)), np.flatnonzero(np.diff(free)) + 1)
    longest = max((rows for rows in pieces if free[rows[0]]), key=len, default=np.empty(0, dtype=int))
    return np.asarray(points[longest[[0, -1]]] if len(longest) > 3 else np.empty((0, 2)))


def _draw_place(rng: np.random.Generator) -> tuple[float, Rotation, Array]:
    size = 0.02 * 20.0 ** rng.random()
    turns = (
        Rotation.identity(),
        Rotation.from_rotvec(0.5 * np.pi * np.eye(3)[rng.integers(3)] * rng.integers(1, 4)),
        Rotation.random(random_state=rng),
    )
    return float(size), turns[int(rng.choice(3, p=[0.3, 0.2, 0.5]))], size * rng.uniform(-2.0, 2.0, 3)


def _draw_request(
    solid: Solid, turn: Rotation, pattern: str, region: str, rng: np.random.Generator
) -> tuple[PlanConfig, PadConfig]:
    """A pad, a step-over and a region that suit the part."""
    corners = solid.vertices[solid.faces[: solid.top]]
    areas = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    width = float(np.sqrt(areas.sum()))
    radius = width * rng.uniform(0.04, 0.1)
    stepover = max(2.0 * radius * rng.uniform(0.15, 0.4), width / 40.0)
    middle = corners.mean(axis=1)[rng.integers(solid.top)]
    kinds = {"auto": 0.62, "top": 0.15, "box": 0.1, "polygon": 0.1, "all": 0.03}
    drawn = str(rng.choice(list(kinds), p=list(kinds.values())))
    region = region or drawn
    half = width * rng.uniform(0.3, 0.5)
    if region == "box":
        region = "box:" + ",".join(f"{1e3 * value:.9g}" for value in (*(middle - half), *(middle + half)))
    if region == "polygon":
        angle = np.arange(7) * 2.0 * np.pi / 7.0
        flat = (
            half
            * rng.uniform(0.7, 1.3, 7)[:, None]
            * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        )
        region = "polygon:" + ";".join(
            ",".join(f"{1e3 * x:.9g}" for x in p) for p in middle + turn.apply(flat)
        )
    plan = PlanConfig(pattern=pattern, region=region, stepover_m=stepover, bridge_m=0.8 * radius)
    return plan, PadConfig(radius_m=radius)
