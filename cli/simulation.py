"""Runs one experiment for the commands, with a bar, and writes its folder; imported only inside commands."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from polish_sim.analysis.cell_plot import plot_cell
from polish_sim.analysis.report import draw_plots, save_plots
from polish_sim.analysis.run_record import RunRecord, package_versions, write_record
from polish_sim.cli import console
from polish_sim.cli.frames import FrameSink
from polish_sim.cli.outcome import Outcome
from polish_sim.cli.sinks import CELL_PICTURE
from polish_sim.config import Scenario
from polish_sim.experiments import Observer, RunResult, run_experiment
from polish_sim.planning import ToolPath


def run_once(scenario: Scenario, plan: ToolPath | None, draft: Path, sinks: Sequence[FrameSink] = ()) -> Outcome:
    """Run a scenario and write its run folder.

    Args:
        scenario: What to run.
        plan: The path to run, or None to plan one.
        draft: Existing folder to fill.
        sinks: Who gets the frames: viewer, video, picture.

    Returns:
        How it ended.
    """
    with ExitStack() as stack:
        observer = stack.enter_context(console.progress(sinks))
        for sink in sinks:
            stack.enter_context(sink)
        record, result = simulate(scenario, plan, draft, observer)
        observer.stage("draw")
        save_plots(draft, draw_plots(record))
    if not (draft / CELL_PICTURE).exists() and len(record.log):
        save_plots(draft, {CELL_PICTURE: plot_cell(record)})
    return Outcome(
        scenario.experiment,
        f"{scenario.experiment}, {scenario.controller.name}, seed {scenario.seed}",
        {"this run": record.metrics},
        (result.stop_reason,) if result.stop_reason else (),
        result.interrupted,
    )


def simulate(
    scenario: Scenario, plan: ToolPath | None, folder: Path, observer: Observer | None = None
) -> tuple[RunRecord, RunResult]:
    """Run a scenario and write config, figures, log and path into a folder."""
    result = run_experiment(scenario, plan, observer)
    metrics = result.figures | {"versions": package_versions()}
    record = RunRecord(scenario.experiment, result.scenario, metrics, result.log, result.path)
    write_record(folder, record)
    return record, result
