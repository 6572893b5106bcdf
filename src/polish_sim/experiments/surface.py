"""Experiment ``surface``: polish a part along a planned path under force control (paper 1, fig. 14, 15; layer 9)."""

from __future__ import annotations

from typing import Any, NamedTuple

from polish_sim.analysis.metrics import measure_surface
from polish_sim.analysis.removal_figures import measure_removal
from polish_sim.cell import Observer, Silent
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.experiments.assembly import Workplace, build_cell, build_part
from polish_sim.experiments.part_setup import check_set_points, path_done, reach_path
from polish_sim.experiments.placement import Reach
from polish_sim.experiments.real_shape import RealShape, real_shape, shape_figures
from polish_sim.experiments.removal import remove_material
from polish_sim.experiments.result import RunResult, common_figures
from polish_sim.experiments.stroke_motion import check_stroke_rule
from polish_sim.experiments.time_law import feed_of_jobs
from polish_sim.planning import PlanResult, coverage_until, plan_part


class SurfaceTask(NamedTuple):
    """A part, the path on it and the way the arm does it, all checked before anything moves."""

    plan: PlanResult
    reach: Reach
    shape: RealShape

    @property
    def place(self) -> Workplace:
        """Part, path and reach, as the cell is set up from them."""
        plan = self.plan
        return Workplace(plan.mesh, plan.surface, plan.region, plan.path, self.reach, self.shape)


def prepare_surface(
    scenario: Scenario, plan: PlanResult | None = None, observer: Observer | None = None
) -> SurfaceTask:
    """Plan the part's path (unless that is done) and check that the arm can do all of it.

    Args:
        scenario: The scenario.
        plan: A plan made before, see ``plan_part`` and ``measure_given_path``.
        observer: Told of the progress.

    Returns:
        The task.

    Raises:
        PolishSimError: If the part cannot be used, planned or reached.
    """
    observer = observer or Silent()
    build_controller(scenario.controller)
    check_stroke_rule(scenario)
    if plan is None:
        plan = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
    check_set_points(plan.path)
    observer.stage("check the reach")
    reach = reach_path(scenario, plan.mesh, plan.path)
    return SurfaceTask(plan, reach, real_shape(scenario, plan.mesh, plan.surface, plan.path))


def run_surface(scenario: Scenario, plan: PlanResult | None = None, observer: Observer | None = None) -> RunResult:
    """Polish a part and measure how well the force was held.

    Args:
        scenario: The scenario.
        plan: A plan made before, see ``plan_part`` and ``measure_given_path``.
        observer: Told of the progress.

    Returns:
        Log, trace, path and figures.

    Raises:
        PolishSimError: If the part cannot be used, planned or reached.
    """
    observer = observer or Silent()
    task = prepare_surface(scenario, plan, observer)
    plan, reach, place = task.plan, task.reach, task.place
    path = plan.path
    observer.stage("prepare the cell")
    part = build_part(scenario, place)
    cell = build_cell(scenario, place, part, hold=0.0, lift=scenario.plan.clearance_m)
    observer.stage("simulate")
    run = cell.run(observer)
    fed = run.trace.path_s_m[run.trace.phase == 2]
    figures: dict[str, Any] = dict(measure_surface(run.trace, path, scenario.process.contact_force_n))
    reached = float(fed[-1]) if len(fed) else -1.0
    figures["coverage"] = coverage_until(plan, reached, scenario.process, scenario.pad)
    removal = remove_material(scenario, place, part, run)
    figures |= measure_removal(removal.map)
    figures |= common_figures(run, scenario, path_done(path, fed), reach.T_base_work)
    figures |= cell.payload_errors._asdict()
    figures |= shape_figures(task.shape, path)
    figures |= feed_of_jobs(cell.strokes)
    return RunResult(
        scenario, removal.log, run.trace, figures, run.stop_reason, run.interrupted, path, removal.map
    )  # fmt: skip
