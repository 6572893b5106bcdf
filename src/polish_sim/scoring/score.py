"""A score: cases, controllers and seeds become rows of figures, measured over the cores or found from before.

A row depends on its scenario alone. On disk it counts as long as the key beside it is the key of the row that
is wanted: the whole scenario, the user's files and the package's own source enter it. Change any of them, and
the row is measured anew.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.analysis.metrics import errors_at_peaks
from polish_sim.cell import CellRun
from polish_sim.cell.real_arm import take_arm
from polish_sim.config import Scenario
from polish_sim.control import build_controller
from polish_sim.control.laws import file_of, tell_error
from polish_sim.errors import InputError, PolishSimError, first_twice
from polish_sim.experiments.assembly import (
    Workplace,
    build_cell,
    check,
    config_hash,
    place_key,
)
from polish_sim.experiments.part_setup import path_done
from polish_sim.experiments.surface import hold_done, place_work
from polish_sim.row_file import Row, plain
from polish_sim.scoring.battery import Case, Entry
from polish_sim.scoring.figures import FIGURES, measure_score
from polish_sim.source_stamp import package_hash, short_hash
from polish_sim.workers import Heard, Runner


class Task(NamedTuple):
    """One row to be measured."""

    case: Case
    entry: Entry
    seed: int

    def __str__(self) -> str:
        """For messages."""
        return f"{self.case.name}, {self.entry.label}, seed {self.seed}"

    @property
    def scenario(self) -> Scenario:
        """The complete scenario."""
        return self.case.scenario(self.entry, self.seed)


def measure_row(task: Task) -> Row:
    """Run one row's scenario and measure it: case, controller, seed, `DEFINITIONS`, protective_stop and
    duration.

    A run that could not be set up says why as its protective_stop and has no figures.
    """
    try:
        return _measure(task)
    except PolishSimError as error:
        return _named(task) | {**_NOTHING, "protective_stop": f"not run: {error}", "duration": 0.0}


def _named(task: Task) -> Row:
    return {"case": task.case.name, "controller": task.entry.label, "seed": task.seed}


def setup_key(task: Task) -> Hashable:
    """What place and real part of a row depend on: rows that share it share their set-up."""
    scenario = task.scenario
    return (
        place_key(scenario),
        scenario.part,
        scenario.head.spring_scale,
        scenario.seed,
    )


def _measure(task: Task) -> Row:
    scenario = check(task.scenario)
    place = place_work(scenario)
    run = build_cell(scenario, place).run()
    if run.interrupted:
        raise KeyboardInterrupt
    return measured(task, place, run)


def measured(task: Task, place: Workplace, run: CellRun) -> Row:
    """The figures of a run of a task's scenario, whatever drove the robot."""
    return (
        _named(task)
        | _figures(task, place, run)
        | {
            "protective_stop": run.stop_reason,
            "largest_force_n": run.trace.normal_force_n.max(),
            "duration": run.steps * run.dt,
        }
    )


def _figures(task: Task, place: Workplace, run: CellRun) -> Row:
    process, trace = task.scenario.process, run.trace
    force = process.contact_force_n
    wanted = (
        place.path.force_at(trace.path_s_m, force) if task.case.moving else np.full(len(trace.time_s), force)
    )
    figures = measure_score(
        trace, wanted, task.case.moving, run.stop_reason is None and _done(task, place, run)
    )
    fed = trace.fed
    path_s = trace.path_s_m[fed]
    if not task.case.moving:
        return figures | {"peaks_error_n": None, "slowed": None}
    error = (trace.normal_force_n - wanted)[fed]
    at_peaks = errors_at_peaks(place.path, path_s, error).at_peaks_n
    # Share of the wanted feed that was not driven [-].
    planned = len(path_s) * run.dt * process.feed_m_s
    slowed = 1.0 - float(path_s[-1] - path_s[0]) / planned if len(path_s) > 1 else None
    return figures | {"peaks_error_n": plain(at_peaks), "slowed": slowed}


