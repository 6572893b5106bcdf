"""From a part's file to a measured plan in one call: for the command line, for runs and from Python."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.spatial import cKDTree

from polish_sim.arrays import Array, Bools, norms
from polish_sim.config import LEAST_FORCE_N, PadConfig, PartConfig, PlanConfig, ProcessConfig
from polish_sim.errors import PlanError, check_name, number_text
from polish_sim.geometry import PartMesh, Region, Surface, fit_surface, load_part, select_region
from polish_sim.geometry.fit import Fixture, joined_meshes, joined_surfaces, load_fixture
from polish_sim.models import part_path
from polish_sim.planning.feasibility import (
    NARROWEST,
    check_asked,
    check_request,
    check_start,
    check_stepover,
    edge_distance,
    in_another_unit,
    lean_notes,
    start_notes,
    too_small,
    widest_piece,
    width_between_borders,
)
from polish_sim.planning.ground import Ground, prepare_ground
from polish_sim.planning.moves.stroke import Planned, Remaining, lift_over
from polish_sim.planning.moves.travel import AirSpace
from polish_sim.planning.planner import plan_on
from polish_sim.planning.quality.access import Access, find_access
from polish_sim.planning.quality.areas import MARGIN, NARROW, AreaAccount, AskedRegion, CutOut
from polish_sim.planning.quality.figures import Quality, measure_quality, part_figures
from polish_sim.planning.quality.tool_room import CHECKED_APART, Tool, pad_in_part_warning
from polish_sim.planning.toolpath import BEFORE, ToolPath

#: Of the pad's radius: a plan that resumes lands so far before the place, and with so much less force
LACKING = 0.5
IN_PART = "the tool would stand in the part"  #: Why a place is left out


class PlanObserver(Protocol):
    """Receives the progress of planning."""

    def stage(self, text: str) -> None:
        """Begin a new stage."""
        return

    def progress(self, done: float, total: float) -> None:
        """Progress of the present stage."""
        return


class _Silent(PlanObserver):
    """Says nothing."""


UNSEEN = _Silent()  #: Planning nobody looks on at
USUAL, USUAL_PAD = ProcessConfig(), PadConfig()

SLOWED, EASED, LEFT_OUT = "slowed", "eased", "left out"


class Mend(NamedTuple):
    """What was changed about a path, and why."""

    what: str  #: ``SLOWED``, ``EASED`` (less force) or ``LEFT_OUT``
    why: str
    share: float  #: Of the planned feed, or of the force [-]; 0 where it is left out
    length_m: float  #: Of the path
    places: Array  #: Points of the path [m], shape (n, 3)


def mend_of(what: str, why: str, share: float, path: ToolPath, rows: Bools) -> Mend:
    """What is changed about some rows of a path (n,)."""
    return Mend(what, why, share, path.length_along(rows), path.positions_work[rows])


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A finished plan."""

    mesh: PartMesh
    surface: Surface
    region: Region  #: All of the region asked for
    path: ToolPath
    figures: dict[str, Any]  #: The keys of metrics.json of a plan folder
    plan: PlanConfig
    notes: tuple[str, ...]  #: What was assumed, and what the user should know about the pad on this part
    ready: PreparedRegion  #: What it was planned on and is measured with
    area: AreaAccount  #: Where every cm^2 of the region asked for is
    cuts: tuple[CutOut, ...]  #: What was cut out of the path
    in_part: Array  #: Tool points at which the tool is in the part [m], shape (k, 3)
    tool: Tool  #: What it was planned for, or measured with
    mends: tuple[Mend, ...] = ()  #: What was changed after the path had been played in the cell
    proof: Mapping[str, Any] | None = None  #: What it was proven for, as path.json has it; None if it was not

    def along(self, path: ToolPath, mends: Sequence[Mend]) -> PlanResult:
        """The plan with another path on the same region; ``mends`` say where and why it is slower or
        shorter."""
        cuts = (
            *self.cuts,
            *(CutOut(mend.why, mend.places) for mend in mends if mend.what == LEFT_OUT),
        )
        quality = self.ready.measure(path, cuts)
        notes = (*(note for note in self.notes if note not in self.area.notes), *quality.area.notes)
        return replace(
            self,
            path=path,
            figures={**self.figures, **quality.figures},
            notes=notes,
            area=quality.area,
            cuts=cuts,
            in_part=quality.pad_in_part.positions,
            mends=(*self.mends, *mends),
        )

    def behind(self, s: float) -> PlanResult:
        """The plan from an arc length ``s`` [m] of its path on: within a stroke the tool lands a little
        before, and its force rises over a pad's diameter, from so much less as is pressed twice.

        Raises:
            PlanError: Nothing of the path in contact is left behind it.
        """
        path, pad = self.path, self.tool.pad.radius_m
        remaining = lift_over(path, path.process & (path.s < s - LACKING * pad), self.plan, self.ready.air)
        if remaining is None:
            raise PlanError(
                f"nothing of the path is left behind {number_text(1e3 * s)} mm, it ends at "
                f"{1e3 * path.s[path.process][-1]:.4g} mm (--from)."
            )
        left = remaining.path
        force = left.force_at(left.s, self.tool.force)
        first = left.process.argmax()
        twice = max(s - path.s[remaining.source[first]], 0.0)
        force *= 1.0 - np.interp(left.s - left.s[first], [0.0, 2.0 * pad], [twice / pad, 0.0])
        force = np.maximum(force, LEAST_FORCE_N)
        ready, done = self.ready, []
        if remaining.lost.any():  # before the tool has landed there is nothing done
            begin = ready.measure(path.rows(path.s <= s)).area
            ready = replace(ready, asked=ready.asked.after(self.area, begin, BEFORE))
            done = [mend_of(LEFT_OUT, BEFORE, 0.0, path, remaining.lost)]
        # Measured with its whole force: pressed with less, the pad yields less to what it was planned over.
        return replace(replace(self, ready=ready).along(left, done), path=replace(left, force=force))

    @property
    def standing(self) -> tuple[PartMesh, Surface]:
        """The part in its fixture as one body, as the arm meets it."""
        fixture = self.tool.fixture
        return joined_meshes(self.mesh, fixture), joined_surfaces(self.surface, fixture)


