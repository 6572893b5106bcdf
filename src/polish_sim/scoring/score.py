"""A whole score: which rows there are to be, measured over the cores or found from before."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from polish_sim.cell.real_arm import take_arm
from polish_sim.control import build_controller
from polish_sim.control.laws import file_of, tell_error
from polish_sim.errors import InputError
from polish_sim.row_file import Row, Rows
from polish_sim.scoring.battery import Case, Entry
from polish_sim.scoring.journal import Task, keys_of, measure_row, setup_key
from polish_sim.workers import Heard, Workers, fill_rows


@dataclass(frozen=True)
class Score:
    """What was asked and what was measured of it."""

    cases: tuple[Case, ...]
    entries: tuple[Entry, ...]
    seeds: int
    rows: tuple[Row, ...]  #: In the order of controllers, cases and seeds
    wanted: int  #: Number of rows there are when all is done

    @property
    def complete(self) -> bool:
        """Whether no row is missing."""
        return len(self.rows) == self.wanted

    def rows_of(self, entry: Entry) -> tuple[Row, ...]:
        """Rows of one controller."""
        return tuple(row for row in self.rows if row["controller"] == entry.label)


def list_tasks(cases: Sequence[Case], entries: Sequence[Entry], seeds: int) -> list[Task]:
    """All rows of a score."""
    return [
        Task(case, entry, seed) for entry in entries for case in cases for seed in range(seeds * case.repeats)
    ]


def asked_for(what: str, entries: Sequence[Entry], tasks: Iterable[Task], **more: Any) -> dict[str, Any]:
    """What rows are of, to compare it with others: controllers, what ``more`` says, one hash of all that the
    tasks depend on."""
    digest = hashlib.sha256("".join(keys_of(tasks).values()).encode())
    labels = [entry.label for entry in entries]
    return {"of": what, "controllers": labels, **more, "rows": digest.hexdigest()[:24]}


def check_entries(cases: Sequence[Case], entries: Sequence[Entry]) -> None:
    """Refuse, before anything runs, a controller that cannot be made or a setting that does not fit the
    config."""
    labels = [entry.label for entry in entries]
    if len(set(labels)) < len(labels):
        raise InputError(
            f"'{labels[-1]}' would be compared with itself. Name another controller with --against."
        )
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


class Scorer:
    """Rows of a folder, measured by workers or found there from before.

    Rows do not depend on the workers or their number.
    """

    interrupted = False  #: Whether Ctrl-C left rows out
    lost = 0  #: Rows left out because their processes died

    def __init__(self, folder: Path, workers: Workers) -> None:
        self._kept, self._workers = Rows(folder), workers

    def fill(
        self, tasks: Iterable[Task], heard: Heard, work: Callable[[Task], Row] = measure_row
    ) -> dict[Task, Row]:
        """The rows of tasks; those Ctrl-C or the death of a process left out are not there."""
        keys = keys_of(tasks)
        rows, self.interrupted = fill_rows(keys, self._kept, work, setup_key, self._workers, heard)
        self.lost += 0 if self.interrupted else len(keys) - len(rows)
        return rows

    def rows(
        self,
        tasks: Iterable[Task],
        heard: Heard = lambda *_: None,
        work: Callable[[Task], Row] = measure_row,
    ) -> dict[Task, Row]:
        """The same for a search, which needs all of them: Ctrl-C ends it."""
        rows = self.fill(tasks, heard, work)
        if self.interrupted:
            raise KeyboardInterrupt
        return rows


def run_score(
    cases: Sequence[Case], entries: Sequence[Entry], seeds: int, scorer: Scorer, heard: Heard
) -> Score:
    """Measure all rows that are not there yet; Ctrl-C ends it early with what is there. Seeds count up from
    0."""
    tasks = list_tasks(cases, entries, seeds)
    rows = tuple(scorer.fill(tasks, heard).values())
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
