"""Planning by one call per pattern, for Python users: a region and a step-over in, arrays out.

mesh = load_part("part.stl")
surface = fit_surface(mesh)
path = plan_spiral(select_region(surface, mesh), stepover=0.008)
path.positions_work, path.axes_work      # (n, 3), metres, work frame
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from polish_sim.config import PadConfig, PlanConfig, ProcessConfig
from polish_sim.geometry import Region
from polish_sim.planning.ground.ground import prepare_ground
from polish_sim.planning.planner import plan_path
from polish_sim.planning.quality.figures import measure_quality
from polish_sim.planning.toolpath import ToolPath

Point = Sequence[float]


def plan_spiral(
    region: Region,
    stepover: float = 0.008,
    order: str = "inward",
    direction: str = "conventional",
    start: Point = (),
    plan: PlanConfig | None = None,
) -> ToolPath:
    """Cover a region with a spiral that follows its border (paper 1, section 1.3).

    Args:
        region: What to cover.
        stepover: Distance between neighbouring turns [m].
        order: ``inward`` or ``outward``.
        direction: ``conventional`` or ``climb``.
        start: Where the path begins, about, work frame [m], shape (3,); empty = chosen.
        plan: All other wishes (lead-in, lead and tilt angle, clearance, ...); the defaults if left out.

    Returns:
        The path on the surface, with approach, lead-in, lead-out and retract.

    Raises:
        PlanError: The step-over does not fit the region.
    """
    asked = replace(plan or PlanConfig(), pattern="spiral", stepover_m=stepover)
    return plan_path(region, replace(asked, order=order, direction=direction, start=_point(start)))


def plan_contour(
    region: Region,
    stepover: float = 0.008,
    order: str = "inward",
    direction: str = "conventional",
    start: Point = (),
    plan: PlanConfig | None = None,
) -> ToolPath:
    """Cover a region with closed loops parallel to its border; arguments as of `plan_spiral`."""
    asked = replace(plan or PlanConfig(), pattern="contour", stepover_m=stepover)
    return plan_path(region, replace(asked, order=order, direction=direction, start=_point(start)))


def plan_fermat(region: Region, stepover: float = 0.008, start: Point = (), plan: PlanConfig | None = None) -> ToolPath:
    """Cover a region, holes or not, in one stroke: a connected Fermat spiral; arguments as of `plan_spiral`."""
    asked = replace(plan or PlanConfig(), pattern="fermat", stepover_m=stepover)
    return plan_path(region, replace(asked, start=_point(start)))


def plan_raster(
    region: Region,
    stepover: float = 0.008,
    along: Point = (),
    start: Point = (),
    plan: PlanConfig | None = None,
) -> ToolPath:
    """Cover a region with lines to and fro, joined by rounded turns.

    Args:
        region: What to cover.
        stepover: Distance between neighbouring lines [m].
        along: Direction of the lines in the work frame, shape (3,); empty = along the region's long axis.
        start: Where the path begins, about, work frame [m], shape (3,); empty = chosen.
        plan: All other wishes; the defaults if left out.

    Returns:
        The path, as of `plan_spiral`.

    Raises:
        PlanError: The step-over does not fit the region.
    """
    asked = replace(plan or PlanConfig(), pattern="raster", stepover_m=stepover)
    return plan_path(region, replace(asked, raster_direction=_point(along), start=_point(start)))


def measure_path(
    path: ToolPath, region: Region, stepover: float, pad_radius: float = 0.025, contact_force: float = 20.0
) -> dict[str, Any]:
    """Measure how well a path covers a region.

    Args:
        path: The path on the surface.
        region: What it is to cover.
        stepover: Distance between turns it is measured by [m].
        pad_radius: Radius of the pad [m].
        contact_force: Force the pad is pressed with where the path has none of its own [N].

    Returns:
        Figures by their names in metrics.json, SI.
    """
    ground = prepare_ground(region, PlanConfig(stepover_m=stepover))
    process, pad = ProcessConfig(contact_force_n=contact_force), PadConfig(radius_m=pad_radius)
    return measure_quality(ground, path, stepover, process, pad).figures


def _point(values: Point) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
