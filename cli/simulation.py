"""Runs one experiment for the commands, with a bar, and writes its folder; imported only inside commands."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.analysis.path_plot import plot_cell
from polish_sim.analysis.removal_plot import REMOVAL_MESH, write_removal_mesh
from polish_sim.analysis.run_record import METRICS, RunRecord, package_versions, write_json, write_record
from polish_sim.cli import console
from polish_sim.cli.outcome import Outcome
from polish_sim.cli.planning import plan_to_run
from polish_sim.cli.sinks import CELL_PICTURE
from polish_sim.experiments.registry import check_experiment, claims_shown, experiment, load, run_experiment
from polish_sim.experiments.report import draw_plots, save_plots

if TYPE_CHECKING:
    from polish_sim.cell import Observer
    from polish_sim.cli.frames import FrameSink
    from polish_sim.config import Scenario
    from polish_sim.experiments.result import RunResult
    from polish_sim.planning import PlanResult, ToolPath

PICTURES_MISSING = "pictures_missing"
"""Key in metrics.json of a run that was broken off while its pictures were drawn."""


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
    row, record, undrawn = experiment(scenario.experiment), None, ""
    try:
        with ExitStack() as stack:
            observer = stack.enter_context(console.progress(sinks))
            for sink in sinks:
                stack.enter_context(sink)
            stack.enter_context(observer.compiling.ahead(scenario))
            way = plan_to_run(scenario, plan, observer, draft)
            record, result = simulate(scenario, way, draft, observer)
            observer.stage("draw")
            save_plots(draft, draw_plots(record))
            if record.removal is not None:
                write_removal_mesh(draft / REMOVAL_MESH, record.removal)
        if not (draft / CELL_PICTURE).exists() and len(record.log):
            save_plots(draft, {CELL_PICTURE: plot_cell(record)})
    except KeyboardInterrupt:
        if record is None:
            raise
        # The run itself is on disk by now and stays; only pictures are missing.
        undrawn = "'polish-sim report' with the folder of the run draws them."
        write_json(draft / METRICS, {**record.metrics, PICTURES_MISSING: True})
    return Outcome(
        claims_shown([scenario]),
        row.title(scenario),
        {"this run": record.metrics},
        (result.stop_reason,) if result.stop_reason else (),
        result.interrupted,
        undrawn,
        (*(load(row.notes)(record.metrics) if row.notes else ()), *_of_faults(record.metrics)),
    )


def _of_faults(metrics: Mapping[str, Any]) -> Iterator[str]:
    """Faults that did not happen because the run was over before."""
    for event in metrics["faults_missed"]:
        yield f"the fault {event} did not happen: the run was over after {metrics['simulated_s']:.1f} s."


def simulate(
    scenario: Scenario, way: PlanResult | None, folder: Path, observer: Observer | None = None
) -> tuple[RunRecord, RunResult]:
    """Run a scenario along its path and write config, figures, log and path into a folder."""
    result = run_experiment(scenario, way, observer)
    metrics = {**result.figures, "versions": package_versions()}
    record = RunRecord(scenario.experiment, result.scenario, metrics, result.log, result.path, result.removal)
    write_record(folder, record)
    for name, text in result.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return record, result


def check_reach(scenario: Scenario, plan: ToolPath | None) -> None:
    """Plan and check the reach of a run, and say where the part stands; nothing is simulated or written.

    Raises:
        PolishSimError: If the part cannot be used, planned or reached.
    """
    with console.progress() as observer:
        path, reach, held = check_experiment(scenario, plan_to_run(scenario, plan, observer, None), observer)
    console.say(f"path: {path.length_m:.3f} m, {len(path.s)} points, all within reach")
    if scenario.experiment != "arc":
        x, y, z = reach.T_base_work[:3, 3] * 1e3
        console.say(f"part: its origin stands at ({x:.1f}, {y:.1f}, {z:.1f}) mm of the robot base")
    if held:
        console.say(f"part: {held}")
    console.say(f"smallest singular value on the way: {reach.smallest_singular_value:.3f}")
