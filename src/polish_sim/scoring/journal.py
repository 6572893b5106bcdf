"""The rows of a score on disk, one line each as they come, so that a broken-off score goes on where it was.

A line counts as long as the key beside it is the key of the row that is wanted: the whole scenario, the user's
controller file and the package's own source enter it. Change any of them, and the row is measured anew.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from polish_sim.analysis.metrics import PROCESS, curvature_peaks, errors_at_peaks
from polish_sim.arrays import Array
from polish_sim.cell import CellRun
from polish_sim.config import Scenario
from polish_sim.errors import InputError, PolishSimError
from polish_sim.experiments.assembly import Workplace, build_cell, build_part, modelled_depth
from polish_sim.experiments.force import hold_done, place_force
from polish_sim.experiments.part_setup import path_done
from polish_sim.experiments.surface import prepare_surface
from polish_sim.scenario_file import to_toml
from polish_sim.scoring.battery import Case, Entry
from polish_sim.scoring.figures import FIGURES, measure_score

# One row of the scorecard: a case, a controller and a seed become figures.
#
# What is not random (plan, placement) and what only the seed decides (the real part) is kept between rows of a process:
# a freeform part's distance field takes longer than polishing it. A row depends on its scenario alone.

T = TypeVar("T")
Row = dict[str, Any]

_KEPT: Final = 3  #: Plans and parts a process remembers; a freeform part takes tens of megabytes


class Task(NamedTuple):
    """One row to be measured."""

    case: Case
    entry: Entry
    seed: int

    @property
    def scenario(self) -> Scenario:
        """The complete scenario."""
        return self.case.scenario(self.entry, self.seed)


def measure_row(task: Task) -> Row:
    """Run one row's scenario and measure it: case, controller, seed, `DEFINITIONS`, protective_stop and duration.

    A run that could not be set up says why as its protective_stop and has no figures.
    """
    begin: Row = {"case": task.case.name, "controller": task.entry.label, "seed": task.seed}
    try:
        return begin | _measure(task)
    except PolishSimError as error:
        return begin | {**_NOTHING, "protective_stop": f"not run: {error}", "duration": 0.0}


def setup_key(scenario: Scenario) -> Hashable:
    """What place and real part of a scenario depend on: rows that share it share their set-up."""
    return (
        _place_key(scenario),
        scenario.part,
        modelled_depth(scenario, scenario.process.contact_force_n),
        scenario.seed,
    )


def _measure(task: Task) -> Row:
    scenario = task.scenario
    place = _PLACES.get(_place_key(scenario), lambda: _place(scenario))
    part = _PARTS.get(setup_key(scenario), lambda: build_part(scenario, place))
    hold, lift = (0.0, scenario.plan.clearance_m) if task.case.moving else (scenario.process.hold_s, 0.0)
    run = build_cell(scenario, place, part, hold, lift).run()
    if run.interrupted:
        raise KeyboardInterrupt
    return _figures(task, scenario, place, run) | {
        "protective_stop": run.stop_reason,
        "duration": run.steps * scenario.simulation.timestep_s,
    }


def _place(scenario: Scenario) -> Workplace:
    return prepare_surface(scenario).place if scenario.experiment == "surface" else place_force(scenario)


def _figures(task: Task, scenario: Scenario, place: Workplace, run: CellRun) -> Row:
    trace, force = run.trace, scenario.process.contact_force_n
    wanted = place.path.force_at(trace.path_s_m, force) if task.case.moving else np.full(len(trace.time_s), force)
    figures = measure_score(trace, wanted, task.case.moving, run.stop_reason is None and _done(scenario, place, run))
    fed = trace.phase == PROCESS
    peaks = place.path.s[curvature_peaks(place.path)] if task.case.moving else np.empty(0)
    path_s = trace.path_s_m[fed]
    passed = peaks[peaks <= (path_s[-1] if len(path_s) else -np.inf)]
    at_peaks = errors_at_peaks(path_s, (trace.normal_force_n - wanted)[fed], passed).at_peaks_n
    known = None if np.isnan(at_peaks) else float(at_peaks)
    return figures | {"peaks_error_n": known, "slowed": _slowed(scenario, path_s) if task.case.moving else None}


def _slowed(scenario: Scenario, path_s: Array) -> float | None:
    """Share of the wanted feed that was not driven [-]; the places on the path at the steps of the feed, shape (n,)."""
    planned = len(path_s) * scenario.simulation.timestep_s * scenario.process.feed_m_s
    return 1.0 - float(path_s[-1] - path_s[0]) / planned if len(path_s) > 1 else None


def _done(scenario: Scenario, place: Workplace, run: CellRun) -> bool:
    """Whether the hold or the feed went to its end; a feed of limited time ends when its time is over."""
    if scenario.experiment == "force":
        return hold_done(scenario, run) > 0.999
    fed = run.trace.phase == PROCESS
    limit = scenario.process.max_feed_s
    timed_out = limit > 0.0 and float(np.sum(fed)) * scenario.simulation.timestep_s >= 0.999 * limit
    return timed_out or path_done(place.path, run.trace.path_s_m[fed]) > 0.999


def _place_key(scenario: Scenario) -> Hashable:
    """What plan and reach depend on; feed and approach do not change the path."""
    part = replace(scenario.part, displacement_m=0.0, rotation_rad=0.0, form_error_m=0.0)
    forces = scenario.process.contact_force_n, scenario.head.stiffness_n_m
    return scenario.experiment, part, scenario.plan, scenario.pad, forces


class _Memory:
    """The last few things made, by key."""

    def __init__(self) -> None:
        self._made: dict[Hashable, Any] = {}

    def get(self, key: Hashable, make: Callable[[], T]) -> T:
        """What was made for a key before, or made now."""
        made: T = self._made.pop(key) if key in self._made else make()
        self._made[key] = made
        while len(self._made) > _KEPT:
            self._made.pop(next(iter(self._made)))
        return made


_PLACES, _PARTS = _Memory(), _Memory()

_NOTHING: Final[Row] = dict.fromkeys((*FIGURES, "peaks_error_n", "slowed")) | {"stable": False}


ROWS: Final = "rows.jsonl"

_PACKAGE: Final = Path(__file__).resolve().parent.parent
_NO_PART_IN_ROWS: Final = ("cli", "crew", "scoring/journal", "scoring/score", "analysis/score_plot")


class Journal:
    """The file of rows of one score folder."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / ROWS
        self._known = _read(self._file)

    def row(self, task: Task) -> Row | None:
        """The row of a task, if it was measured before."""
        return self._known.get(row_key(task))

    def add(self, task: Task, row: Row) -> None:
        """Append a row; the line is whole or it is not there."""
        key = row_key(task)
        line = json.dumps({"key": key, "row": plain(row)}, allow_nan=False) + "\n"
        with self._file.open("ab") as file:
            file.write(line.encode())
        self._known[key] = plain(row)


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep a second score out of a folder while the block runs (InputError there), where the system has file locks."""
    with (folder / ROWS).open("ab") as file:
        if not _lock(file.fileno()):
            raise InputError(f"another score is at work in '{folder}'. Wait for it, or choose another --out.")
        yield


def row_key(task: Task) -> str:
    """What a row depends on, as a hash: scenario, controller file and this package's source."""
    scenario = task.scenario
    digest = hashlib.sha256(_source_hash().encode())
    name = scenario.controller.name
    file = Path(name.rpartition(":")[0])
    if file.suffix == ".py" and file.is_file():
        # A file moved elsewhere is still the same controller.
        digest.update(file.read_bytes())
        name = f"{file.name}:{name.rpartition(':')[2]}"
    named = replace(scenario, controller=replace(scenario.controller, name=name))
    digest.update(to_toml(named).encode())
    digest.update(f"{task.case.name}|{task.entry.label}".encode())
    return digest.hexdigest()[:24]


def plain(row: Mapping[str, Any]) -> Row:
    """A row as JSON has it: what is not a finite number becomes null."""
    return {name: None if isinstance(v, float) and not math.isfinite(v) else v for name, v in row.items()}


def _read(file: Path) -> dict[str, Row]:
    """Rows by key; a torn last line is cut off the file, any other damaged line passed over."""
    if not file.exists():
        return {}
    data = file.read_bytes()
    whole = data[: data.rfind(b"\n") + 1]
    if len(whole) < len(data):
        with file.open("r+b") as opened:
            opened.truncate(len(whole))
    rows: dict[str, Row] = {}
    for line in whole.splitlines():
        try:
            entry = json.loads(line)
            rows[str(entry["key"])] = dict(entry["row"])
        except (ValueError, KeyError, TypeError):
            continue
    return rows


def _lock(descriptor: int) -> bool:
    try:
        import fcntl
    except ImportError:  # not on Windows
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@cache
def _source_hash() -> str:
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob("*.py")):
        name = path.relative_to(_PACKAGE).as_posix()
        if not name.startswith(_NO_PART_IN_ROWS):
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()
