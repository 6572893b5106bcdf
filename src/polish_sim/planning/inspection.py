"""The quality of any path on a part, ours or not, if it lies on it at all (ToolPath, part -> Inspection)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from polish_sim.arrays import Array, Bools, dots, into_plane, longest_side, norms
from polish_sim.config import PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.errors import PlanError, place_in_mm
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface
from polish_sim.geometry.surface import join_surfaces
from polish_sim.planning.feasibility import lean_notes
from polish_sim.planning.ground import SHARPEST, Ground, bridge_holes, with_skirt
from polish_sim.planning.moves.leads import with_way_down
from polish_sim.planning.part_plan import (
    UNSEEN,
    USUAL,
    USUAL_PAD,
    PlanObserver,
    PlanResult,
    choose_region,
    given_region,
    load_mesh,
)
from polish_sim.planning.quality.areas import CutOut
from polish_sim.planning.quality.coverage import strictly_covered
from polish_sim.planning.quality.figures import Quality, part_figures
from polish_sim.planning.quality.located import with_points_between
from polish_sim.planning.quality.spacing import guess_stepover
from polish_sim.planning.quality.tool_room import pad_in_part_warning
from polish_sim.planning.toolpath import ToolPath

OFF_PART_M = 1e-3  #: A path made before may lie this far off the fitted surface [m]
BESIDE_M = 1e-4  #: So near the foot of a point, along each axis, a face meets it [m]
SQUARE = 1e-3  #: A tool axis with less than this along a face's outward normal does not look out of it [-]
LEANING_DEG = 10.0  #: Lean of the tool off the surface's normal above which a note is given
UNITS = (1000.0, 25.4, 10.0)  #: m, inch and cm over mm
EVEN = 0.2  #: A path is pressed in if its depth stays within this share of the median ...
MOSTLY_EVEN = 0.6  #: ... along this share of it
SLACK, LEAST_SHARE = 0.1, 0.3
"""In the right unit a path runs at most this share of the part's size beyond it, and measures at least that
share."""


class Offset(NamedTuple):
    """How the points in contact lie to the part."""

    feet: Array  #: Closest points of the part [m], shape (n, 3)
    heights: Array  #: Along the tool axis [m], positive outside, shape (n,)
    #: Across it [m], shape (n,): beyond the part's edge the pad hangs over, which is no error
    sideways: Array
    turned: Array  #: Points of the path whose tool axis points into the part [m], shape (k, 3)


def offset_from(surface: Surface, path: ToolPath, bridges: Sequence[Surface]) -> Offset:
    """Measure how far the path in contact lies off a part.

    ``bridges`` are surfaces over holes the pad runs over, which count as the part.
    """
    path = with_points_between(path)
    points, axes = path.in_contact
    whole = join_surfaces([surface, *bridges])
    feet, normals, *_ = whole.closest(points)
    gap = points - feet
    heights = dots(gap, axes)
    turned = np.flatnonzero(dots(axes, normals) <= 0.0)
    # On an edge the closest face may be the other one: the axis is turned if no face around looks its way.
    for way in product((-BESIDE_M, 0.0, BESIDE_M), repeat=3):
        around = whole.closest(feet[turned] + way).normals
        turned = turned[dots(axes[turned], around) < SQUARE]
    return Offset(feet, heights, norms(into_plane(gap, axes)), points[turned])


def check_on_part(offset: Offset, mesh: PartMesh, path: ToolPath, sideways: float) -> None:
    """Refuse a path that does not belong on a part.

    It may be off the surface by `OFF_PART_M` along the tool axis, and run beyond the part's edge by
    ``sideways`` [m].

    Raises:
        PlanError: It is further off; says by how much, and the likely reason.
    """
    if len(offset.heights) == 0:
        raise PlanError(
            "the path has no points in contact. Mark points as 'process', or give x, y, z, i, j, k."
        )
    if np.abs(offset.heights).max() <= OFF_PART_M and offset.sideways.max() <= sideways:
        if len(offset.turned):
            todo = _other_unit(mesh, path) or (
                "Turn the axes round there (-i, -j, -k), unless the path is on the wrong side of the part: "
                "its frame is that of the part's file."
            )
            raise PlanError(
                f"the tool axis points into '{mesh.name}' along "
                f"{100.0 * len(offset.turned) / len(offset.feet):.3g}% of the path, first at "
                f"{place_in_mm(offset.turned[0])}, wanted: from the part to the tool, as CLDATA. {todo}"
            )
        return
    middle = np.median(offset.heights)
    reason = _reason(mesh, path, offset.heights, middle)
    if np.abs(offset.heights[offset.sideways <= sideways]).max(initial=0.0) <= OFF_PART_M:
        reason = (
            f"It is so only beyond the part's edge or over a hole, by more than {1e3 * sideways:.3g} mm: a "
            "table of a plan with --overrun needs its plan.overrun_m (--set), any other the part's own frame."
        )
    raise PlanError(
        f"the path does not lie on '{mesh.name}': along the tool axis it is "
        f"{1e3 * offset.heights.min():+.2f} to {1e3 * offset.heights.max():+.2f} mm off the surface (median "
        f"{1e3 * middle:+.2f} mm, allowed {1e3 * OFF_PART_M:g} mm), sideways up to "
        f"{1e3 * offset.sideways.max():.1f} mm. {_other_unit(mesh, path) or reason}"
    )


def _other_unit(mesh: PartMesh, path: ToolPath) -> str:
    """Advice if the path would fit the part in place and size in another unit; else empty."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = path.in_contact.positions
    size = (high - low).max()
    for factor in UNITS:
        for scale, larger, smaller in ((factor, "part", "path"), (1.0 / factor, "path", "part")):
            scaled = scale * points
            beyond = max((low - scaled).max(), (scaled - high).max())
            if beyond < SLACK * size and longest_side(scaled) > LEAST_SHARE * size:
                return (
                    f"The {larger} is about {factor:g} times as large as the {smaller}: another unit? "
                    "Give it in mm, or set --units."
                )
    return ""


