"""One row of the scorecard: a case, a controller and a seed become figures. A row depends on its scenario
alone.

On disk a row counts as long as the key beside it is the key of the row that is wanted: the whole scenario,
the user's files and the package's own source enter it. Change any of them, and the row is measured anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Hashable, Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from polish_sim.analysis.metrics import errors_at_peaks, peaks_passed
from polish_sim.arrays import Array
from polish_sim.cell import CellRun
from polish_sim.cell.limits import modelled_depth
from polish_sim.config import Scenario
from polish_sim.errors import PolishSimError
from polish_sim.experiments.assembly import (
    Workplace,
    build_cell,
    build_part,
    check,
    config_hash,
    place_key,
)
from polish_sim.experiments.part_setup import path_done
from polish_sim.experiments.surface import hold_done, place_work
from polish_sim.row_file import Row, plain
from polish_sim.scoring.battery import Case, Entry
from polish_sim.scoring.figures import FIGURES, measure_score
from polish_sim.source_stamp import package_hash


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
        modelled_depth(scenario.head, scenario.pad, scenario.process.contact_force_n),
        scenario.seed,
    )


def _measure(task: Task) -> Row:
    scenario = check(task.scenario)
    place = place_work(scenario)
    run = build_cell(scenario, place, build_part(scenario, place)).run()
    if run.interrupted:
        raise KeyboardInterrupt
    return measured(task, place, run)


def measured(task: Task, place: Workplace, run: CellRun) -> Row:
    """The figures of a run of a task's scenario, whatever drove the robot."""
    scenario = task.scenario
    return (
        _named(task)
        | _figures(task, scenario, place, run)
        | {
            "protective_stop": run.stop_reason,
            "largest_force_n": float(run.trace.normal_force_n.max()),
            "duration": run.steps * scenario.simulation.timestep_s,
        }
    )


def _figures(task: Task, scenario: Scenario, place: Workplace, run: CellRun) -> Row:
    trace, force = run.trace, scenario.process.contact_force_n
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
    at_peaks = errors_at_peaks(path_s, error, peaks_passed(place.path, path_s)).at_peaks_n
    return figures | {"peaks_error_n": plain(at_peaks), "slowed": _slowed(scenario, path_s)}


def _slowed(scenario: Scenario, path_s: Array) -> float | None:
    """Share of the wanted feed that was not driven [-]; the places on the path at the steps of the feed,
    shape (n,)."""
    planned = len(path_s) * scenario.simulation.timestep_s * scenario.process.feed_m_s
    return 1.0 - float(path_s[-1] - path_s[0]) / planned if len(path_s) > 1 else None


def _done(task: Task, place: Workplace, run: CellRun) -> bool:
    """Whether the hold or the feed went to its end; a feed of limited time ends when its time is over."""
    scenario = task.scenario
    if not task.case.moving:
        return hold_done(scenario, run) > 0.999
    fed = run.trace.fed
    limit = scenario.process.max_feed_s
    timed_out = limit > 0.0 and float(np.sum(fed)) * scenario.simulation.timestep_s >= 0.999 * limit
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
    return {task: hashlib.sha256("|".join(said).encode()).hexdigest()[:24] for task, said in words.items()}
