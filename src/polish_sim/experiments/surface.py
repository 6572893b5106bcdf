"""Experiments on a part: ``surface`` polishes it along a planned path under force control (paper 1, fig. 14,
15), ``force`` presses on one point and measures the step of the contact force (fig. 13)."""

from __future__ import annotations

import math

import numpy as np

from polish_sim.analysis.metrics import (
    faults_of_force,
    faults_of_plan,
    measure_force,
    measure_removal,
    measure_surface,
)
from polish_sim.arrays import Array, Figures
from polish_sim.cell import SILENT, Cell, CellRun, Observer
from polish_sim.cell.removal import PadMotion, Removed, expose_nodes, pad_motion, place_nodes
from polish_sim.config import Checked
from polish_sim.errors import PlanError
from polish_sim.experiments.assembly import Workplace, build_cell, kept_place
from polish_sim.experiments.beliefs import FIGURE
from polish_sim.experiments.even_removal import planned
from polish_sim.experiments.part_pose import PartPlacing
from polish_sim.experiments.part_setup import (
    check_set_points,
    path_done,
    real_shape,
    shape_figures,
    touched,
)
from polish_sim.experiments.registry import experiment
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.experiments.stroke_motion import feed_figures
from polish_sim.geometry import Region, fit_surface, select_region
from polish_sim.log import RemovalMap, RunLog, with_column
from polish_sim.planning import PlanResult
from polish_sim.planning.part_plan import load_mesh
from polish_sim.planning.quality.areas import UNTOUCHED, area_figures
from polish_sim.planning.quality.tool_room import pad_in_part_warning
from polish_sim.planning.toolpath import APPROACH, PROCESS, ToolPath

# What a run of ``surface`` or ``dual`` took off the part, by Preston's law.


def remove_material(
    place: Workplace, cell: Cell, run: CellRun, part_turns: Array | None = None
) -> tuple[RemovalMap, RunLog]:
    """Sum Preston's law up over a finished run of a cell; the loop is not slowed down by it. Returns the
    removal over the region, and the run's log with the running exposure of the whole part.

    ``part_turns`` (n, 3, 3) is how a part that is carried stands in the base at the log's rows.
    """
    scenario, part, pad = cell.scenario, cell.part, cell.scenario.pad
    nodes = place_nodes(
        place.surface, place.region, part, touched(place.shape, place.path, pad.radius_m, part.field.band)
    )
    motion = pad_motion(run.log, run.trace, part, pad.radius_m, part_turns)
    removed = expose_nodes(
        nodes.pressed, motion, pad.radius_m, pad.stiffness_n_m * scenario.head.spring_scale,
        pad.slide_m_s, part.field.band,
    )  # fmt: skip
    own = len(nodes.mesh.vertices)
    pressed = motion.impulses.sum()
    removal = RemovalMap(
        vertices=nodes.mesh.vertices,
        normals=nodes.mesh.normals,
        triangles=nodes.mesh.triangles,
        areas=nodes.pressed.areas[:own],
        exposure=removed.exposure[:own],
        up=place.region.up,
        preston_1_pa=scenario.process.preston_1_pa,
        elsewhere_nm=float(nodes.pressed.areas[own:] @ removed.exposure[own:]),
        unplaced_share=motion.impulses[removed.carried <= 0.0].sum() / pressed if pressed > 0.0 else math.nan,
        field_ratio=(removed.carried @ motion.times) / pressed if pressed > 0.0 else math.nan,
    )
    return removal, with_column(run.log, "exposure_nm", _running(run.log, motion, removed))


def _running(log: RunLog, motion: PadMotion, removed: Removed) -> Array:
    """Exposure summed over the part up to each row of the log [N m], shape (n,)."""
    rows = log["time_s"]
    if not len(motion.times):
        return np.zeros(len(rows))
    # Between steps in contact nothing is gained.
    moments = np.stack([motion.ends_s - motion.times, motion.ends_s], axis=1).ravel()
    total = np.cumsum(removed.gained)
    return np.interp(rows, moments, np.stack([total - removed.gained, total], axis=1).ravel())


def prepare_surface(scenario: Checked, plan: PlanResult, observer: Observer = SILENT) -> Workplace:
    """Place the part of a plan and check that the arm can do all of its path, before anything moves.

    See `planned` for plans. The last few places are kept: the next run of the same plan has it at once.

    Raises:
        PlanError: The tool runs into the part, unless ``safety.tool_in_part`` allows it; says where and how
            deep.
        PolishSimError: The part cannot be used or reached.
    """

    def make() -> Workplace:
        check_set_points(plan.path)
        warning = pad_in_part_warning(plan.figures)
        if warning and scenario.safety.tool_in_part == "refuse":
            raise PlanError(
                f"{warning}. Plan the path on this part with this pad, which leaves out what it does not "
                "reach, take a smaller --pad-diameter, or run it all the same with --allow-contact."
            )
        observer.stage("check the reach")
        standing = *plan.standing, plan.path
        reach = PartPlacing(scenario, *standing).reach()
        shape = real_shape(scenario.part, scenario.plan.feature_angle_rad, *standing)
        return Workplace(plan.mesh, plan.surface, plan.region, plan.path, reach, shape, plan.tool.fixture)

    return kept_place(scenario, make, plan)


def run_surface(scenario: Checked, plan: PlanResult, observer: Observer = SILENT) -> RunResult:
    """Polish a part along a plan and measure how well the force was held; arguments as of `planned`, errors
    of `prepare_surface`."""
    place = prepare_surface(scenario, plan, observer)
    observer.stage("prepare the cell")
    cell = build_cell(scenario, place)
    observer.stage("simulate")
    return measure_run(plan, place, cell, cell.run(observer))