def _reason(mesh: PartMesh, path: ToolPath, heights: Array, middle: float) -> str:
    if (np.abs(heights - middle) < EVEN * abs(middle)).mean() > MOSTLY_EVEN:
        side = "pressed in already" if middle < 0.0 else "lifted off"
        return (
            f"It is {side} by {1e3 * abs(middle):.2f} mm along most of it: give the path on the surface "
            "itself."
        )
    sizes = np.ptp(path.in_contact.positions, axis=0), np.ptp(mesh.vertices, axis=0)
    own, part = (" x ".join(f"{1e3 * value:.0f}" for value in size) for size in sizes)
    return f"It measures {own} mm, the part {part} mm: made on another part, or in another frame?"


AS_FOUND = PlanConfig(stepover_m=np.nan)  #: Its step-over is that of the path
MOSTLY = 0.9  #: A region is the path's own if this share of the path runs on it


@dataclass(frozen=True, eq=False)
class Inspection:
    """A path measured on a part."""

    mesh: PartMesh
    surface: Surface
    ground: Ground  #: The region the path is measured on, with its fine triangulation
    path: ToolPath
    plan: PlanConfig  #: Region and step-over it is measured by
    quality: Quality
    strict: Bools  #: Vertices of the region within 0.55 step-overs of the path, shape (v,)
    notes: tuple[str, ...]  #: What was assumed, and what the user should know

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
    plan: PlanConfig = AS_FOUND,
    process: ProcessConfig = USUAL,
    pad: PadConfig = USUAL_PAD,
    observer: PlanObserver = UNSEEN,
    cuts: tuple[CutOut, ...] = (),
) -> Inspection:
    """Measure any path on a part: coverage, time under the pad, spacing, crossings, corners, places out of
    reach.

    The path is on the surface, in the work frame, not pressed in. Region and step-over are found from it
    without a ``plan``, the step-over also where that has nan; force and feed of ``process`` count where it
    has none of its own. ``cuts`` are what was left out of it when it was planned.

    Raises:
        PolishSimError: The part cannot be used, or the path does not lie on it; says by how much and what to
            do.
    """
    notes = list[str]()
    if np.isnan(plan.stepover_m):
        found = guess_stepover(path)
        plan = replace(plan, stepover_m=found or 2.0 * pad.radius_m)
        notes.append(
            f"step-over taken from the path: {1e3 * plan.stepover_m:.4g} mm, the median distance of its "
            "turns (--stepover sets it)"
            if found
            else "no stretch of the path runs beside another: measured by a step-over of the pad's diameter, "
            f"{1e3 * plan.stepover_m:.4g} mm (--stepover sets it)"
        )
    mesh = load_mesh(part, observer)
    surface = fit_surface(mesh, plan.feature_angle_rad)
    region = choose_region(mesh, surface, plan)
    beyond = max(2.0 * pad.radius_m, plan.overrun_m / SHARPEST)
    offset = offset_from(surface, path, _bridges(region, plan))
    if np.abs(offset.heights).max(initial=0.0) > OFF_PART_M:
        # Beyond the edge it may keep to the tangent, as --overrun does; a bare table does not say how far.
        ahead = offset_from(surface, path, _bridges(region, plan, beyond))
        offset = offset._replace(heights=ahead.heights)
    check_on_part(offset, mesh, path, beyond)
    region, plan = _region_of(region, surface, mesh, plan, offset, notes)
    observer.stage("measure the path")
    given = given_region(mesh, surface, region, plan, process, pad, part.fixture_file)
    quality = given.measure(path, cuts)
    ground = given.asked.ground
    notes += [*lean_notes(given.access, plan, pad), *quality.area.notes, *tool_notes(quality)]
    if offset.sideways.max() > OFF_PART_M:
        notes.append(f"the path runs up to {1e3 * offset.sideways.max():.3g} mm beyond the part's edge")
    if len(quality.crossings):
        notes.append(
            f"crossings of the path with itself: {len(quality.crossings)}, the first at "
            f"{place_in_mm(quality.crossings[0])}"
        )
    quality.figures.update(
        part_figures(mesh, surface, region.surface),
        height_above_part_min_m=offset.heights.min(),
        height_above_part_max_m=offset.heights.max(),
        beyond_part_max_m=offset.sideways.max(),
    )
    strict = strictly_covered(ground.mesh.vertices, ground.mesh.normals, quality.runs, plan.stepover_m)
    return Inspection(mesh, surface, ground, path, plan, quality, strict, (*given.part_notes, *notes))


