"""Runs of a study as rows on disk: each is appended as it comes, and the table of all is written anew now and
then."""

from __future__ import annotations

import json
import platform
import statistics
import time
from collections import Counter, deque
from collections.abc import Mapping
from functools import cache, partial
from pathlib import Path
from typing import Any

from polish_sim.analysis.run_record import write_record
from polish_sim.config import Scenario
from polish_sim.errors import InputError, PolishSimError
from polish_sim.exchange import read_cuts, read_path
from polish_sim.experiments.assembly import Memory, config_hash, place_key
from polish_sim.experiments.registry import experiment, run_experiment
from polish_sim.planning import PlanResult, measure_given_path
from polish_sim.row_file import Metrics, Row, Rows, package_versions, whole_file, whole_folder, write_metrics
from polish_sim.source_stamp import package_hash
from polish_sim.studies.study import Study, StudyRun
from polish_sim.workers import Runner, local_copy

RUNS = "runs.parquet"
RUN_FOLDERS = "runs"  #: Of logs, where they are wanted
OUTCOMES = DONE, STOPPED, FAILED, LOST = "done", "stopped", "failed", "lost"
_NOT_FIGURES = (
    "protective_stop",
    "protective_stop_at",
    "T_base_work",
    "wall_s",
    "real_time_factor",
    "seed",
)
_PAUSE_S = 60.0  #: Between two writings of the table, at least
_SHARE = 50.0  #: Pause over the time one takes, at least

_PLANS = Memory()
StudyTask = tuple[str, StudyRun]  #: The hash of a run's config, and the run
Keys = dict[StudyTask, str]


def run_row(study: Study, logs: Path | None, task: StudyTask) -> Row:
    """Simulate one run and give its row; a run that cannot be done says why. ``logs``: where its folder
    goes."""
    key, run = task
    begun = time.perf_counter()
    row = begun_row(study, task) | {"outcome": FAILED, "reason": None}
    try:
        scenario = study.scenario(run)
        plan = (
            _given_plan(scenario)
            if scenario.plan.file and experiment(scenario.experiment).along_plan
            else None
        )
        result = run_experiment(scenario, plan)
    except PolishSimError as error:
        row["reason"] = str(error)
    except Exception as error:  # one run must not end the others
        row["reason"] = f"a bug in polish-sim or in an own controller: {type(error).__name__}: {error}"
    else:
        if result.interrupted:
            raise KeyboardInterrupt
        if logs is not None:
            with whole_folder(logs / key) as folder:
                write_record(folder, result.record)
        row |= {
            "outcome": STOPPED if result.stop_reason else DONE,
            "reason": result.stop_reason,
        }
        row |= {name: v for name, v in result.figures.items() if name not in _NOT_FIGURES and _is_cell(v)}
        row["loop_wall_s"] = result.figures["wall_s"]
    wall = time.perf_counter() - begun
    return row | {
        "wall_s": wall,
        "host": platform.node(),
        "versions": ", ".join(f"{name} {number}" for name, number in package_versions().items()),
        "source": package_hash()[:12],
    }


def begun_row(study: Study, task: StudyTask) -> Row:
    """What is known of a run before it is done."""
    key, run = task
    values = {axis.key: _cell(value) for axis, value in zip(study.axes, run.values, strict=True)}
    return {"config_hash": key, "seed": run.seed, **values}


def run_time(row: Row) -> float:
    """How long a run takes where plan and place are known [s]."""
    return min(row["wall_s"], 1.4 * (row.get("loop_wall_s") or row["wall_s"]) + 0.05)


def _given_plan(scenario: Scenario) -> PlanResult:
    """The plan of a path's file, measured once a process."""

    def measured() -> PlanResult:
        file = Path(local_copy(scenario.plan.file))
        return measure_given_path(read_path(file), *scenario.planned_by, cuts=read_cuts(file))

    return _PLANS.get(place_key(scenario), measured)


def _is_cell(value: Any) -> bool:
    return value is None or isinstance(value, (bool, int, float, str))


def _cell(value: Any) -> Any:
    return value if _is_cell(value) else json.dumps(value)


