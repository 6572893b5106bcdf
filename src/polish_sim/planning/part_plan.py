"""From a part's file to a measured plan in one call: for the command line, for runs and from Python."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from polish_sim.arrays import Array
from polish_sim.config import PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.errors import PlanError, unknown_name
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface, load_part, select_region
from polish_sim.models import part_path
from polish_sim.planning.feasibility import (
    access_notes,
    check_request,
    check_start,
    in_another_unit,
    overlap_notes,
    pad_notes,
    start_notes,
    stepover_notes,
    wall_notes,
    widest_piece,
)
from polish_sim.planning.ground.ground import Ground, prepare_ground
from polish_sim.planning.moves.leads import with_way_down
from polish_sim.planning.planner import plan_on, plan_path
from polish_sim.planning.quality.access import Access, find_access
from polish_sim.planning.quality.figures import measure_quality, pad_coverage, part_figures
from polish_sim.planning.quality.located import locate
from polish_sim.planning.quality.tool_room import Tool, pad_in_part_warning
from polish_sim.planning.request import check_asked, check_stepover
from polish_sim.planning.toolpath import ToolPath

OFF_PART_M = 1e-3  #: A path made before may lie this far off the fitted surface [m]
ROUNDS = 4  #: A path on which the tool is found in the part is planned so often, those places left out


class PlanObserver(Protocol):
    """Receives the progress of planning."""

    def stage(self, text: str) -> None:
        """Begin a new stage."""

    def progress(self, done: float, total: float) -> None:
        """Progress of the present stage."""


class _Silent:
    def stage(self, text: str) -> None:
        """Ignore."""

    def progress(self, done: float, total: float) -> None:
        """Ignore."""


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A finished plan."""

    mesh: PartMesh
    surface: Surface
    region: Region
    path: ToolPath
    figures: dict[str, Any]  #: The keys of metrics.json of a plan folder
    plan: PlanConfig
    notes: tuple[str, ...]  #: What was assumed, and what the user should know about the pad on this part
    access: Access | None = None  #: What of the region asked for the tool gets at; None if all of it
    in_part: Array = field(default_factory=lambda: np.empty((0, 3)))
    """Tool points at which the tool is in the part [m], shape (k, 3)."""
    tool: Tool = field(default_factory=lambda: Tool(PadConfig(), ProcessConfig().contact_force_n))
    """What it was planned for, or measured with."""


def plan_part(
    part: PartConfig,
    plan: PlanConfig,
    process: ProcessConfig | None = None,
    pad: PadConfig | None = None,
    observer: PlanObserver | None = None,
) -> PlanResult:
    """Load a part, fit its surface, choose the region, plan the path and measure it.

    Raises:
        PolishSimError: The part or the request cannot be used; says why and what to do.
    """
    observer = observer or _Silent()
    check_asked(part, plan, pad or PadConfig())
    begin = time.perf_counter()
    mesh = load_mesh(part, observer)
    return plan_mesh(mesh, plan, process, pad, observer, time.perf_counter() - begin)


def plan_mesh(
    mesh: PartMesh,
    plan: PlanConfig,
    process: ProcessConfig | None = None,
    pad: PadConfig | None = None,
    observer: PlanObserver | None = None,
    spent_s: float = 0.0,
) -> PlanResult:
    """As `plan_part`, on a mesh that is there already; spent_s: time its loading took, counted in plan_time_s [s]."""
    process, pad, observer = process or ProcessConfig(), pad or PadConfig(), observer or _Silent()
    begin = time.perf_counter() - spent_s
    check_stepover(plan, pad)
    observer.stage("fit the surface")
    surface, region = _choose(mesh, plan)
    check_start(surface, plan)
    observer.stage("plan the path")
    ready = _ready(mesh, surface, region, plan, process, pad)
    plan, pad, region, ground, access = ready.plan, ready.pad, ready.region, ready.ground, ready.access
    tool = Tool(pad, process.contact_force_n)
    avoid = np.empty((0, 3))
    for _ in range(ROUNDS):
        planned = plan_on(ground, plan, lambda share: observer.progress(share, 1.0), surface, tool, avoid)
        path = planned.path
        planned_s = time.perf_counter() - begin
        observer.stage("measure the path")
        quality = measure_quality(ground, path, plan.stepover_m, process, pad, surface, access)
        if not quality.pad_in_part.max_m:
            break
        avoid = np.concatenate([avoid, quality.pad_in_part.positions])
    else:
        raise PlanError(f"no path keeps clear of the part: {pad_in_part_warning(quality.figures)}. "
                        "Set a smaller --pad-diameter or another --region.")  # fmt: skip
    figures = {**part_figures(mesh, surface, region), **quality.figures, **planned.figures, "plan_time_s": planned_s}
    remarks = (*ready.notes, *access_notes(access, plan, pad), *planned.notes, *start_notes(path, plan))
    remarks += tuple(stepover_notes(quality.figures["stepover_mean_m"], plan))
    remarks += tuple(overlap_notes(quality.figures["coverage"], plan, pad))
    notes = (*mesh.notes, *region.notes, *remarks, *pad_notes(ground, locate(ground, path), pad))
    within, inside = access.region if access else region, quality.pad_in_part.positions
    return PlanResult(mesh, surface, within, path, figures, plan, notes, access, inside, tool)