def plan_part(
    part: PartConfig,
    plan: PlanConfig,
    process: ProcessConfig = USUAL,
    pad: PadConfig = USUAL_PAD,
    observer: PlanObserver = UNSEEN,
) -> PlanResult:
    """Load a part, fit its surface, choose the region, plan the path and measure it.

    Raises:
        PolishSimError: The part or the request cannot be used; says why and what to do.
    """
    check_asked(part, plan, pad)
    begin = time.perf_counter()
    mesh = load_mesh(part, observer)
    fixture = load_fixture(part.fixture_file, mesh)
    return plan_mesh(mesh, plan, process, pad, observer, time.perf_counter() - begin, fixture)


def plan_mesh(
    mesh: PartMesh,
    plan: PlanConfig,
    process: ProcessConfig = USUAL,
    pad: PadConfig = USUAL_PAD,
    observer: PlanObserver = UNSEEN,
    spent_s: float = 0.0,
    fixture: Fixture | None = None,
) -> PlanResult:
    """As `plan_part`, on a mesh that is there already; spent_s: time its loading took, counted in plan_time_s
    [s]."""
    begin = time.perf_counter() - spent_s
    check_stepover(plan, pad)
    observer.stage("fit the surface")
    surface = fit_surface(mesh, plan.feature_angle_rad)
    region = choose_region(mesh, surface, plan)
    check_start(surface, plan)
    observer.stage("plan the path")
    ready = prepare_region(mesh, surface, region, plan, process, Tool(pad, process.contact_force_n, fixture))
    leaning = ready.access.leaning if ready.access else None
    try:
        planned = plan_on(
            ready.ground, ready.plan, lambda share: observer.progress(share, 1.0), ready.air, leaning
        )
    except PlanError as error:
        raise PlanError(" Note: ".join((str(error), *ready.notes))) from None
    planned_s = time.perf_counter() - begin
    observer.stage("measure the path")
    planned, quality = _clear_of_part(ready, planned)
    remarks = [*planned.notes, *start_notes(planned.path, ready.plan)]
    result = ready.result(planned.path, quality, remarks, planned.cuts)
    return replace(result, figures={
        **result.figures, "axis_deviation_max_rad": planned.axis_deviation_max_rad, "plan_time_s": planned_s,
    })  # fmt: skip


