"""Many seeds of one scenario, on all cores, each with its own run folder; imported only inside commands."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from polish_sim.analysis.run_record import METRICS, package_versions, read_record, write_json
from polish_sim.cli import console
from polish_sim.cli.compiling import FIRST_START
from polish_sim.cli.outcome import Outcome
from polish_sim.cli.planning import plan_to_run
from polish_sim.cli.simulation import PICTURES_MISSING, simulate
from polish_sim.experiments.registry import claims_shown
from polish_sim.experiments.report import draw_seeds, save_plots
from polish_sim.kernel_cache import is_warm

if TYPE_CHECKING:
    from polish_sim.analysis.claim import Claim
    from polish_sim.config import Scenario
    from polish_sim.planning import PlanResult, ToolPath

Figures = Mapping[str, Any]


def run_seeds(scenario: Scenario, plan: ToolPath | None, seeds: Sequence[int], draft: Path) -> Outcome:
    """Run a scenario with each seed and write the run folders, the aggregated figures and a plot of all.

    Args:
        scenario: What to run.
        plan: The path to run, or None to plan one.
        seeds: The seeds.
        draft: Existing folder to fill.

    Returns:
        How it ended; what is checked is the worst seed of each figure.
    """
    runs, interrupted = _run_all(scenario, plan, seeds, draft)
    claims = claims_shown([scenario])
    mean, worst = aggregate(claims, list(runs.values()))
    table = {"experiment": scenario.experiment, "seeds": list(runs), "mean": mean, "worst": worst}
    facts, undrawn = table | {"runs": runs, "versions": package_versions()}, ""
    write_json(draft / METRICS, facts)
    try:
        records = [read_record(draft / _name(seed)) for seed in runs]
        if records:
            save_plots(draft, draw_seeds(records))
    except KeyboardInterrupt:
        undrawn = "'polish-sim report' with the folders of the seeds puts them side by side."
        write_json(draft / METRICS, facts | {PICTURES_MISSING: True})
    stops = [
        f"seed {seed}: {figures['protective_stop']}" for seed, figures in runs.items() if figures["protective_stop"]
    ]
    missed = [
        f"seed {seed}: the fault {event} did not happen, the run was over before."
        for seed, figures in runs.items()
        for event in figures["faults_missed"]
    ]
    title = f"{scenario.experiment}, {scenario.controller.label}, {len(runs)} seeds"
    return Outcome(
        claims,
        title,
        {"mean": mean, "worst seed": worst},
        tuple(stops),
        interrupted,
        undrawn,
        tuple(missed),
    )


def aggregate(claims: Sequence[Claim], runs: Sequence[Figures]) -> tuple[dict[str, float], dict[str, float]]:
    """Mean and worst value of each figure over the runs."""
    mean, worst = {}, {}
    for claim in claims:
        values = [run.get(claim.figure) for run in runs]
        known = [float(value) for value in values if value is not None]
        mean[claim.figure] = float(np.mean(known)) if known else float("nan")
        worst[claim.figure] = claim.worst_of(values)
    return mean, worst


def _run_all(
    scenario: Scenario, plan: ToolPath | None, seeds: Sequence[int], draft: Path
) -> tuple[dict[int, Figures], bool]:
    """Figures by seed of all runs that ended, in the order of the seeds, and whether the user broke off."""
    workers = min(len(seeds), os.cpu_count() or 1)
    interrupted = False
    with console.progress() as observer, _pool(workers) as pool:
        way = plan_to_run(scenario, plan, observer, draft)
        observer.stage(f"simulate {len(seeds)} seeds on {workers} cores")
        if not is_warm():
            console.note(FIRST_START)
        jobs = {seed: pool.submit(_run_one, replace(scenario, seed=seed), way, draft / _name(seed)) for seed in seeds}
        try:
            for count, job in enumerate(as_completed(jobs.values()), 1):
                job.result()
                observer.progress(count, len(seeds))
        except KeyboardInterrupt:
            interrupted = True
            console.note("interrupted: the runs under way are finished first, the waiting ones dropped.")
        finally:
            pool.shutdown(cancel_futures=True)
    return {seed: job.result() for seed, job in jobs.items() if not job.cancelled()}, interrupted


def _pool(workers: int) -> ProcessPoolExecutor:
    # The parent alone hears Ctrl-C; it lets the runs under way end and drops the waiting ones.
    return ProcessPoolExecutor(
        workers, multiprocessing.get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)
    )


def _run_one(scenario: Scenario, way: PlanResult | None, folder: Path) -> Figures:
    folder.mkdir()
    record, _ = simulate(scenario, way, folder)
    return record.metrics


def _name(seed: int) -> str:
    return f"seed-{seed:04d}"
