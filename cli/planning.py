"""The path of a run: given, planned anew, or none where the experiment has none; imported only inside commands."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from polish_sim import exchange, planning
from polish_sim.cli import console
from polish_sim.experiments.registry import experiment
from polish_sim.experiments.report import save_plots
from polish_sim.experiments.stroke_motion import check_stroke_rule

if TYPE_CHECKING:
    from polish_sim.cell import Observer
    from polish_sim.config import Scenario
    from polish_sim.planning import PlanObserver, PlanResult, ToolPath


def plan_for_two(scenario: Scenario, observer: Observer) -> PlanResult:
    """Plan once around a part's rim for two robots, and check that both arms can do it.

    Args:
        scenario: Part, robots and process.
        observer: Told of the progress.

    Returns:
        The plan; its figures say where the part is held and how both arms start.

    Raises:
        PolishSimError: If the part cannot be used or planned, or an arm cannot follow.
    """
    from polish_sim.dual.task import prepare_dual

    begin = time.perf_counter()
    task = prepare_dual(scenario, None, observer)
    path, planned_s = task.place.path, time.perf_counter() - begin
    result = planning.measure_given_path(path, scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
    result.figures.update(
        plan_time_s=planned_s,
        air_length_m=path.length_m - float(np.ptp(path.s[path.process])),
        axis_deviation_max_rad=0.0,
        placement_value=task.reach.value,
        chain_residual_m=task.residual,
        T_gripper_work=task.seat.T_gripper_work.tolist(),
        T_master_work=task.reach.T_master_work.tolist(),
        T_follower_work=task.place.reach.T_base_work.tolist(),
        q_master_rad=task.reach.q_master.tolist(),
        q_follower_rad=task.reach.q_follower.tolist(),
        tool_spin_rad=task.reach.spin,
    )
    return result


def plan_to_run(
    scenario: Scenario, given: ToolPath | None, observer: PlanObserver, folder: Path | None
) -> PlanResult | None:
    """Plan the path of a surface run, or measure the one that is given; two robots plan their own.

    Args:
        scenario: What is to be run.
        given: A path made before.
        observer: Told of the progress.
        folder: Where the plan's files and picture go; None to write nothing.

    Returns:
        The plan; None for an experiment without one.

    Raises:
        PolishSimError: If the part cannot be used or planned.
    """
    row = experiment(scenario.experiment)
    if not (row.plans or (row.along_plan and given is not None)):
        return None
    if row.plans:
        check_stroke_rule(scenario)
    asked = (scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
    plan = planning.plan_part(*asked) if given is None else planning.measure_given_path(given, *asked)
    for text in plan.notes:
        console.note(f"note: {text}")
    if folder is not None:
        from polish_sim.analysis.path_plot import plot_plan

        exchange.write_plan(folder, plan)
        save_plots(folder, {"path.png": plot_plan(plan)})
    return plan
