"""`polish-sim sweep`: many runs over settings and seeds, on this machine or a cluster; the same folder
resumes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from polish_sim.cli import console
from polish_sim.cli.boundary import DONE, STOPPED, USAGE
from polish_sim.cli.many import filled, forget_damaged
from polish_sim.cli.options import (
    CONFIG_OPTIONS,
    OWN,
    Given,
    Own,
    argument,
    build_scenario,
    named_options,
    takes,
)
from polish_sim.cli.run import OF_RUNS, checked_run
from polish_sim.config.key import OUTPUT, RUN
from polish_sim.errors import check_name, count_text, duration_text, needed, refuse_idle
from polish_sim.experiments.registry import ROWS as EXPERIMENTS
from polish_sim.experiments.registry import default_scenario
from polish_sim.page import Table, save_page
from polish_sim.row_file import ROWS, Metrics, Row
from polish_sim.scenario_file import override

if TYPE_CHECKING:
    from polish_sim.studies.study import Study
    from polish_sim.studies.table import RunTable, StudyTask
    from polish_sim.workers import Runner

SHOWN = 3  #: Reasons of runs that failed
MOST_CHECKED = 100  #: Values of an axis that are tried before the start
OF_STUDY = ("--vary", "--seeds", "--seed", "--sample", "--count", *OF_RUNS, *CONFIG_OPTIONS)
What = Annotated[
    str,
    argument("EXPERIMENT|STUDY.toml", "arc, force, surface, ..., or a study."),
]


@takes(
    Own("--vary", RUN, "KEY=VALUES", "A setting to vary, its values a,b,c or low:high:lin5 or "
                                     "low:high:log5; with a sample also low:high; may be repeated. Any key "
                                     "of the config: controller.name and part.file too.", list),
    Own("--sample", RUN, "NAME", "grid (default: every combination), random, sobol or lhs (Latin "
                                 "hypercube)."),
    Own("--count", RUN, "N", "Points of a sample.", int, 1, 1e7),
    OWN["--seeds"]._replace(text="Seeds per point, counting up from --seed; default 1."),
    Own("--dry-run", RUN, "", "Show how many runs and about how long, write nothing."),
    Own("--logs", OUTPUT, "", "Keep each run's folder with its log, in runs/<hash of its config>."),
    *("--seed", "--workers", "--on", *OF_RUNS, *CONFIG_OPTIONS, "--out"),
)  # fmt: skip
def sweep(what: What, given: Given) -> int:
    """Run an experiment over many settings and seeds: one folder with runs.parquet, study.toml and a page."""
    needed("pyarrow", "'sweep' keeps its table in Parquet", "sweep")
    from polish_sim.experiments.assembly import user_files
    from polish_sim.studies.study import STUDY, read_study, study_text
    from polish_sim.studies.table import RunTable, keys_of_runs, run_time

    study, out = asked_study(what, given)
    check_values(study)
    if given["--dry-run"]:
        begun = RunTable(out) if out and (out / ROWS).is_file() else None
        keys = keys_of_runs(study)
        missing, known = (begun.missing(keys), begun.run_s) if begun else (list(keys), None)
        first = time_first(study, missing) if known is None else None
        announce(study, len(missing), len(keys), given, known if first is None else run_time(first))
        return DONE
    kind, begin = f"sweep-{study.base.experiment}", {STUDY: study_text(study)}
    held = sweep_of(read_study(out / STUDY)) if out and (out / STUDY).is_file() else None
    named = [study.with_value(axis, v) for axis in study.axes for v in axis.values if isinstance(v, str)]
    files = sorted({file for scenario in (study.base, *named) for file in user_files(scenario)})
    prepare = partial(prepare_study, study, given)
    asked, given = sweep_of(study), {**given, "--out": out}
    with filled(given, kind, asked, "simulate", prepare, files, begin=begin, begun=held) as (
        folder,
        facts,
    ):
        _show(study, folder, facts)
        return DONE if facts["done"] else USAGE if facts["failed"] else STOPPED


def asked_study(what: str, given: Given) -> tuple[Study, Path | None]:
    """The study a command line names, checked, and the folder it resumes in, if it is one of a sweep.

    Raises:
        PolishSimError: Naming what is wrong with it.
    """
    from polish_sim.studies.study import STUDY, Study, read_axis, read_study

    file = Path(what) / STUDY if Path(what).is_dir() else Path(what)
    out: Path | None = given["--out"]
    if file.is_file() or (file.suffix == ".toml" and what not in EXPERIMENTS):
        study = read_study(file)
        refuse_idle(named_options(given), OF_STUDY, f"beside a study: what is varied is written in '{file}'")
        if out is None and file.name == STUDY and (file.parent / ROWS).is_file():
            out = file.parent
        given = {"--vary": [axis.key for axis in study.axes], "--path": study.base.plan.file or None}
    else:
        check_name("experiment", what, [*EXPERIMENTS, "STUDY.toml"])
        base = build_scenario(default_scenario(what), given)
        axes = tuple(read_axis(text) for text in given["--vary"] or [])
        study = Study(base, axes, given["--seeds"] or 1, given["--sample"] or "grid", given["--count"] or 0)
    study.check()
    _, base = checked_run(study.base, given)
    plan = Path(base.plan.file)
    kept = str(plan / "path.json") if base.plan.file and plan.is_dir() else base.plan.file
    base = override(base, study.said)  # what a file says counts over its plan
    return replace(study, base=replace(base, plan=replace(base.plan, file=kept))), out


def check_values(study: Study) -> None:
    """Refuse values no run could be made with, one axis after the other, before anything runs.

    Raises:
        PolishSimError: Naming what is wrong.
    """
    from polish_sim.experiments.assembly import check_settings

    for axis in study.axes:
        for value in axis.values[:MOST_CHECKED]:
            check_settings(study.with_value(axis, value))


def sweep_of(study: Study) -> Metrics:
    """What a sweep's folder is of: whatever is varied, one experiment."""
    return {"of": f"sweep of '{study.base.experiment}'"}