def _clear_of_part(ready: PreparedRegion, planned: Planned) -> tuple[Planned, Quality]:
    """A path as it is measured, without the places at which the tool would be in the part.

    Raises:
        PlanError: As `out_of_part`.
    """
    wider = 1.0
    while True:
        path = planned.path
        quality = ready.measure(path, planned.cuts)
        if not len(quality.pad_in_part.positions):
            return planned, quality
        remaining = out_of_part(ready, path, quality, wider)
        cut = CutOut(IN_PART, path.positions_work[remaining.lost])
        planned = planned._replace(path=remaining.path, cuts=(*planned.cuts, cut))
        wider *= 2.0


def out_of_part(ready: PreparedRegion, path: ToolPath, quality: Quality, wider: float) -> Remaining:
    """A path without what is near the places at which it was measured to have the tool in the part, each as
    wide as the tool is checked apart times ``wider``.

    Raises:
        PlanError: Nothing stays.
    """
    far, _ = cKDTree(quality.pad_in_part.positions).query(path.positions_work)
    gone = path.process & (far < wider * CHECKED_APART * ready.tool.pad.radius_m)
    remaining = lift_over(path, gone, ready.plan, ready.air)
    if remaining is None:
        raise PlanError(
            f"no path keeps clear of the part: {pad_in_part_warning(quality.figures)}. "
            "Set a smaller --pad-diameter or another --region."
        )
    return remaining


@dataclass(frozen=True, eq=False)
class PreparedRegion:
    """A region, what of it the tool reaches, and all that a path on it is planned and measured with."""

    mesh: PartMesh
    surface: Surface
    region: Region  #: All of the region asked for
    plan: PlanConfig
    process: ProcessConfig
    tool: Tool
    ground: Ground  #: What of it a path may run on
    asked: AskedRegion
    access: Access | None  #: What the tool reaches of it; None if all
    notes: tuple[str, ...] = ()  #: On what was chosen

    @property
    def part_notes(self) -> tuple[str, ...]:
        """On the part, its fixture and the region."""
        fixture = self.tool.fixture
        return (*self.mesh.notes, *(fixture.notes if fixture else ()), *self.region.notes)

    @property
    def air(self) -> AirSpace:
        """What the lifted tool keeps clear of."""
        tool, part = self.tool, self.surface
        obstacle = joined_surfaces(part, tool.fixture)
        return AirSpace(obstacle, self.plan.clearance_m, self.ground.region.up, tool, part)

    def measure(self, path: ToolPath, cuts: Sequence[CutOut] = ()) -> Quality:
        """Measure a path with ``cuts`` in it."""
        spacing, pad, fixture = self.plan.stepover_m, self.tool.pad, self.tool.fixture
        return measure_quality(self.asked, path, spacing, self.process, pad, self.surface, fixture, cuts)

    def result(
        self, path: ToolPath, quality: Quality, remarks: Sequence[str], cuts: tuple[CutOut, ...] = ()
    ) -> PlanResult:
        """The plan, with ``remarks`` on how the path was made or given among its notes."""
        figures = part_figures(self.mesh, self.surface, self.region.surface) | quality.figures
        notes = (
            *self.part_notes,
            *self.notes,
            *lean_notes(self.access, self.plan, self.tool.pad),
            *quality.area.notes,
            *remarks,
        )
        found = figures, self.plan, notes, self, quality.area, cuts, quality.pad_in_part.positions, self.tool
        return PlanResult(self.mesh, self.surface, self.region, path, *found)