class RunTable(Rows):
    """The rows of one sweep's folder; of each its outcome is in memory, by the hash of the run's config."""

    needed = frozenset({"config_hash", "outcome", "seed"})

    def __init__(self, folder: Path) -> None:
        self._written_at, self._took_s = time.monotonic(), 0.0
        self._times: deque[float] = deque(maxlen=100)  #: Of the last runs [s]
        self.sources: set[str] = set()  #: Versions of this package that rows are of
        super().__init__(folder)

    def missing(self, keys: Mapping[Any, str]) -> list[Any]:
        """The runs that are to be done: those that were lost as well."""
        return [run for run, key in keys.items() if self.known.get(key, LOST) == LOST]

    def add(self, key: str, row: Metrics) -> None:
        """Append a row, and write the table if that was long ago."""
        super().add(key, row)
        if time.monotonic() - self._written_at > max(_PAUSE_S, _SHARE * self._took_s):
            self.write()

    def write(self) -> None:
        """Write `RUNS` from all rows; the file is replaced when it is whole."""
        begun = time.monotonic()
        write_parquet(self, self.folder / RUNS)
        self._written_at, self._took_s = time.monotonic(), time.monotonic() - begun

    def note(self, key: str, row: Row) -> None:
        """Keep the outcome, and how long the run took."""
        self.known[key] = str(row.get("outcome"))
        self.sources.add(str(row.get("source")))
        if row.get("wall_s"):
            self._times.append(run_time(row))

    @property
    def run_s(self) -> float | None:
        """How long a run takes [s]; None before there is one."""
        return statistics.median(self._times) if self._times else None


def write_parquet(rows: Rows, table: Path) -> None:
    """Turn rows into a Parquet file, one row a key, the last one."""
    import pyarrow as pa
    import pyarrow.json as lines
    import pyarrow.parquet as parquet

    if rows.damaged:
        flat = pa.Table.from_struct_array(pa.array(list(dict(rows.read()).values())))
    else:  # many rows take less memory so
        try:
            read = lines.read_json(rows.path, lines.ReadOptions(block_size=16 << 20))
        except pa.ArrowInvalid as error:  # of a version that wrote no check sums
            raise InputError(f"a row in '{rows.path}' was edited: {error}. Delete its line.") from error
        # A key is there twice where a run was lost and done again later.
        last = {key: place for place, key in enumerate(read["key"].to_pylist())}
        read = read.take(pa.array(sorted(last.values()))) if len(last) < len(read) else read
        flat = read.select(["row"]).flatten()
        flat = flat.rename_columns([name.removeprefix("row.") for name in flat.column_names])
    with whole_file(table) as draft:
        parquet.write_table(flat, draft, compression="zstd")


def read_rows(folder: Path) -> dict[str, Any]:
    """The columns of a sweep's `RUNS`, as lists.

    Raises:
        InputError: If there is none.
    """
    import pyarrow.parquet as parquet

    file = folder / RUNS
    if not file.is_file():
        raise InputError(f"'{folder}' holds no {RUNS}: it is not the folder of a sweep.")
    return dict(parquet.read_table(file).to_pydict())


def run_study(study: Study, keys: Keys, logs: bool, runner: Runner) -> Metrics:
    """Do the runs of `keys_of_runs` that the folder's `RunTable` does not have, and write it and a summary.

    Raises:
        WorkersError: If processes die one after the other, or the cluster is gone.
    """
    table = runner.kept
    assert isinstance(table, RunTable)
    folders = table.folder.resolve() / RUN_FOLDERS if logs else None
    if folders is not None:
        folders.mkdir(exist_ok=True)
    work = partial(run_row, study, folders)

    @cache
    def group_of_point(values: tuple[Any, ...]) -> int:
        """Of runs with one plan; found once for each point."""
        return hash(place_key(study.scenario(StudyRun(values, study.base.seed))))

    def lost(task: StudyTask, trouble: str) -> Row:
        return begun_row(study, task) | {"outcome": LOST, "reason": trouble}

    try:
        runner.fill(keys, work, lambda task: group_of_point(task[1].values), lost)
    finally:
        if table.known:
            table.write()
            facts = write_summary(table, study, len(keys))
    return facts


def keys_of_runs(study: Study) -> Keys:
    """The runs of a study with the hashes of their configs, which are their keys as well."""
    hashes: dict[Path, str] = {}
    wanted = {config_hash(study.scenario(run), hashes): run for run in study.runs()}
    return {(key, run): key for key, run in wanted.items()}


def write_summary(table: RunTable, study: Study, total: int) -> Metrics:
    """Write metrics.json: how many runs ended how."""
    ended = Counter(table.known.values())
    facts = {
        "experiment": study.base.experiment, "runs": len(table.known),
        **{outcome: ended[outcome] for outcome in OUTCOMES},
        "wanted": total, "vary": {axis.key: axis.text for axis in study.axes},
    }  # fmt: skip
    write_metrics(table.folder, facts)
    return facts