def measure_given_path(
    path: ToolPath,
    part: PartConfig,
    plan: PlanConfig,
    process: ProcessConfig | None = None,
    pad: PadConfig | None = None,
    observer: PlanObserver | None = None,
) -> PlanResult:
    """Load a part and measure a path in the work frame that was made before on it, by the plan's region and step-over.

    Raises:
        PolishSimError: The part cannot be used; says why and what to do.
    """
    process, pad, observer = process or ProcessConfig(), pad or PadConfig(), observer or _Silent()
    mesh = load_mesh(part, observer)
    observer.stage("fit the surface")
    surface, region = _choose(mesh, plan)
    observer.stage("measure the path")
    ground, access = accessible(region, surface, plan, process, pad, path)
    quality = measure_quality(ground, path, plan.stepover_m, process, pad, surface, access)
    figures = part_figures(mesh, surface, region) | quality.figures
    off = figures["max_distance_to_surface_m"]
    if off > OFF_PART_M:
        raise PlanError(
            f"the path lies up to {1e3 * off:.2f} mm off the region of this part, more than {1e3 * OFF_PART_M:g} mm. "
            "Was it made on another part, in another unit, or already pressed in? Give the path on the surface itself."
        )
    remarks = (*access_notes(access, plan, pad), *wall_notes(quality))
    tool = Tool(pad, process.contact_force_n)
    path = with_way_down(path, plan.clearance_m)
    notes = (*mesh.notes, *region.notes, *remarks, *pad_notes(ground, locate(ground, path), pad))
    within, inside = access.region if access else region, quality.pad_in_part.positions
    return PlanResult(mesh, surface, within, path, figures, plan, notes, access, inside, tool)


PAD_CHOICES: Final = ("auto", "given")
PAD_SIZES_M: Final = (0.05, 0.04, 0.03, 0.025, 0.02, 0.016, 0.012, 0.01, 0.008, 0.006, 0.005, 0.004, 0.003, 0.002)
"""Diameters a pad is chosen from."""


class _Ready(NamedTuple):
    """What a path is planned on, and with which pad."""

    plan: PlanConfig
    pad: PadConfig
    region: Region
    ground: Ground
    access: Access | None
    notes: tuple[str, ...]


def _ready(
    mesh: PartMesh, surface: Surface, region: Region, plan: PlanConfig, process: ProcessConfig, pad: PadConfig
) -> _Ready:
    """Prepare a region for a pad; one nobody asked for gives way to the largest that is no wider than the region.

    Raises:
        PlanError: The pad, or each that was tried, does not fit.
    """
    width = widest_piece(region)
    if pad.choice not in PAD_CHOICES:
        raise unknown_name("choice of the pad", pad.choice, PAD_CHOICES)
    free = pad.choice == PAD_CHOICES[0] and pad.radius_m == PadConfig().radius_m
    sizes = [size for size in PAD_SIZES_M if size < 2.0 * pad.radius_m and size <= width] if free else []
    refused: PlanError | None = None
    for diameter in [2.0 * pad.radius_m, *sizes]:
        smaller = diameter < 2.0 * pad.radius_m
        if free and not smaller and sizes and diameter > width:
            continue
        taken, asked, notes = pad, plan, tuple[str, ...]()
        if smaller:
            taken = replace(pad, radius_m=0.5 * diameter)
            scale = diameter / (2.0 * pad.radius_m) if plan.stepover_m == PlanConfig().stepover_m else 1.0
            asked = replace(plan, stepover_m=min(scale * plan.stepover_m, diameter))
            notes = (
                f"pad of {1e3 * diameter:.3g} mm and step-over {1e3 * asked.stepover_m:.3g} mm chosen: the default pad "
                f"of {2e3 * pad.radius_m:.3g} mm does not fit the region, {1e3 * width:.3g} mm wide (--pad-diameter)."
                f"{in_another_unit(mesh, width, pad.radius_m)}",
            )
        try:
            wide = check_request(region, taken, mesh)
            return _Ready(asked, taken, wide, *accessible(wide, surface, asked, process, taken), notes)
        except PlanError as error:
            refused = refused or error
    assert refused is not None
    raise refused