PAD_CHOICES = ("auto", "stepover", "given")  #: What is chosen: pad and step-over, the pad, nothing
PAD_SIZES_M = (
    0.05,
    0.04,
    0.03,
    0.025,
    0.02,
    0.016,
    0.012,
    0.01,
    0.008,
    0.006,
    0.005,
    0.004,
    0.003,
    0.002,
)
"""Diameters a pad is chosen from."""
#: A pad is not chosen that the force presses in by more than this share of its radius
MOST_SUNK = 0.25


def prepare_region(
    mesh: PartMesh, surface: Surface, region: Region, plan: PlanConfig, process: ProcessConfig, tool: Tool
) -> PreparedRegion:
    """Prepare a region for the first of `_pads` that fits it.

    Raises:
        PlanError: None does; says why the first does not.
    """
    width, pad, refused = widest_piece(region), tool.pad, list[PlanError]()
    hanging_over: PreparedRegion | None = None
    for taken, asked in _pads(pad, plan, width, tool.force):
        if hanging_over is not None and 2.0 * taken.radius_m > width:
            continue
        kept = (
            ""
            if asked.edge_margin_m == plan.edge_margin_m
            else f", {1e3 * asked.edge_margin_m:.2g} mm off the edges"
        )
        if kept and tool.force > MOST_SUNK * taken.stiffness_n_m * taken.radius_m:
            refused.append(too_small(mesh, width, taken, tool.force))
            continue
        try:
            within = choose_region(mesh, surface, asked) if kept else region
            wide, fitted = check_request(within, taken, mesh), tool._replace(pad=taken)
            found = accessible(region, wide, surface, asked, fitted, MARGIN if kept else NARROW)
        except PlanError as error:
            refused.append(too_small(mesh, width, taken, tool.force) if kept else error)
            continue
        # A measurement takes all of the region, as the account of the plan does.
        asked = replace(asked, edge_margin_m=plan.edge_margin_m)
        between = width_between_borders(found[1].ground) if is_free(taken) else width
        if between < 2.0 * NARROWEST * taken.radius_m:
            hanging_over = PreparedRegion(mesh, surface, region, asked, process, fitted, *found)
            width = min(width, between)
            continue
        note = (
            f"pad of {2e3 * taken.radius_m:.3g} mm and step-over {1e3 * asked.stepover_m:.3g} mm{kept} "
            f"chosen: the default pad of {2e3 * pad.radius_m:.3g} mm does not fit the region, "
            f"{1e3 * width:.3g} mm wide "
            f"(--pad-diameter).{in_another_unit(mesh, widest_piece(region), pad.radius_m)}"
        )
        notes = () if taken is pad else (note,)
        return PreparedRegion(mesh, surface, region, asked, process, fitted, *found, notes)
    if hanging_over is not None:
        return hanging_over
    raise refused[0]


def is_free(pad: PadConfig) -> bool:
    """Whether a pad may be replaced by a smaller one: nothing named it (``choice``), and it is the default
    one."""
    return pad.choice != "given" and pad.radius_m == USUAL_PAD.radius_m


def _pads(
    pad: PadConfig, plan: PlanConfig, width: float, force: float
) -> Iterator[tuple[PadConfig, PlanConfig]]:
    """The pads to try on a region this wide [m], each with its plan; several only if the default pad was not
    asked for.

    The default pad is left out where it is wider than the region and a smaller one is not; then come the
    sizes from the list that are no wider, with the default step-over in proportion, and as far off the edges
    as ``force`` [N] asks.
    """
    check_name("choice of the pad", pad.choice, PAD_CHOICES)
    diameter = 2.0 * pad.radius_m
    smaller = [size for size in PAD_SIZES_M if size < diameter and size <= width] if is_free(pad) else []
    if diameter <= width or not smaller:
        yield pad, plan
    for size in smaller:
        small, asked = with_pad(pad, plan, size)
        margin = edge_distance(small, force) + plan.tool_clearance_m - 0.5 * asked.stepover_m
        yield small, replace(asked, edge_margin_m=max(plan.edge_margin_m, margin), overrun_m=0.0)