def announce(study: Study, missing: int, total: int, given: Given, run_s: float | None) -> None:
    """Show how many runs there are and about how long the missing ones take, if one takes ``run_s``."""
    from polish_sim.workers import processors

    on = given["--on"] or "local"
    here = on in ("local", "dask")
    share = (given["--workers"] or processors()) if here else 1
    points = study.count or len(study.points())
    rows = [["points", f"{points} ({study.sample})"], ["seeds", str(study.seeds)], ["runs", str(total)]]
    rows += [["done", str(total - missing)]] if total > missing else []
    rows += [["on", f"{on}, on {count_text(share, 'processor')}" if here else on]]
    if run_s is not None and missing:
        about = duration_text(run_s * missing / share)
        rows += [["about", f"{about}{'' if here else ' on one processor'}"]]
    axes = [[f"vary {axis.key}", axis.text] for axis in study.axes]
    title = f"sweep {study.base.experiment}, {study.base.controller.label}"
    console.table(Table(title, ["", ""], [*axes, *rows], left=2))


def time_first(study: Study, missing: Sequence[StudyTask]) -> Row | None:
    """Do the first run that is missing here and return its row; None if no run is missing."""
    from polish_sim.studies.table import run_row

    if not missing:
        return None
    with console.progress() as observer:
        observer.stage("time the first run")
        with redirect_stdout(sys.stderr):  # what an own controller prints
            return run_row(study, None, missing[0])


def prepare_study(study: Study, given: Given, folder: Path) -> tuple[RunTable, Callable[[Runner], Metrics]]:
    """Say how many runs there are and how long they take; what does them."""
    from polish_sim.analysis.run_record import read_record
    from polish_sim.kernel_cache import is_warm
    from polish_sim.source_stamp import package_hash
    from polish_sim.studies.table import OUTCOMES, RUN_FOLDERS, RunTable, keys_of_runs, run_study

    table = RunTable(folder)
    if table.sources - {package_hash()[:12]}:
        console.note(
            "note: rows of another version of polish-sim are in the folder and kept; see the column 'source'."
        )
    keys, logs = keys_of_runs(study), bool(given["--logs"] or (folder / RUN_FOLDERS).exists())
    ran = [key for key in keys.values() if logs and table.known.get(key) in OUTCOMES[:2]]
    forget_damaged(table, {key: folder / RUN_FOLDERS / key for key in ran}, read_record)
    # All kernels are compiled once, not in every process; once they are, the processes start at once.
    if not is_warm() and not logs and (row := time_first(study, table.missing(keys))):
        table.add(row["config_hash"], row)
    announce(study, len(table.missing(keys)), len(keys), given, table.run_s)
    return table, partial(run_study, study, keys, logs)


def _show(study: Study, folder: Path, facts: Metrics) -> None:
    from polish_sim.studies.page import figures_table, sweep_page
    from polish_sim.studies.table import FAILED, OUTCOMES, read_rows

    columns = read_rows(folder)
    save_page(folder, sweep_page(study, columns))
    figures = figures_table(study, columns)
    if figures.rows:
        console.table(figures)
    ended = ", ".join(f"{facts[name]} {name}" for name in OUTCOMES if facts[name])
    console.say(f"{count_text(facts['runs'], 'run')} in the folder: {ended}")
    reasons = dict.fromkeys(zip(columns["outcome"], columns.get("reason", ()), strict=False))
    for reason in [why for outcome, why in reasons if outcome == FAILED][:SHOWN]:
        console.note(f"failed: {reason}")
    console.say_folder(folder)
