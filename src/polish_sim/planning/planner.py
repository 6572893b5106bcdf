"""From a region and a plan request to the tool path (Region, PlanConfig -> ToolPath)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from polish_sim.config import PlanConfig
from polish_sim.errors import PlanError, unknown_name
from polish_sim.geometry import Region
from polish_sim.planning.approach import LEADS, Move, concatenate, process_move, travel, with_leads
from polish_sim.planning.curve import unit
from polish_sim.planning.holes import bridge_holes
from polish_sim.planning.patterns import PATTERNS
from polish_sim.planning.request import PatternRequest, Report
from polish_sim.planning.run import SurfaceRun, shortest_way
from polish_sim.planning.tool_axes import lean, soften_creases
from polish_sim.planning.toolpath import ToolPath, arc_length
from polish_sim.planning.triangulation import Triangulation, triangulate

Array = NDArray[np.float64]

EDGES_PER_STEPOVER = 3.0
CREASE_REACH = 0.5
"""The tool axis turns over a crease within this many step-overs on either side."""


class Ground(NamedTuple):
    """A region made ready to be planned on."""

    region: Region
    """The region, its small holes closed."""
    mesh: Triangulation
    """Its fine triangulation."""
    part_facets: int
    """Number of facets that are the part's; those after them close holes."""
    holes: int
    """Number of holes closed."""


def plan_path(region: Region, plan: PlanConfig, on_progress: Report | None = None) -> ToolPath:
    """Cover a region with a tool path.

    Args:
        region: What is to be polished.
        plan: Pattern, step-over, how the tool lands.
        on_progress: Called with the share of the region covered so far.

    Returns:
        The path on the surface, with approach, lead-in, lead-out and retract.

    Raises:
        InputError: Unknown pattern or lead-in.
        PlanError: The step-over does not fit the region.
    """
    return path_on(prepare_ground(region, plan), plan, on_progress)


def prepare_ground(region: Region, plan: PlanConfig) -> Ground:
    """Close small holes and triangulate finely enough to tell turns apart.

    Raises:
        PlanError: The region has no border, or the step-over is not positive or larger than the region.
    """
    size = float(np.linalg.norm(np.diff(region.surface.bounds, axis=0)))
    if not 0.0 < plan.stepover_m < size:
        raise PlanError(
            f"a step-over of {plan.stepover_m * 1e3:.4g} mm does not fit: it must be positive and smaller than the "
            f"region, which measures {size * 1e3:.4g} mm across. Set another step-over."
        )
    if not region.boundary_loops:
        raise PlanError(
            "the region is closed all round, a path needs a border to start from. "
            "Choose a region that looks one way, e.g. 'top', or a box."
        )
    bridged = bridge_holes(region, plan.bridge_m)
    mesh = triangulate(bridged.region.surface, plan.stepover_m / EDGES_PER_STEPOVER)
    return Ground(bridged.region, mesh, bridged.facets, bridged.holes)


def path_on(ground: Ground, plan: PlanConfig, on_progress: Report | None = None) -> ToolPath:
    """As `plan_path`, on ground prepared before."""
    if plan.pattern not in PATTERNS:
        raise unknown_name("pattern", plan.pattern, PATTERNS)
    if plan.lead_in not in LEADS:
        raise unknown_name("lead-in", plan.lead_in, LEADS)
    runs = PATTERNS[plan.pattern].plan(PatternRequest(ground.region, ground.mesh, plan, on_progress or _silent))
    if not runs:
        raise PlanError(
            f"the region is too narrow for a step-over of {plan.stepover_m * 1e3:.4g} mm: no turn fits half of it "
            "inside the border. Set a smaller step-over or a larger region."
        )
    return assemble(ground.region, runs, plan)


def assemble(region: Region, runs: Sequence[SurfaceRun], plan: PlanConfig) -> ToolPath:
    """Give runs their tool axes and leads and put them in a row."""
    top = float((region.surface.vertices @ region.up).max()) + plan.clearance_m
    moves: list[Move] = []
    curvature: list[Array] = []
    passes = 0
    for run in shortest_way(runs):
        tangents = unit(np.gradient(run.positions, axis=0))
        normals = soften_creases(run.points.normals, arc_length(run.positions), CREASE_REACH * plan.stepover_m)
        axes = lean(normals, tangents, plan.lead_angle_rad, plan.tilt_angle_rad)
        process = process_move(run.positions, axes, run.pass_index + passes)
        passes = int(process.pass_index.max()) + 1
        parts = with_leads(process, LEADS[plan.lead_in], plan.clearance_m)
        if moves:
            parts = [travel(moves[-1], parts[0], region.up, top), *parts]
        bend = region.surface.normal_curvature(run.points.facets, run.points.barycentric, tangents)
        before = sum(len(part.positions) for part in parts[:-3])
        after = sum(len(part.positions) for part in parts[-2:])
        curvature.append(np.pad(bend, (before, after), mode="edge"))
        moves += parts
    positions, axes, segment, pass_index = concatenate(moves)
    return ToolPath(positions, axes, arc_length(positions), pass_index, segment, np.concatenate(curvature))


def _silent(share: float) -> None:
    """Progress nobody asked for."""