def measure_given_path(
    path: ToolPath,
    part: PartConfig,
    plan: PlanConfig,
    process: ProcessConfig = USUAL,
    pad: PadConfig = USUAL_PAD,
    observer: PlanObserver = UNSEEN,
    cuts: tuple[CutOut, ...] = (),
) -> PlanResult:
    """Load a part and measure a path in the work frame that was made before on it, by the plan's region and
    step-over, to run it.

    ``cuts`` are what was cut out of it then.

    Raises:
        PolishSimError: As of `inspect_path`; the path may not run beyond the part's edge.
    """
    mesh = load_mesh(part, observer)
    observer.stage("fit the surface")
    surface = fit_surface(mesh, plan.feature_angle_rad)
    region = choose_region(mesh, surface, plan)
    observer.stage("measure the path")
    given = given_region(mesh, surface, region, plan, process, pad, part.fixture_file)
    # Over holes that the pad runs over it is off the part, at the border of what is left out off the region.
    check_on_part(offset_from(surface, path, [given.asked.ground.region.surface]), mesh, path, OFF_PART_M)
    quality = given.measure(path, cuts)
    return given.result(with_way_down(path, plan.clearance_m), quality, tool_notes(quality), cuts)


def _bridges(region: Region, plan: PlanConfig, beyond: float = 0.0) -> list[Surface]:
    """The pieces of a region with small holes, these closed as the pad runs over them.

    With ``beyond`` [m] it is all pieces, continued so far past their borders.
    """
    bridged = (bridge_holes(piece, plan.bridge_m) for piece in region.components())
    return [with_skirt(piece, beyond).surface for piece, holes in bridged if holes or beyond]


def _region_of(
    region: Region, surface: Surface, mesh: PartMesh, plan: PlanConfig, offset: Offset, notes: list[str]
) -> tuple[Region, PlanConfig]:
    """The region asked for; where that is automatic and the path runs elsewhere, the smooth face under the
    path."""
    share = _share_on(region, plan, offset)
    if share >= MOSTLY:
        return region, plan
    if plan.region == "auto":
        for k in np.linspace(0, len(offset.feet) - 1, 7).astype(np.int64)[[3, 1, 5, 2, 4]]:
            name = "point:" + ",".join(f"{1e3 * value:.6g}" for value in offset.feet[k])
            there = replace(plan, region=name)
            region = choose_region(mesh, surface, there)
            if _share_on(region, there, offset) >= MOSTLY:
                notes.append(
                    f"the path runs on another face than the largest that looks up: the one at {name[6:]} mm"
                )
                return region, there
    raise PlanError(
        f"only {100.0 * share:.0f}% of the path lies on the region '{plan.region}' of this part. Set "
        "--region to what the path covers: point:X,Y,Z of a face, 'top', 'all' or a box; and check --up."
    )


def _share_on(region: Region, plan: PlanConfig, offset: Offset) -> float:
    """Share of the path's feet on the part that belong to a region, its closed holes and overrun included.

    Points beyond the part's edge do not count, unless all are.
    """
    feet = offset.feet[offset.sideways <= max(OFF_PART_M, offset.sideways.min())]
    there = join_surfaces([region.surface, *_bridges(region, plan)]).closest(feet).positions
    return (norms(there - feet) < OFF_PART_M + plan.overrun_m / SHARPEST).mean()


def tool_notes(quality: Quality) -> list[str]:
    """Where the tool runs into the part along a path, and what to do; how far it leans off the surface's
    normal."""
    notes, lean = list[str](), np.degrees(quality.figures["max_axis_lean_rad"])
    warning = pad_in_part_warning(quality.figures)
    if warning:
        away = 1e3 * quality.pad_in_part.reaches.max()
        notes.append(
            f"{warning}: keep the path {away:.3g} mm further from what stands there, plan it anew with this "
            "pad, or take a smaller --pad-diameter"
        )
    if LEANING_DEG < lean < 90.0:  # more is of another face than the region's
        notes.append(
            f"the tool leans up to {lean:.0f} deg off the surface's normal: there only a part of the pad's "
            "face touches"
        )
    return notes
