"""The path of a run: given, planned anew, or none where the experiment has none; imported only inside commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from polish_sim.analysis.path_plot import plot_plan
from polish_sim.analysis.report import save_plots
from polish_sim.cli import console
from polish_sim.config import Scenario
from polish_sim.planning import PlanObserver, ToolPath, plan_part, write_plan

NO_FIGURES: Mapping[str, Any] = {}


class PathToRun(NamedTuple):
    """A path and what planning found out about it."""

    path: ToolPath | None
    figures: Mapping[str, Any] = NO_FIGURES
    """Figures of the plan that belong to the run's: coverage."""


def path_to_run(scenario: Scenario, given: ToolPath | None, observer: PlanObserver, folder: Path | None) -> PathToRun:
    """Plan the path of a surface run unless one is given.

    Args:
        scenario: What is to be run.
        given: A path made before.
        observer: Told of the progress.
        folder: Where the plan's files and picture go; None to write nothing.

    Returns:
        The path; None for an experiment without one.

    Raises:
        PolishSimError: If the part cannot be used or planned.
    """
    if given is not None or scenario.experiment != "surface":
        return PathToRun(given)
    plan = plan_part(scenario.part, scenario.plan, scenario.process, scenario.pad, observer)
    for text in plan.notes:
        console.note(f"note: {text}")
    if folder is not None:
        write_plan(folder, plan)
        save_plots(folder, {"path.png": plot_plan(plan)})
    return PathToRun(plan.path, {"coverage": plan.figures["coverage"]})
