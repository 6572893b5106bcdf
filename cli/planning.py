"""The path of a run: given, planned anew, or none where the experiment has none; imported only inside commands."""

from __future__ import annotations

from pathlib import Path

from polish_sim.analysis.path_plot import plot_plan
from polish_sim.analysis.report import save_plots
from polish_sim.cli import console
from polish_sim.config import Scenario
from polish_sim.exchange import write_plan
from polish_sim.planning import PlanObserver, PlanResult, ToolPath, measure_given_path, plan_part


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
    if scenario.experiment != "surface" and not (scenario.experiment == "dual" and given is not None):
        return None
    asked = (scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
    plan = plan_part(*asked) if given is None else measure_given_path(given, *asked)
    for text in plan.notes:
        console.note(f"note: {text}")
    if folder is not None:
        write_plan(folder, plan)
        save_plots(folder, {"path.png": plot_plan(plan)})
    return plan
