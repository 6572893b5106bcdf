"""Surfaces and parts whose truth is known."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import shapely
import trimesh

from polish_sim.arrays import Array, directions_at, foot_on_chord
from polish_sim.config import PadConfig, PartConfig, PlanConfig
from polish_sim.geometry import Region, fit_surface, load_part, select_region
from polish_sim.models import workpiece_path
from polish_sim.planning import PlanResult, plan_part
from polish_sim.planning.curve import Curve
from polish_sim.planning.part_plan import USUAL_PAD
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length
from tests.kept import keep

UP = np.array([0.0, 0.0, 1.0])


def circle(radius: float, height: float = 0.0, count: int = 400, centre=(0.0, 0.0)) -> Array:
    """Points of a level circle, counter-clockwise, shape (count, 3)."""
    flat = radius * directions_at(np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)) + centre
    return np.column_stack([flat, np.full(count, height)])


def square(half: float, count: int = 200) -> Array:
    """Points of a square in the plane z = 0, counter-clockwise, shape (4 count, 3)."""
    side, edge = np.linspace(-half, half, count, endpoint=False), np.full(count, half)
    corners = [(side, -edge), (edge, side), (-side, edge), (-edge, -side)]
    return np.concatenate([np.stack([x, y, 0.0 * x], axis=1) for x, y in corners])


def level(points: Array, closed: bool = False) -> Curve:
    """A curve through points, shape (n, 2) or (n, 3), on ground that looks up."""
    points = np.column_stack([points, np.zeros((len(points), 3 - np.shape(points)[1]))])
    return Curve(points, np.tile(UP, (len(points), 1)), closed)


def path_through(points: Array, axes: Array = UP, feed: Array | None = None) -> ToolPath:
    """A path in contact all along points (n, 3) [m]."""
    points = np.asarray(points, dtype=float)
    axes = np.broadcast_to(np.asarray(axes, dtype=float), points.shape).copy()
    zeros, segment = np.zeros(len(points)), np.full(len(points), PROCESS, np.int8)
    return ToolPath(points, axes, arc_length(points), zeros.astype(np.int64), segment, zeros, feed=feed)


def to_polyline(points: Array, corners: Array) -> Array:
    """Distances (n,) of points (n, 3) from a polyline through corners (m, 3)."""
    return foot_on_chord(points[:, None] - corners[:-1], np.diff(corners, axis=0))[1].min(axis=1)


def block(sides: Sequence[float], at: Sequence[float] = (0.0, 0.0, 0.0)) -> trimesh.Trimesh:
    """A block of these sides with its middle at a place [mm]."""
    return trimesh.creation.box(sides).apply_translation(at)


def union(*solids: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.boolean.union(solids, engine="manifold")


def pocket(wall_mm: float = 30.0, ring_mm: float = 40.0) -> trimesh.Trimesh:
    """A square pocket 120 x 120 mm in a block, its floor at z = 0, with this wall around."""
    side = 120 + 2 * ring_mm
    outer = block((side, side, 20 + wall_mm), (0, 0, wall_mm / 2 - 10))
    inner = block((120, 120, wall_mm), (0, 0, wall_mm / 2))
    return trimesh.boolean.difference([outer, inner], engine="manifold")


def plate(outline: shapely.Geometry) -> trimesh.Trimesh:
    """A 10 mm thick plate over an outline in mm."""
    return trimesh.creation.extrude_polygon(outline, 10.0)


def plan_of(mesh: trimesh.Trimesh, file: Path, plan: PlanConfig, pad: PadConfig = USUAL_PAD) -> PlanResult:
    mesh.export(file)
    return plan_part(PartConfig(str(file), up="z"), plan, pad=pad)


@cache
def shipped_plan(name: str, pattern: str = "spiral") -> PlanResult:
    """The plan of a shipped part with 8 mm step-over; made once for all tests."""
    part, plan = PartConfig(name), PlanConfig(pattern=pattern, stepover_m=0.008)
    return keep(("plan", part, plan), lambda: plan_part(part, plan))


def with_wishes(plan: PlanResult) -> PlanResult:
    """The plan with a force and a feed of its own at every point."""
    count = len(plan.path.s)
    path = replace(plan.path, force=np.linspace(5.0, 25.0, count), feed=np.linspace(0.005, 0.02, count))
    return replace(plan, path=path)


def region_of(name: str) -> Region:
    mesh = load_part(workpiece_path(name), "mm", "z")
    return select_region(fit_surface(mesh), mesh)