def measure_run(plan: PlanResult, place: Workplace, cell: Cell, run: CellRun) -> RunResult:
    """How well a ``run`` of a ``cell`` has polished the part of a plan."""
    path = plan.path
    scenario = cell.scenario
    fed = run.trace.path_s_m[run.trace.fed]
    figures: Figures = dict(measure_surface(run.trace, path, scenario.process.contact_force_n))
    removal, log = remove_material(place, cell, run)
    figures |= measure_removal(removal, scenario.pad.radius_m)
    figures |= areas_after(plan, removal)
    figures |= common_figures(cell, run, path_done(path, fed), place.reach.T_base_work)
    figures |= shape_figures(place.shape, path)
    figures |= feed_figures(cell.strokes)
    figures[FIGURE] = cell.lesson.runs
    figures["fit_unsure_m"] = plan.figures["fit_unsure_m"]
    most = path.largest_force(scenario.process.contact_force_n)
    figures["bad_figures"] = [*faults_of_force(figures, most), *faults_of_plan(figures)]
    return RunResult(
        scenario, log, run.trace, figures, path, removal,
        run.files,
    )  # fmt: skip


def areas_after(plan: PlanResult, removal: RemovalMap) -> Figures:
    """Where every cm^2 of a plan's region is after it was run: touched by the pad, or left out for the plan's
    reason or one of the run's."""
    asked, area = plan.ready.asked, plan.area
    nearest = asked.ground.mesh.tree.query(removal.vertices)[1]
    why = np.where(asked.why >= 0, asked.why, area.why)[nearest]
    areas = removal.areas * (area.region_m2 / removal.areas.sum())
    bare = removal.exposure <= 0.0
    lost: dict[str, float] = {}
    for number in np.unique(why[bare]):
        reason = (*area.reasons, UNTOUCHED)[number]
        lost[reason] = lost.get(reason, 0.0) + float(areas[bare & (why == number)].sum())
    return area_figures(area.region_m2, float(areas[~bare].sum()), lost)


def place_work(scenario: Checked) -> Workplace:
    """The place of a run of ``force``, or of one of ``surface`` along the path planned for it."""
    if experiment(scenario.experiment).holds:
        return place_force(scenario)
    scenario, plan = planned(scenario)
    assert plan  # ``surface`` plans one
    return prepare_surface(scenario, plan)


START_HEIGHT = 0.01  # of the tool above the part [m]


def touch_path(region: Region) -> ToolPath:
    """Straight down onto the middle of a region: one point to press on."""
    areas = region.surface.facet_areas
    centroids = region.surface.vertices[region.surface.faces].mean(axis=1)
    middle = (areas @ centroids) / areas.sum()
    touch = region.surface.closest(middle[None])
    point, axis = touch.positions[0], touch.normals[0]
    return ToolPath(
        np.stack([point + START_HEIGHT * axis, point]),
        np.stack([axis, axis]),
        np.array([0.0, START_HEIGHT]),
        np.zeros(2, np.int64),
        np.array([APPROACH, PROCESS], np.int8),
        np.zeros(2),
    )


def place_force(scenario: Checked, observer: Observer = SILENT) -> Workplace:
    """Load the part, choose the point to press on and check the reach; the path is one point with the way
    down to it.

    The last few places are kept: the next run on the same point has it at once.

    Raises:
        PolishSimError: If the part cannot be used or the point not reached.
    """

    def make() -> Workplace:
        observer.stage("fit the surface")
        mesh = load_mesh(scenario.part)
        angle = scenario.plan.feature_angle_rad
        surface = fit_surface(mesh, angle)
        region = select_region(surface, mesh, scenario.plan.region, angle)
        path = touch_path(region)
        standing = mesh, surface, path
        reach = PartPlacing(scenario, *standing).reach()
        shape = real_shape(scenario.part, angle, *standing)
        return Workplace(mesh, surface, region, path, reach, shape, holds=True)

    return kept_place(scenario, make)


def prepare_force(scenario: Checked, observer: Observer = SILENT) -> tuple[Workplace, Cell]:
    """Load the part, choose the point, check the reach and set the cell up, not yet run; raises as
    `place_force`."""
    place = place_force(scenario, observer)
    observer.stage("prepare the cell")
    return place, build_cell(scenario, place)


def check_force_point(scenario: Checked, observer: Observer = SILENT) -> Workplace:
    """The point to press on and how the arm reaches it, the cell set up but not run; raises as
    `place_force`."""
    return prepare_force(scenario, observer)[0]


def run_force(scenario: Checked, observer: Observer = SILENT) -> RunResult:
    """Press on one point, hold, and measure the step response from first contact; raises as `place_force`.

    The path's pattern and feed play no role. The default leaves the spindle off.
    """
    place, cell = prepare_force(scenario, observer)
    observer.stage("simulate")
    return measure_hold(place, cell, cell.run(observer))


def measure_hold(place: Workplace, cell: Cell, run: CellRun) -> RunResult:
    """How well a ``run`` of a ``cell`` has pressed on its point."""
    scenario = cell.scenario
    figures: Figures = dict(measure_force(run.trace, scenario.process.contact_force_n))
    figures |= common_figures(cell, run, hold_done(scenario.process.hold_s, run), place.reach.T_base_work)
    return RunResult(
        scenario, run.log, run.trace, figures, place.path, None,
        run.files,
    )  # fmt: skip


def hold_done(hold_s: float, run: CellRun) -> float:
    """Share of the time on the point that was held, 0 to 1."""
    return min(1.0, np.sum(run.trace.fed) / round(hold_s / run.dt))