def accessible(
    region: Region,
    part: Surface,
    plan: PlanConfig,
    process: ProcessConfig,
    pad: PadConfig,
    path: ToolPath | None = None,
) -> tuple[Ground, Access | None]:
    """The ground of a region the tool gets at, and its access, None where that is all that was asked for.

    Where a ``path`` made before does not keep to what the tool gets at, all of the region counts.

    Raises:
        PlanError: There is no place the tool gets at, or the step-over does not fit.
    """
    asked = prepare_ground(region, plan)
    try:
        access = find_access(asked, region, part, Tool(pad, process.contact_force_n), plan)
    except PlanError:
        if path is None:
            raise
        return asked, None
    if access is None:
        return asked, None
    ground = prepare_ground(access.region, plan)
    if path is not None and locate(ground, path, process).distances.max() > OFF_PART_M:
        return asked, None
    return ground, access


def coverage_until(plan: PlanResult, s: float, process: ProcessConfig, pad: PadConfig) -> float:
    """Share of the region, 0 to 1, under the pad's contact disc when the tool was fed up to arc length ``s`` [m]."""
    done = plan.path.s <= s + 1e-6
    if done[plan.path.process].all():
        return float(plan.figures["coverage"])
    if np.count_nonzero(done & plan.path.process) < 2:
        return 0.0
    ground = prepare_ground(plan.region, plan.plan)
    return pad_coverage(ground, plan.path.rows(done), process, pad, plan.access)


def load_mesh(part: PartConfig, observer: PlanObserver | None = None) -> PartMesh:
    """Load a part by its file or shipped name."""
    (observer or _Silent()).stage("read the part")
    return load_part(part_path(part.file), part.unit, part.up)


def _choose(mesh: PartMesh, plan: PlanConfig) -> tuple[Surface, Region]:
    surface = fit_surface(mesh, plan.feature_angle_rad)
    margins = plan.edge_margin_m, plan.hole_margin_m
    return surface, select_region(surface, mesh, plan.region, plan.feature_angle_rad, *margins)


# Planning by one call per pattern, for Python users: a region and a step-over in, arrays out.
#
# mesh = load_part("part.stl")
# surface = fit_surface(mesh)
# path = plan_spiral(select_region(surface, mesh), stepover=0.008)
# path.positions_work, path.axes_work      # (n, 3), metres, work frame

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
    """Cover a region with lines to and fro, joined by rounded turns; arguments and errors as of `plan_spiral`.

    The lines run ``along`` a direction (3,) of the work frame; empty = along the region's long axis.
    """
    asked = replace(plan or PlanConfig(), pattern="raster", stepover_m=stepover)
    return plan_path(region, replace(asked, raster_direction=_point(along), start=_point(start)))


def measure_path(
    path: ToolPath, region: Region, stepover: float, pad_radius: float = 0.025, contact_force: float = 20.0
) -> dict[str, Any]:
    """Measure how well a path covers a region, by turns a step-over [m] apart: figures as in metrics.json, SI.

    The pad of ``pad_radius`` [m] is pressed with ``contact_force`` [N] where the path has no force of its own.
    """
    ground = prepare_ground(region, PlanConfig(stepover_m=stepover))
    process, pad = ProcessConfig(contact_force_n=contact_force), PadConfig(radius_m=pad_radius)
    return measure_quality(ground, path, stepover, process, pad).figures


def _point(values: Point) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