def with_pad(pad: PadConfig, plan: PlanConfig, size: float) -> tuple[PadConfig, PlanConfig]:
    """The default pad in another size [m], and a plan for it: its step-over in proportion, as an overlap
    asks, unless that was chosen."""
    wanted = plan.stepover_m
    if pad.choice == "auto":
        wanted = wanted * size / (2.0 * pad.radius_m)
    return replace(pad, radius_m=0.5 * size), replace(plan, stepover_m=min(wanted, size))


ON_SURFACE_M = 1e-6  #: Places this close to a surface are on it [m]


def accessible(
    region: Region, wide: Region, part: Surface, plan: PlanConfig, tool: Tool, reason: str
) -> tuple[Ground, AskedRegion, Access | None]:
    """The ground that the tool reaches of what is ``wide`` enough of a region, all of it, and its access.

    ``reason`` names why the rest of it is left out. The access is None where the tool reaches all.

    Raises:
        PlanError: The tool reaches no place, or the step-over does not fit.
    """
    whole = prepare_ground(region, plan)
    access = find_access(whole, wide, part, tool, plan)
    if access and plan.overrun_m > 0.0:
        # Something stands beside the region: there the tool must not go further out.
        return accessible(region, wide, part, replace(plan, overrun_m=0.0), tool, reason)
    asked, within = (access.asked, access.region) if access else (AskedRegion(whole), wide)
    if wide is not region:
        places = whole.mesh.vertices
        off = norms(wide.surface.closest(places).positions - places) > ON_SURFACE_M
        asked = asked.without(off, reason)
    return whole if within is region else prepare_ground(within, plan), asked, access


def given_region(
    mesh: PartMesh,
    surface: Surface,
    region: Region,
    plan: PlanConfig,
    process: ProcessConfig,
    pad: PadConfig,
    fixture_file: str,
) -> PreparedRegion:
    """A region to measure a path on that was made before: the tool may reach none of it, the path says."""
    tool = Tool(pad, process.contact_force_n, load_fixture(fixture_file, mesh))
    try:
        found = accessible(region, region, surface, plan, tool, NARROW)
    except PlanError:
        ground = prepare_ground(region, plan)
        found = ground, AskedRegion(ground), None
    return PreparedRegion(mesh, surface, region, plan, process, tool, *found)


def load_mesh(part: PartConfig, observer: PlanObserver = UNSEEN) -> PartMesh:
    """Load a part by its file or shipped name."""
    observer.stage("read the part")
    return load_part(part_path(part.file), part.unit, part.up)


def choose_region(mesh: PartMesh, surface: Surface, plan: PlanConfig) -> Region:
    """The region a plan asks for."""
    margins = plan.edge_margin_m, plan.hole_margin_m
    return select_region(surface, mesh, plan.region, plan.feature_angle_rad, *margins)


def measure_path(
    path: ToolPath, region: Region, stepover: float, pad_radius: float = 0.025, contact_force: float = 20.0
) -> dict[str, Any]:
    """Measure how well a path covers a region, by turns a step-over [m] apart: figures as in metrics.json,
    SI.

    The pad of ``pad_radius`` [m] is pressed with ``contact_force`` [N] where the path has no force of its
    own.
    """
    ground = prepare_ground(region, PlanConfig(stepover_m=stepover))
    process, pad = ProcessConfig(contact_force_n=contact_force), PadConfig(radius_m=pad_radius)
    return measure_quality(AskedRegion(ground), path, stepover, process, pad).figures
