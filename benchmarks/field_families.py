"""Families of parts as engineers have them, their sizes and shapes drawn by a random generator.

Standard parts come from bd_warehouse, drawn ones from build123d; formulas and trimesh give the rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import bd_warehouse.bearing as bearings
import bd_warehouse.flange as flanges
import bd_warehouse.gear as gears
import build123d as bd
import numpy as np
import trimesh
from bd_warehouse.open_builds import VSlotLinearRail
from bd_warehouse.sprocket import Sprocket

from benchmarks.field_shapes import parts

Generator = np.random.Generator
Draw = Callable[[Generator], Any]
SIZES_MM = (40.0, 180.0)  #: Largest dimension of what is not of a standard size
TOLERANCES_MM = (0.02, 0.05, 0.1)  #: Of triangulating a smooth surface
ANGLES = (0.1, 0.2, 0.4)  #: Between neighbouring facets of it [rad]
UP = ("--up", "z")


class Family(NamedTuple):
    """Parts of one kind."""

    draw: Draw  #: Draws a part: a solid of build123d or a mesh [mm]
    options: tuple[str, ...] = ()  #: Of ``plan``, as a user would give them


def _size(rng: Generator, low: float = SIZES_MM[0], high: float = SIZES_MM[1]) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def _flange(rng: Generator) -> Any:
    kind = (flanges.BlindFlange, flanges.SlipOnFlange, flanges.WeldNeckFlange)[rng.integers(3)]
    return kind(
        str(rng.choice(["1", "1 1/4", "1 1/2", "2", "2 1/2"])), 150, str(rng.choice(["Flat", "Raised"]))
    )


def _gear(rng: Generator) -> Any:
    module, teeth = float(rng.choice([2.0, 2.5, 3.0, 4.0])), int(rng.integers(18, 42))
    thickness, bore = float(rng.uniform(8.0, 30.0)), float(rng.uniform(0.1, 0.4)) * module * teeth
    if rng.random() < 0.5:
        body = gears.SpurGear(module, teeth, 20.0, thickness)
    else:
        body = gears.HelicalGear(module, teeth, 20.0, float(rng.uniform(8.0, 25.0)), thickness)
    return body - bd.Cylinder(bore / 2.0, 3.0 * thickness)


def _bearing(rng: Generator) -> Any:
    kind = (bearings.SingleRowAngularContactBallBearing, bearings.SingleRowTaperedRollerBearing)[
        rng.integers(2)
    ]
    sizes = [size for size in kind.sizes("SKT") if 40.0 <= float(size.split("-")[1]) <= 120.0]
    return kind(str(rng.choice(sizes)), "SKT")


def _sprocket(rng: Generator) -> Any:
    teeth, thickness = int(rng.integers(16, 40)), float(rng.uniform(3.0, 8.0))
    bore = 12.7 * teeth / math.pi * float(rng.uniform(0.15, 0.5))
    return Sprocket(teeth, thickness=thickness, bore_diameter=bore)


def _rail(rng: Generator) -> Any:
    return VSlotLinearRail(str(rng.choice(["20x40", "20x60", "20x80", "40x40"])), _size(rng, 60.0)).rotate(
        bd.Axis.X, 90.0
    )


def _pipe(rng: Generator) -> Any:
    radius, length = _size(rng, 12.0, 50.0), _size(rng, 60.0)
    return bd.Cylinder(radius, length) - bd.Cylinder(0.85 * radius, 2.0 * length)


def _elbow(rng: Generator) -> Any:
    radius = _size(rng, 12.0, 35.0)
    bend = radius * float(rng.uniform(1.6, 3.5))
    way = bd.CenterArc((0.0, 0.0), bend, 0.0, float(rng.choice([45.0, 60.0, 90.0])))
    start = bd.Plane(origin=way @ 0, z_dir=way % 0)
    return bd.sweep(start * (bd.Circle(radius) - bd.Circle(0.85 * radius)), path=way)


def _tee(rng: Generator) -> Any:
    radius = _size(rng, 12.0, 32.0)
    length, branch = 2.0 * radius * float(rng.uniform(2.0, 3.0)), radius * float(rng.uniform(0.6, 0.9))
    run = bd.Rot(0.0, 90.0, 0.0) * bd.Cylinder(radius, length)
    arm = bd.Pos(0.0, 0.5 * length / 2.0, 0.0) * (bd.Rot(90.0, 0.0, 0.0) * bd.Cylinder(branch, length / 2.0))
    body = run + arm
    seam = [e for e in body.edges() if e.geom_type not in (bd.GeomType.LINE, bd.GeomType.CIRCLE)]
    if seam:
        body = bd.fillet(seam, 0.15 * branch)
    return body - bd.Rot(0.0, 90.0, 0.0) * bd.Cylinder(0.8 * radius, 2.0 * length)


def _plate(length: float, width: float, thickness: float, rim: float) -> Any:
    """A plate whose upright edges are rounded, and the edges of its top by ``rim``."""
    body = bd.Box(length, width, thickness)
    body = bd.fillet(body.edges().filter_by(bd.Axis.Z), 0.12 * width)
    return bd.fillet(body.faces().sort_by(bd.Axis.Z)[-1].edges(), rim) if rim > 0.0 else body


def _holes(body: Any, places: list[tuple[float, float]], radius: float) -> Any:
    for x, y in places:
        body = body - bd.Pos(x, y, 0.0) * bd.Cylinder(radius, 500.0)
    return body


def _hinge(rng: Generator) -> Any:
    length, width = _size(rng, 50.0, 160.0), _size(rng, 25.0, 70.0)
    thickness = float(rng.uniform(3.0, 6.0))
    leaf = _plate(length, width, thickness, 0.0)
    knuckles = int(rng.integers(2, 4))
    span = length / (2 * knuckles - 1)
    for k in range(knuckles):
        place = bd.Pos(-length / 2 + (2 * k + 0.5) * span, -width / 2, thickness * 0.5)
        leaf = leaf + place * (bd.Rot(0.0, 90.0, 0.0) * bd.Cylinder(thickness, span))
    for x in (-0.3 * length, 0.0, 0.3 * length):
        leaf = leaf - bd.Pos(x, 0.15 * width, thickness / 2) * bd.Cone(
            1.5, 4.5, 3.0, align=(bd.Align.CENTER,) * 3
        )
    return _holes(leaf, [(x, 0.15 * width) for x in (-0.3 * length, 0.0, 0.3 * length)], 2.2)


def _bracket(rng: Generator) -> Any:
    length, width, height = _size(rng, 40.0, 140.0), _size(rng, 20.0, 80.0), _size(rng, 25.0, 80.0)
    t = float(rng.uniform(4.0, 10.0))
    low = (bd.Align.CENTER, bd.Align.MIN, bd.Align.MIN)
    body = bd.Box(width, length, t, align=low) + bd.Box(width, t, height, align=low)
    corner = [
        e for e in body.edges().filter_by(bd.Axis.X) if abs(e.center().Y - t) + abs(e.center().Z - t) < 1e-6
    ]
    body = bd.fillet(corner, float(rng.uniform(0.3, 0.8)) * t)
    body = bd.fillet(body.edges().filter_by(bd.Axis.Z).sort_by(bd.Axis.Y)[-2:], 0.15 * width)
    return _holes(body, [(0.0, 0.35 * length), (0.0, 0.75 * length)], float(rng.uniform(2.5, 4.5)))


def _lid(rng: Generator) -> Any:
    length = _size(rng, 50.0)
    width, height = length * float(rng.uniform(0.45, 1.0)), float(rng.uniform(8.0, 30.0))
    body = _plate(length, width, height, float(rng.uniform(0.1, 0.35)) * min(height, 0.3 * width))
    room = bd.Pos(0.0, 0.0, -3.0) * bd.Box(0.9 * length, 0.88 * width, height)
    corners = [(sx * 0.4 * length, sy * 0.36 * width) for sx in (-1, 1) for sy in (-1, 1)]
    return _holes(body - room, corners, 2.2) if rng.random() < 0.5 else body - room


def _knob(rng: Generator) -> Any:
    radius = _size(rng, 20.0, 60.0)
    height = radius * float(rng.uniform(0.5, 1.2))
    neck = radius * float(rng.uniform(0.4, 0.7))
    curve = bd.Spline((neck, 0.0), (radius, 0.6 * height), (0.6 * radius, 0.95 * height), (0.0, height),
                      tangents=((0.3, 1.0), (-1.0, 0.0)))  # fmt: skip
    edge = [curve, bd.Line((0.0, height), (0.0, 0.0)), bd.Line((0.0, 0.0), (neck, 0.0))]
    return bd.revolve(bd.Plane.XZ * bd.make_face(edge), axis=bd.Axis.Z)


def _fairing(rng: Generator) -> Any:
    length = _size(rng, 60.0)
    sections = []
    for share, scale in (
        (0.0, 1.0),
        (0.5, float(rng.uniform(0.8, 1.3))),
        (1.0, float(rng.uniform(0.3, 0.8))),
    ):
        a = 0.3 * length * scale
        sections.append(bd.Pos(0.0, 0.0, share * length) * bd.Ellipse(a, a * float(rng.uniform(0.4, 0.8))))
    return bd.loft(sections).rotate(bd.Axis.X, 90.0)


def _fan(rng: Generator) -> Any:
    radius = _size(rng, 20.0, 80.0)
    hub, thickness = radius * float(rng.uniform(0.25, 0.45)), float(rng.uniform(3.0, 8.0))
    body = bd.Cylinder(hub, 2.0 * thickness)
    count = int(rng.integers(3, 7))
    blade = bd.Pos(0.5 * (hub + radius) - 1.0, 0.0, 0.0) * (
        bd.Rot(float(rng.uniform(10.0, 35.0)), 0.0, 0.0)
        * bd.Box(radius - hub + 2.0, 1.1 * radius / count + hub, 3.0)
    )
    for k in range(count):
        body = body + bd.Rot(0.0, 0.0, 360.0 * k / count) * blade
    return body - bd.Cylinder(0.4 * hub, 100.0)


def _rod(rng: Generator) -> Any:
    length = _size(rng, 60.0)
    big, small = 0.25 * length, 0.25 * length * float(rng.uniform(0.4, 0.9))
    thickness = float(rng.uniform(8.0, 20.0))
    body = bd.Cylinder(big, thickness) + bd.Pos(length - big - small, 0.0, 0.0) * bd.Cylinder(
        small, thickness
    )
    body = body + bd.Pos((length - big - small) / 2, 0.0, 0.0) * bd.Box(
        length - big - small, small, 0.6 * thickness
    )
    body = body - bd.Cylinder(0.55 * big, 100.0)
    return body - bd.Pos(length - big - small, 0.0, 0.0) * bd.Cylinder(0.5 * small, 100.0)


def _primitive(rng: Generator) -> trimesh.Trimesh:
    size = _size(rng)
    kind = int(rng.integers(4))
    if kind == 0:
        return trimesh.creation.torus(size / 2.6, size / 2.6 * float(rng.uniform(0.15, 0.3)), 96, 48)
    if kind == 1:
        return trimesh.creation.capsule(size / 2.0, size / 4.0, count=[48, 48])
    if kind == 2:
        return trimesh.creation.cone(size / 2.0, size * float(rng.uniform(0.2, 0.6)), sections=96)
    return trimesh.creation.icosphere(4, size / 2.0)


def _shape(name: str) -> Draw:
    """A shape of a formula, as large as drawn and a little out of proportion."""

    def draw(rng: Generator) -> trimesh.Trimesh:
        mesh = parts()[name]()
        stretch = rng.uniform(0.85, 1.15, 3) * _size(rng) / float(np.ptp(mesh.vertices, axis=0).max())
        mesh.apply_transform(np.diag([*stretch, 1.0]))
        return mesh

    return draw


FAMILIES: dict[str, Family] = {
    "flange": Family(_flange),
    "gear": Family(_gear),
    "bearing": Family(_bearing),
    "sprocket": Family(_sprocket),
    "rail": Family(_rail),
    "pipe": Family(_pipe),
    "elbow": Family(_elbow),
    "tee": Family(_tee),
    "hinge": Family(_hinge, UP),
    "bracket": Family(_bracket),
    "lid": Family(_lid, UP),
    "knob": Family(_knob),
    "fairing": Family(_fairing),
    "fan": Family(_fan, UP),
    "rod": Family(_rod),
    "primitive": Family(_primitive),
    "blade": Family(_shape("blade")),
    "dome": Family(_shape("dome")),
    "bowl": Family(_shape("bowl_60"), UP),
    "casting": Family(_shape("wavy_coarse"), UP),
    "mould": Family(_shape("mould_half"), UP),
    "panel": Family(_shape("door_panel"), UP),
    "pocket": Family(_shape("housing_pocket"), UP),
    "scan": Family(_shape("scan_figurine")),
    "trough": Family(_shape("trough"), UP),
}


def draw_mesh(family: Family, rng: Generator) -> trimesh.Trimesh:
    """Draw a part of a family; a solid is triangulated as finely as drawn [mm]."""
    drawn = family.draw(rng)
    if isinstance(drawn, trimesh.Trimesh):
        return drawn
    points, triangles = drawn.tessellate(float(rng.choice(TOLERANCES_MM)), float(rng.choice(ANGLES)))
    return trimesh.Trimesh([tuple(point) for point in points], triangles)
