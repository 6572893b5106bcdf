"""Many runs as one mechanism: tasks -> rows on disk -> what is made of them; the same command with --out
resumes."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from polish_sim.analysis.claim import Claim, figure_of
from polish_sim.cli import console
from polish_sim.cli.boundary import Outcome
from polish_sim.cli.options import OUTPUT_OPTIONS, Given, refuse_beside, refuse_without
from polish_sim.cli.output_folder import claimed, rows_folder
from polish_sim.cli.run import PICTURES_MISSING, plan_to_run, simulate
from polish_sim.config import Checked
from polish_sim.errors import InputError, PolishSimError, count_text
from polish_sim.experiments.registry import claims_shown, experiment
from polish_sim.page import save_page
from polish_sim.row_file import (
    METRICS,
    ROWS,
    Metrics,
    Rows,
    read_json,
    save_plots,
    whole_folder,
    write_json,
    write_metrics,
)
from polish_sim.scenario_file import counted_seeds

if TYPE_CHECKING:
    from polish_sim.cell import Observer
    from polish_sim.planning import PlanResult, ToolPath
    from polish_sim.workers import Runner

T = TypeVar("T")
ASKED = "asked.json"  #: What the rows in the folder are of


@contextmanager
def filled(
    given: Given,
    kind: str,
    asked: Metrics,
    stage: str,
    prepare: Callable[[Path], tuple[Rows, Callable[[Runner], T]]],
    files: Sequence[Path],
    *,
    usual: str = "local",
    begin: Mapping[str, str] | None = None,
    begun: Metrics | None = None,
) -> Iterator[tuple[Path, T]]:
    """The folder of the rows ``asked`` for, by name, and what some work makes of them; an interrupt that left
    rows out is raised behind the block.

    Args:
        given: ``--out``, ``--workers``, ``--on``, and ``--overwrite`` where the command has that: without,
            only the same is continued in a folder.
        kind: Of the folder, e.g. ``run-force``.
        asked: Kept in `ASKED`, unless ``begin`` has the files that say it; ``begun`` is what those there say.
        stage: For the progress.
        prepare: From the folder, its rows and the work.
        files: The user's, which are shipped to other machines.
        usual: Where the work is done if ``--on`` does not say.
        begin: Files to begin the folder with.
        begun: What the folder is of already.
    """

    begins = begin or {ASKED: json.dumps(asked, indent=1) + "\n"}

    def refuse(folder: Path) -> None:
        held = begun or _begun(folder)
        if given.get("--overwrite") or held is None or held == asked:
            return
        raise InputError(
            f"'{folder}' holds another {asked['of']}: {_difference(held, asked, *begins)}. Choose another "
            "folder with --out"
            + (
                ", or add --overwrite to replace it; rows that both have are kept."
                if "--overwrite" in given
                else "."
            )
        )

    from polish_sim.cli.progress import FIRST_START
    from polish_sim.kernel_cache import is_warm
    from polish_sim.workers import Runner, open_workers

    with rows_folder(given["--out"], kind, kind.partition("-")[0], begins, refuse) as folder:
        kept, work = prepare(folder)
        on = given["--on"] or ("local" if given["--workers"] else usual)
        if not is_warm() and on != "here":
            console.note(FIRST_START)
        with open_workers(on, given["--workers"], files) as workers, console.progress() as observer:
            observer.stage(f"{stage}: {workers.where}")

            def heard(done: int, total: int, trouble: str | None) -> None:
                if trouble:
                    console.note(f"warning: {trouble}.")
                observer.progress(done, total)

            runner = Runner(kept, workers, heard)
            done = work(runner)
        # Said before what is shown of them.
        if runner.lost:
            console.note(
                f"{count_text(runner.lost, 'run')} left out: the processes died; the same command does them "
                "again."
            )
        if runner.interrupted:
            console.note("interrupted: what follows is of the runs done so far.")
        yield folder, done
        if runner.interrupted:
            raise KeyboardInterrupt


def forget_damaged(kept: Rows, folders: Mapping[str, Path], read: Callable[[Path], object]) -> None:
    """Have rows done again whose folders, by their keys, cannot be read."""
    for key in folders.keys() & kept.known:
        try:
            read(folders[key])
        except PolishSimError as error:
            console.note(f"done again: {error}")
            del kept.known[key]


def _begun(folder: Path) -> Metrics | None:
    """What the rows in a folder are of; None if there are none yet, nothing known if it cannot be read."""
    if not (folder / ROWS).stat().st_size and not (folder / ASKED).exists():
        return None
    try:
        return read_json(folder / ASKED)
    except InputError:
        return {}


def _difference(begun: Metrics, asked: Metrics, file: str) -> str:
    """The first thing in which two works differ, in words; ``file`` says what the one begun is of."""
    if begun.get("of") != asked["of"]:
        if "of" not in begun:
            return f"its {file}, which names the work, is damaged or gone"
        return f"a {begun['of']}, not a {asked['of']}"
    for name in (name for name in asked if name not in ("of", "rows")):
        if begun.get(name) != asked.get(name):
            return f"its {name} are {_listed(begun.get(name))}, not {_listed(asked.get(name))}"
    return "a file, a setting, or this program, have changed since it was begun"


def _listed(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


# Many seeds of one work: a row each.


class Many(NamedTuple):
    """What is done with each of many seeds, and what its figures are."""

    kind: str  #: Of the folder, e.g. ``run-force``
    what: str  #: For titles
    depends: str  #: All that a row depends on, but the seed
    #: From the folder, what makes a seed's figures, in any process
    prepare: Callable[[Path], Callable[[int], Metrics]]
    claims: Sequence[Claim]
    mean: str = "mean"  #: Or ``rms``
    usual: str = "local"  #: Where the work is done if nothing is said
    conditions: tuple[str, ...] = ()  #: As of `Outcome`
    files: Sequence[Path] = ()  #: The user's, which the work needs
    #: Reads the folder of a seed where each leaves one: without it, whole, the seed is done again
    read: Callable[[Path], object] = lambda _folder: None


def seed_rows(
    many: Many, given: Given, seeds: Sequence[int], seed: str = "seed"
) -> AbstractContextManager[tuple[Path, dict[int, Metrics]]]:
    """The folder with a row of each seed, and those rows; an interrupt that left some out is raised behind
    the block.

    ``seed``: what one of them is called.
    """
    from polish_sim.source_stamp import package_hash, short_hash

    stamp = short_hash(f"{many.depends}|{package_hash()}".encode())
    keys = {number: f"{stamp}-{number}" for number in seeds}

    def prepare(folder: Path) -> tuple[Rows, Callable[[Runner], dict[int, Metrics]]]:
        kept = Rows(folder)
        forget_damaged(kept, {key: seed_folder(folder, number) for number, key in keys.items()}, many.read)
        # What is done already needs no plan.
        work = many.prepare(folder) if kept.missing(keys) else dict

        def fill(runner: Runner) -> dict[int, Metrics]:
            rows = runner.fill(keys, work)
            whole = {seed_folder(folder, int(key.rpartition("-")[2])) for key in kept.known}
            for left in set(folder.glob("*seed-*")) - whole:  # of an interrupt
                shutil.rmtree(left, ignore_errors=True)
            return rows

        return kept, fill

    asked = {"of": f"{many.kind} of many {seed}s", "rows": stamp}
    stage = f"{count_text(len(seeds), seed)} of {many.what}"
    return filled(given, many.kind, asked, stage, prepare, many.files, usual=many.usual)


def run_seeds(
    many: Many,
    given: Given,
    finish: Callable[[Path, dict[int, Metrics], Outcome], Outcome] = lambda _folder, _runs, outcome: outcome,
) -> int:
    """Do the work for each of ``--seeds``, write their figures, mean and worst; what is checked is the worst.

    ``finish`` may draw, and add to the outcome; an interrupt keeps the seeds that are done.
    """
    from polish_sim.page.page import Page

    with seed_rows(many, given, counted_seeds(given["--seed"], given["--seeds"])) as (folder, runs):
        middle, worst = aggregate(many.claims, list(runs.values()), many.mean)
        facts = {
            "experiment": many.kind.removeprefix("run-"),
            "seeds": list(runs),
            many.mean: middle,
            "worst": worst,
        }
        write_metrics(folder, {**facts, "runs": runs})
        title = f"{many.what}, {count_text(len(runs), 'seed')}"
        columns = {many.mean: middle, "worst seed": worst}
        outcome = Outcome(many.claims, title, columns, conditions=many.conditions)
        save_page(folder, Page.of(title, f"{many.mean} and worst of all seeds", [outcome.table]))
        return finish(folder, runs, outcome).finish(folder, given["--check"])


def aggregate(claims: Sequence[Claim], runs: Sequence[Metrics], mean: str) -> tuple[Metrics, Metrics]:
    """Mean (or rms) and worst value of each figure over the runs; what no run has is left out."""
    power, middle, worst = 2.0 if mean == "rms" else 1.0, {}, {}
    for claim in claims:
        values = [figure_of(run, claim.figure) for run in runs]
        known = [value for value in values if not math.isnan(value)]
        middle[claim.figure] = (
            (sum(v**power for v in known) / len(known)) ** (1.0 / power) if known else float("nan")
        )
        worst[claim.figure] = claim.worst_of(values)
    return middle, worst


def seed_folder(folder: Path, seed: int) -> Path:
    """Where the files of one seed are."""
    return folder / f"seed-{seed:04d}"


# Work that is done once, with many seeds, or on a user's measurements: calibrations, identification.

BESIDE_DATA = ("--data", "--pair", "--drift", "--check", *OUTPUT_OPTIONS)
"""Options that count for measurements of real robots, too."""


class Means(NamedTuple):
    """How something is found, written and shown."""

    kind: str  #: Of the folder, e.g. ``calibrate-tcp``
    what: str  #: What is found, for titles
    run: Callable[[int, Observer], Any]  #: Simulates with a seed
    show: Callable[[Any], tuple[str, ...]]  #: Prints its own tables, returns notes
    write: Callable[[Any, Path], None]
    claims: Sequence[Claim]  #: Asked where it is simulated
    of_data: Sequence[Claim] = ()  #: Asked of a user's measurements
    fit: Callable[[Path], Any] | None = None  #: Finds it from their file
    mean: str = "rms"  #: As of `Many`
    folders: bool = False  #: Whether each of many seeds leaves its files
    usual: str = "here"  #: As of `Many`


def carry_out(given: Given, means: Means, trial: object) -> int:
    """Find something from a file, once, or with many seeds of a ``trial``, write the folder and show the
    outcome."""
    data, first = given["--data"], given["--seed"] or 0
    refuse_beside(given, "--data", *(name for name in given if name not in BESIDE_DATA))
    refuse_without(given, "--seeds", "--workers", "--on")
    if given["--seeds"]:
        depends, each = f"{trial} {given.get('--arm')}", partial(_each, means)
        many = Many(means.kind, means.what, depends, each, means.claims, means.mean, means.usual)
        return run_seeds(many, given)
    with claimed(given, means.kind) as folder:
        if data and means.fit:
            found = means.fit(data)
        else:
            with console.progress() as observer:
                found = means.run(first, observer)
        means.write(found, folder.draft)
        title = f"{means.what} from {data.name}" if data else f"{means.what}, seed {first}"
        claims = means.of_data if data else means.claims
        outcome = Outcome(claims, title, {"found": found.figures}, notes=means.show(found))
    return outcome.finish(folder.final, given["--check"])


def _each(means: Means, folder: Path) -> Callable[[int], Metrics]:
    """What does it with a seed, in any process."""
    place = folder.resolve()

    def one(seed: int) -> Metrics:
        from polish_sim.cell import SILENT  # the simulator is slow to import

        found = means.run(seed, SILENT)
        if means.folders:
            with whole_folder(seed_folder(place, seed)) as own:
                means.write(found, own)
        return dict(found.figures)

    return one


# Many seeds of a run.


def run_many(scenario: Checked, plan: ToolPath | None, given: Given) -> int:
    """Run a scenario with each seed, each with its run folder; the path is planned once."""
    from polish_sim.analysis.run_record import other_conditions, read_record
    from polish_sim.experiments.assembly import config_hash, user_files

    def prepare(folder: Path) -> Callable[[int], Metrics]:
        with console.progress() as observer:
            way, placed = plan_to_run(scenario, plan, observer, folder)
        return partial(_run_one, placed, way, folder.resolve())

    what, row = scenario.experiment, experiment(scenario.experiment)
    if row.controlled:
        what += f", {scenario.controller.label}"
    many = Many(
        f"run-{row.name}",
        what,
        config_hash(replace(scenario, seed=0), {}),
        prepare,
        claims_shown([scenario]),
        conditions=other_conditions(scenario, row.defaults),
        files=user_files(scenario),
        read=read_record,
    )
    return run_seeds(many, given, _finish_runs)


def _run_one(scenario: Checked, way: PlanResult | None, folder: Path, seed: int) -> Metrics:
    with whole_folder(seed_folder(folder, seed)) as own:
        return dict(simulate(replace(scenario, seed=seed), way, own).metrics)


def _finish_runs(folder: Path, runs: Mapping[int, Metrics], outcome: Outcome) -> Outcome:
    """Draw all seeds together, and say what went wrong in which."""
    from polish_sim.analysis.run_record import read_record
    from polish_sim.experiments.report import draw_seeds, seeds_page

    def said(texts: Callable[[Metrics], Sequence[str]]) -> tuple[str, ...]:
        return tuple(f"seed {seed}: {text}" for seed, figures in runs.items() for text in texts(figures))

    outcome = replace(
        outcome,
        stops=said(lambda figures: [figures["protective_stop"]] if figures["protective_stop"] else []),
        notes=said(
            lambda m: [f"the fault {e} did not happen, the run was over before." for e in m["faults_missed"]]
        ),
        bad=said(lambda figures: figures.get("bad_figures", ())),
    )
    try:
        records = [read_record(seed_folder(folder, seed)) for seed in runs]
        save_plots(folder, draw_seeds(records))
        notes = [*outcome.stops, *outcome.notes, *(f"bad: {text}." for text in outcome.bad)]
        save_page(folder, seeds_page(records, outcome.table, notes))
    except KeyboardInterrupt:
        write_json(folder / METRICS, read_json(folder / METRICS) | {PICTURES_MISSING: True})
        undrawn = "'polish-sim report' with the folders of the seeds puts them side by side."
        outcome = replace(outcome, undrawn=undrawn)
    return outcome
