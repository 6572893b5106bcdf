"""Many seeds of one scenario, on all cores, each with its own run folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.analysis.claim import Claim
from polish_sim.cli import console
from polish_sim.config import Scenario
from polish_sim.errors import count_text

if TYPE_CHECKING:
    from polish_sim.cli.outcome import Outcome
    from polish_sim.planning import PlanResult, ToolPath

Figures = Mapping[str, Any]


def run_seeds(scenario: Scenario, plan: ToolPath | None, seeds: Sequence[int], draft: Path) -> Outcome:
    """Run a scenario with each seed and write the run folders, the aggregated figures and a plot of all into ``draft``.

    A path is planned unless one is given; what is checked is the worst seed of each figure.
    Raises KeyboardInterrupt if the user broke off before any seed was done.
    """
    from polish_sim.analysis.run_record import METRICS, package_versions, read_record, write_json
    from polish_sim.cli.outcome import Outcome, other_conditions
    from polish_sim.cli.run import PICTURES_MISSING
    from polish_sim.experiments.registry import claims_shown
    from polish_sim.experiments.report import draw_seeds, save_plots, write_seeds_page

    runs, interrupted = _run_all(scenario, plan, seeds, draft)
    if interrupted and not runs:
        raise KeyboardInterrupt  # no folder is left behind
    claims = claims_shown([scenario])
    mean, worst = aggregate(claims, list(runs.values()))
    table = {"experiment": scenario.experiment, "seeds": list(runs), "mean": mean, "worst": worst}
    facts, undrawn = table | {"runs": runs, "versions": package_versions()}, ""
    write_json(draft / METRICS, facts)
    try:
        records = [read_record(draft / _name(seed)) for seed in runs]
        if records:
            save_plots(draft, draw_seeds(records))
            write_seeds_page(draft, records, {"mean": mean, "worst seed": worst})
    except KeyboardInterrupt:
        undrawn = "'polish-sim report' with the folders of the seeds puts them side by side."
        write_json(draft / METRICS, facts | {PICTURES_MISSING: True})
    stops = [f"seed {seed}: {stop}" for seed, figures in runs.items() if (stop := figures["protective_stop"])]
    missed = [
        f"seed {seed}: the fault {event} did not happen, the run was over before."
        for seed, figures in runs.items()
        for event in figures["faults_missed"]
    ]
    return Outcome(
        claims,
        f"{scenario.experiment}, {scenario.controller.label}, {count_text(len(runs), 'seed')}",
        {"mean": mean, "worst seed": worst},
        tuple(stops),
        interrupted,
        undrawn,
        tuple(missed),
        tuple(f"seed {seed}: {text}" for seed, figures in runs.items() for text in figures.get("bad_figures", ())),
        other_conditions(scenario),
    )


def aggregate(claims: Sequence[Claim], runs: Sequence[Figures]) -> tuple[dict[str, float], dict[str, float]]:
    """Mean and worst value of each figure over the runs."""
    mean, worst = {}, {}
    for claim in claims:
        values = [run.get(claim.figure) for run in runs]
        known = [float(value) for value in values if value is not None]
        mean[claim.figure] = sum(known) / len(known) if known else float("nan")
        worst[claim.figure] = claim.worst_of(values)
    return mean, worst


def _run_all(
    scenario: Scenario, plan: ToolPath | None, seeds: Sequence[int], draft: Path
) -> tuple[dict[int, Figures], bool]:
    """Figures by seed of all runs that ended, in the order of the seeds, and whether the user broke off."""
    from polish_sim.cli.compiling import FIRST_START
    from polish_sim.cli.run import plan_to_run
    from polish_sim.kernel_cache import is_warm
    from polish_sim.workers import open_workers, processors

    workers = min(len(seeds), processors())
    runs: dict[int, Figures] = {}
    interrupted = False
    with console.progress() as observer:
        way, scenario = plan_to_run(scenario, plan, observer, draft)
        observer.stage(f"simulate {count_text(len(seeds), 'seed')} on {count_text(workers, 'core')}")
        if not is_warm():
            console.note(FIRST_START)
        try:
            doing = partial(_run_one, scenario, way, draft)
            with open_workers(count=workers) as crew, closing(crew.results(seeds, doing, lambda _: 0)) as results:
                for seed, figures, trouble in results:
                    if trouble is not None:
                        console.note(f"warning: {trouble} (seed {seed}).")
                    else:
                        runs[seed] = figures
                    observer.progress(len(runs), len(seeds))
        except KeyboardInterrupt:
            interrupted = True
            if runs:
                console.note("interrupted: the seeds that are done are kept.")
    for seed in set(seeds) - set(runs):
        shutil.rmtree(draft / _name(seed), ignore_errors=True)
    return {seed: runs[seed] for seed in seeds if seed in runs}, interrupted


def _run_one(scenario: Scenario, way: PlanResult | None, draft: Path, seed: int) -> Figures:
    from polish_sim.cli.run import simulate

    folder = draft / _name(seed)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return simulate(replace(scenario, seed=seed), way, folder).metrics


def _name(seed: int) -> str:
    return f"seed-{seed:04d}"