def _done(task: Task, place: Workplace, run: CellRun) -> bool:
    """Whether the hold or the feed went to its end; a feed of limited time ends when its time is over."""
    process = task.scenario.process
    if not task.case.moving:
        return hold_done(process.hold_s, run) > 0.999
    fed = run.trace.fed
    limit = process.max_feed_s
    timed_out = limit > 0.0 and float(fed.sum()) * run.dt >= 0.999 * limit
    return timed_out or path_done(place.path, run.trace.path_s_m[fed]) > 0.999


_NOTHING: Row = dict.fromkeys((*FIGURES, "peaks_error_n", "slowed")) | {"stable": False}


def keys_of(tasks: Iterable[Task]) -> dict[Task, str]:
    """What each row depends on, as a hash: scenario, the files it names (see `config_hash`), this package's
    source."""
    hashes: dict[Path, str] = {}
    words = {
        task: (package_hash(), config_hash(task.scenario, hashes), task.case.name, task.entry.label)
        for task in tasks
    }
    return {task: short_hash("|".join(said).encode()) for task, said in words.items()}


# The rows there are to be, and what measures those that are missing.


@dataclass(frozen=True)
class Score:
    """What was asked and what was measured of it."""

    cases: tuple[Case, ...]
    entries: tuple[Entry, ...]
    seeds: range  #: Of every case; a case that repeats takes those behind them too
    rows: tuple[Row, ...]  #: In the order of controllers, cases and seeds
    wanted: int  #: Number of rows there are when all is done

    def rows_of(self, entry: Entry) -> tuple[Row, ...]:
        """Rows of one controller."""
        return tuple(row for row in self.rows if row["controller"] == entry.label)


def list_tasks(cases: Sequence[Case], entries: Sequence[Entry], seeds: range) -> list[Task]:
    """All rows of a score."""
    return [
        Task(case, entry, seeds.start + n)
        for entry in entries
        for case in cases
        for n in range(len(seeds) * case.repeats)
    ]


def asked_for(what: str, entries: Sequence[Entry], tasks: Iterable[Task], **more: Any) -> dict[str, Any]:
    """What rows are of, to compare it with others: controllers, what ``more`` says, one hash of all that the
    tasks depend on."""
    rows = short_hash("".join(keys_of(tasks).values()).encode())
    labels = [entry.label for entry in entries]
    return {"of": what, "controllers": labels, **more, "rows": rows}


def check_entries(cases: Sequence[Case], entries: Sequence[Entry]) -> None:
    """Refuse, before anything runs, a controller that cannot be made or a setting that does not fit the
    config."""
    if twice := first_twice([entry.label for entry in entries]):
        raise InputError(f"'{twice}' would be compared with itself. Name another controller with --against.")
    for entry in entries:
        for case in cases:
            scenario = case.scenario(entry, 0)
        take_arm(scenario.robot)
        controller = build_controller(scenario.controller)
        cycle = scenario.simulation.timestep_s * scenario.simulation.control_every
        try:
            controller.reset(cycle)
        except Exception as error:
            reason = tell_error(error, file_of(controller))
            raise InputError(f"the reset() of '{entry.label}' failed: {reason}.") from error


def score_rows(
    runner: Runner,
    tasks: Iterable[Task],
    work: Callable[[Task], Row] = measure_row,
    heard: Heard | None = None,
) -> dict[Task, Row]:
    """The rows of tasks; those Ctrl-C or the death of a process left out are not there."""
    return runner.fill(keys_of(tasks), work, setup_key, heard=heard)


def run_score(cases: Sequence[Case], entries: Sequence[Entry], seeds: range, runner: Runner) -> Score:
    """Measure all rows that are not there yet; Ctrl-C ends it early with what is there."""
    tasks = list_tasks(cases, entries, seeds)
    rows = tuple(score_rows(runner, tasks).values())
    return Score(tuple(cases), tuple(entries), seeds, rows, len(tasks))


def user_entry(name: str, settings: Sequence[str] = (), remark: str = "") -> Entry:
    """An entry for a controller as a user names it; a file's path is made absolute, for other processes to
    find it.

    ``settings``: ``KEY=VALUE`` of the config that belong to it; ``remark``: added to its name in tables.
    """
    label = f"{name} {remark}".strip()
    file, separator, class_name = name.rpartition(":")
    if separator and Path(file).is_file():  # one that is missing is named as it was given
        name = f"{Path(file).resolve()}:{class_name}"
    return Entry(label, name, tuple(settings))
