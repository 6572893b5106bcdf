"""What a hand drags the tool along: a part's rim or a path's file, placed before the arm (layer 9)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import Scenario
from polish_sim.errors import PlanError
from polish_sim.exchange import read_path
from polish_sim.experiments.part_setup import part_file, reach_path
from polish_sim.experiments.placement import Reach, tool_rotations
from polish_sim.geometry import PartMesh, Surface, fit_surface, load_part, select_region
from polish_sim.planning.toolpath import PROCESS, ToolPath, arc_length
from polish_sim.spatial import apply

Array = NDArray[np.float64]

RIM: Final = "rim"
SPACING_M: Final = 0.001


class DragTask(NamedTuple):
    """A part, what is shown on it, and the way the arm does it."""

    mesh: PartMesh
    surface: Surface
    path: ToolPath
    """What the hand means to show, work frame."""
    reach: Reach

    @property
    def positions_base(self) -> Array:
        """Points of the path, base frame [m], shape (n, 3)."""
        return apply(self.reach.T_base_work, self.path.positions_work)

    @property
    def rotations(self) -> Array:
        """Tool frames along it, shape (n, 3, 3)."""
        return tool_rotations(self.path.axes_work @ self.reach.T_base_work[:3, :3].T, self.reach.spin)


def prepare_drag(scenario: Scenario) -> DragTask:
    """Take the part and what is to be shown on it, and check that the arm can be dragged along it.

    Raises:
        PolishSimError: The part or path cannot be used or reached.
    """
    part, plan = scenario.part, scenario.plan
    mesh = load_part(part_file(part.file), part.unit, part.up)
    surface = fit_surface(mesh, plan.feature_angle_rad)
    if scenario.drag.follow == RIM:
        margin = plan.edge_margin_m or scenario.pad.radius_m
        region = select_region(surface, mesh, plan.region, plan.feature_angle_rad, margin)
        path = _rim(surface, region.components()[0].boundary_loops[0])
    else:
        path = read_path(Path(scenario.drag.follow))
        path = path.rows(path.segment == PROCESS)
    if len(path.s) < 2 or arc_length(path.positions_work)[-1] < SPACING_M:
        raise PlanError(f"'{scenario.drag.follow}' has no way on the part to be dragged along.")
    # Nothing is pressed while the hand teaches.
    unpressed = replace(scenario, process=replace(scenario.process, contact_force_n=1e-9))
    return DragTask(mesh, surface, path, reach_path(unpressed, mesh, path))


def _rim(surface: Surface, loop: Array) -> ToolPath:
    """A closed border as a path with the surface's normals, a point every millimetre."""
    s = arc_length(loop)
    at = np.linspace(0.0, s[-1], max(4, round(s[-1] / SPACING_M)) + 1)
    found = surface.closest(np.stack([np.interp(at, s, loop[:, k]) for k in range(3)], axis=1))
    along = np.gradient(found.positions, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    n = len(at)
    return ToolPath(
        found.positions.copy(), found.normals.copy(), arc_length(found.positions), np.zeros(n, np.int64),
        np.full(n, PROCESS, np.int8), surface.normal_curvature(found.facets, found.barycentric, along),
    )  # fmt: skip
