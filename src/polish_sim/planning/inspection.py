"""The quality of any path on a part, ours or not (ToolPath, part -> Inspection)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from polish_sim.arrays import Bools
from polish_sim.config import PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface, select_region
from polish_sim.planning.ground.ground import Ground, prepare_ground
from polish_sim.planning.part_plan import OFF_PART_M, PlanObserver, load_mesh
from polish_sim.planning.quality.coverage import strictly_covered
from polish_sim.planning.quality.figures import Quality, measure_quality, part_figures, without_spacing
from polish_sim.planning.quality.foreign_path import Offset, check_on_part, offset_from
from polish_sim.planning.quality.pad_fit import pad_in_part_warning
from polish_sim.planning.quality.spacing import guess_stepover
from polish_sim.planning.toolpath import ToolPath

NAMED = 3
"""So many of the places the pad cannot touch are named."""
MOSTLY = 0.9
"""A region is the path's own if this share of the path runs on it."""


@dataclass(frozen=True, eq=False)
class Inspection:
    """A path measured on a part."""

    mesh: PartMesh
    surface: Surface
    ground: Ground
    """The region the path is measured on, with its fine triangulation."""
    path: ToolPath
    plan: PlanConfig
    """Region and step-over it is measured by."""
    quality: Quality
    strict: Bools
    """Vertices of the region within 0.55 step-overs of the path, shape (v,)."""
    notes: tuple[str, ...]
    """What was assumed, and what the user should know."""

    @property
    def figures(self) -> dict[str, Any]:
        """The keys of metrics.json."""
        return self.quality.figures

    @property
    def region(self) -> Region:
        """The region the path is measured on."""
        return self.ground.region


def inspect_path(
    path: ToolPath,
    part: PartConfig,
    plan: PlanConfig | None = None,
    process: ProcessConfig | None = None,
    pad: PadConfig | None = None,
    observer: PlanObserver | None = None,
) -> Inspection:
    """Measure any path on a part: coverage, time under the pad, spacing, crossings, corners, places out of reach.

    Args:
        path: The path on the surface, work frame, not pressed in.
        part: File or shipped name, unit, side turned up.
        plan: Region and step-over to measure it by; None to find both from the path.
        process: Force and feed where the path has none of its own.
        pad: The pad.
        observer: Told of the progress.

    Returns:
        Figures and maps.

    Raises:
        PolishSimError: The part cannot be used, or the path does not lie on it; says by how much and what to do.
    """
    process, pad = process or ProcessConfig(), pad or PadConfig()
    notes: list[str] = []
    if plan is None:
        plan = replace(PlanConfig(), stepover_m=guessed_stepover(path, pad, notes))
    mesh = load_mesh(part, observer)
    surface = fit_surface(mesh, plan.feature_angle_rad)
    offset = offset_from(surface, path)
    check_on_part(offset, mesh, path, OFF_PART_M, 2.0 * pad.radius_m)
    region, plan = _region_of(path, surface, mesh, plan, offset, notes)
    if observer is not None:
        observer.stage("measure the path")
    ground = prepare_ground(region, plan)
    quality = measure_quality(ground, path, plan.stepover_m, process, pad, surface)
    if guess_stepover(path) is None:
        quality = without_spacing(quality, pad)
    quality.figures.update(
        part_figures(mesh, surface, region),
        stepover_expected_m=plan.stepover_m,
        height_above_part_min_m=float(offset.heights.min()),
        height_above_part_max_m=float(offset.heights.max()),
        beyond_part_max_m=float(offset.sideways.max()),
    )
    notes = [*mesh.notes, *region.notes, *notes, *_findings(quality, offset, pad)]
    strict = strictly_covered(ground.mesh.vertices, ground.mesh.normals, quality.runs, plan.stepover_m)
    return Inspection(mesh, surface, ground, path, plan, quality, strict, tuple(notes))


def guessed_stepover(path: ToolPath, pad: PadConfig, notes: list[str]) -> float:
    """The step-over a path seems to be made with [m]; appends a note that says so.

    Args:
        path: The path.
        pad: The pad; its diameter is taken where the path has no neighbouring turns.
        notes: Where the note goes.

    Returns:
        The step-over [m].
    """
    found = guess_stepover(path)
    if found is None:
        notes.append(
            f"no stretch of the path runs beside another: measured by a step-over of the pad's diameter, "
            f"{2e3 * pad.radius_m:.4g} mm (--stepover sets it)"
        )
        return 2.0 * pad.radius_m
    notes.append(
        f"step-over taken from the path: {1e3 * found:.4g} mm, the median distance of its turns (--stepover sets it)"
    )
    return found


def _region_of(
    path: ToolPath, surface: Surface, mesh: PartMesh, plan: PlanConfig, offset: Offset, notes: list[str]
) -> tuple[Region, PlanConfig]:
    """The region asked for; where that is automatic and the path runs elsewhere, the smooth face under the path."""

    def chosen(name: str) -> Region:
        return select_region(surface, mesh, name, plan.feature_angle_rad, plan.edge_margin_m)

    region = chosen(plan.region)
    share = _share_on(region, offset)
    if share >= MOSTLY:
        return region, plan
    if plan.region == "auto":
        for k in np.linspace(0, len(offset.feet) - 1, 7).astype(np.int64)[[3, 1, 5, 2, 4]]:
            name = "point:" + ",".join(f"{1e3 * value:.6g}" for value in offset.feet[k])
            region = chosen(name)
            if _share_on(region, offset) >= MOSTLY:
                notes.append(f"the path runs on another face than the largest that looks up: the one at {name[6:]} mm")
                return region, replace(plan, region=name)
    raise PlanError(
        f"only {100.0 * share:.0f}% of the path lies on the region '{plan.region}' of this part. Set --region to what "
        "the path covers: point:X,Y,Z of a face, 'top', 'all' or a box; and check --up."
    )


def _share_on(region: Region, offset: Offset) -> float:
    """Share of the path's feet on the part that belong to a region."""
    gap = np.linalg.norm(region.surface.closest(offset.feet).positions - offset.feet, axis=1)
    return float((gap < OFF_PART_M).mean())


def _findings(quality: Quality, offset: Offset, pad: PadConfig) -> list[str]:
    """What the user should look at, with places in mm."""
    notes = []
    warning = pad_in_part_warning(quality.figures)
    if warning:
        away = 1e3 * float(quality.pad_in_part.reaches.max())
        notes.append(f"{warning}: keep the path {away:.3g} mm further from what stands there, or take a smaller pad")
    if offset.sideways.max() > OFF_PART_M:
        notes.append(f"the path runs up to {1e3 * offset.sideways.max():.3g} mm beyond the part's edge")
    for place in quality.reach.places[:NAMED]:
        notes.append(
            f"out of the pad's reach: {1e6 * place.area_m2:.4g} mm^2 at {place_in_mm(place.position)}, hollow of "
            f"{1e3 * place.radius_m:.3g} mm radius, the pad has {1e3 * pad.radius_m:.3g} mm"
        )
    if len(quality.reach.places) > NAMED:
        notes.append(f"{len(quality.reach.places) - NAMED} smaller places are out of the pad's reach as well")
    if len(quality.crossings):
        first = ", ".join(place_in_mm(place) for place in quality.crossings[:NAMED])
        more = " ..." if len(quality.crossings) > NAMED else ""
        notes.append(f"crossings of the path with itself: {len(quality.crossings)}, at {first}{more}")
    return notes
