"""Surfaces and parts whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from polish_sim.config import PartConfig, PlanConfig
from polish_sim.geometry import ClosestPoints, Region, fit_surface, load_part, select_region
from polish_sim.models import workpiece_path
from polish_sim.planning import PlanResult, plan_part

Array = NDArray[np.float64]


class Ball:
    """A sphere about the origin; its closest point is known in closed form."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def closest(self, points: Array, hint: NDArray[np.int32] | None = None) -> ClosestPoints:
        normals = points / np.linalg.norm(points, axis=1, keepdims=True)
        return on_surface(self.radius * normals, normals)


class Floor:
    """The plane z = 0."""

    def closest(self, points: Array, hint: NDArray[np.int32] | None = None) -> ClosestPoints:
        return on_surface(points * [1.0, 1.0, 0.0], np.tile([0.0, 0.0, 1.0], (len(points), 1)))


class Bar:
    """A cylinder about the y axis."""

    def __init__(self, radius: float) -> None:
        self.radius = radius

    def closest(self, points: Array, hint: NDArray[np.int32] | None = None) -> ClosestPoints:
        radial = points * [1.0, 0.0, 1.0]
        normals = radial / np.linalg.norm(radial, axis=1, keepdims=True)
        return on_surface(self.radius * normals + points * [0.0, 1.0, 0.0], normals)


def on_surface(positions: Array, normals: Array) -> ClosestPoints:
    count = len(positions)
    return ClosestPoints(positions, normals, np.zeros(count, np.int32), np.tile([1.0, 0.0, 0.0], (count, 1)))


def prism(inside: Callable[[Array, Array], Array], size_mm: float, cell_mm: float = 5.0) -> trimesh.Trimesh:
    """A 10 mm thick plate made of the grid cells whose middles lie inside an outline (coordinates in mm)."""
    count = round(size_mm / cell_mm)
    middles = (np.arange(count) + 0.5) * cell_mm - 0.5 * size_mm
    cells = np.argwhere(inside(*np.meshgrid(middles, middles, indexing="ij")))
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    top = cells[:, None] + corners
    flat = top.reshape(-1, 2)
    keys, index = np.unique(flat, axis=0, return_inverse=True)
    quads = index.reshape(-1, 4)
    upper = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    edges = np.concatenate([upper[:, [0, 1]], upper[:, [1, 2]], upper[:, [2, 0]]])
    known = {tuple(edge) for edge in edges.tolist()}
    rim = np.array([edge for edge in edges.tolist() if (edge[1], edge[0]) not in known])
    below = len(keys)
    walls = np.concatenate(
        [
            np.stack([rim[:, 0] + below, rim[:, 1] + below, rim[:, 1]], axis=1),
            np.stack([rim[:, 0] + below, rim[:, 1], rim[:, 0]], axis=1),
        ]
    )
    plane = keys * cell_mm - 0.5 * size_mm
    vertices = np.concatenate([np.column_stack([plane, np.full(below, z)]) for z in (10.0, 0.0)])
    return trimesh.Trimesh(vertices, np.concatenate([upper, upper[:, ::-1] + below, walls]), process=False)


def plan_of(mesh: trimesh.Trimesh, file: Path, plan: PlanConfig) -> PlanResult:
    mesh.export(file)
    return plan_part(PartConfig(str(file), up="z"), plan)


@cache
def shipped_plan(name: str, pattern: str = "spiral") -> PlanResult:
    """The plan of a shipped part with 8 mm step-over; made once for all tests."""
    return plan_part(PartConfig(name), PlanConfig(pattern=pattern, stepover_m=0.008))


def with_wishes(plan: PlanResult) -> PlanResult:
    """The plan with a force and a feed of its own at every point."""
    count = len(plan.path.s)
    path = replace(plan.path, force=np.linspace(5.0, 25.0, count), feed=np.linspace(0.005, 0.02, count))
    return replace(plan, path=path)


def region_of(name: str) -> Region:
    mesh = load_part(workpiece_path(name), "mm", "z")
    return select_region(fit_surface(mesh), mesh)
