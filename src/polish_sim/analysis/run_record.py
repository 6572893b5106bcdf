"""A run as it lies on disk: config.toml, metrics.json, log.npz and the path; written and read back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from polish_sim.analysis.claim import figure_of
from polish_sim.arms import FIRST, IDEAL
from polish_sim.arrays import Array
from polish_sim.config import Scenario
from polish_sim.errors import InputError, first_twice, number_text
from polish_sim.log import (
    FORGET,
    RemovalMap,
    RunLog,
    check_names,
    read_arrays,
    read_log,
    read_removal,
    write_arrays,
    write_log,
    write_removal,
)
from polish_sim.planning.toolpath import ToolPath, interpolate
from polish_sim.row_file import METRICS, Metrics, check_forms, fits, put_file, read_json, write_json
from polish_sim.scenario_file import AUTO, leaves, load_scenario, override, to_toml
from polish_sim.toml_text import toml_value

CONFIG, LOG, PATH = "config.toml", "log.npz", "path.npz"
REMOVAL = "removal.npz"


FORMS: Mapping[str, Any] = {
    "seed": float,
    "protective_stop": str,
    "protective_stop_at": {"name": str, "time_s": float, "path_s_m": float, "tool_m": (float,) * 3},
    "T_base_work": lambda value: fits(value, ((float,) * 4,) * 4) and np.linalg.det(value) > 0.5,
    "versions": {},
    "bad_figures": [str],
    "files": [str],
}
"""What figures of every run that are not one number look like, as of `check_forms`."""
WITHOUT = "Delete the entry to see the run without it."


@dataclass(frozen=True)
class RunRecord:
    """Everything a run leaves behind."""

    name: str  #: What the run is called in titles and legends: its folder's name
    scenario: Scenario
    metrics: Metrics  #: Figures as in the contract; an undefined one is NaN
    log: RunLog
    path: ToolPath | None  #: The path that was run; None for experiments without a part
    removal: RemovalMap | None = None  #: What the run took off the part, if that was measured

    def fed(self, name: str) -> Array:
        """A column of the log while the tool is fed, in double precision, shape (n,) or (n, k)."""
        return self.log[name][self.log.fed]

    def while_fed(self, name: str) -> Array:
        """A column of the log, no numbers while the tool is not fed, so that lines break there."""
        values = self.log[name].copy()
        values[~self.log.fed] = np.nan
        return values


Records = Sequence[RunRecord]


class StopMark(NamedTuple):
    """When and where a run stopped itself."""

    name: str
    time: float  #: [s]
    s: float  #: Along the path [m]
    tool: Array  #: The tool point, base frame [m], shape (3,)

    @property
    def text(self) -> str:
        """What stands beside its mark."""
        return f"protective stop at {self.time:.2f} s: {self.name}"

    def on_path(self, path: ToolPath) -> Array:
        """Its place on a path, and so on the part as it was planned [m], shape (3,)."""
        return interpolate(np.array([self.s]), path.s, path.positions_work)[0]


def stop_mark(metrics: Metrics) -> StopMark | None:
    """When and where a run with these figures stopped itself; None if it did not, or does not say (older
    runs)."""
    at = metrics.get("protective_stop_at")
    return StopMark(at["name"], at["time_s"], at["path_s_m"], np.array(at["tool_m"])) if at else None


def write_record(folder: Path, record: RunRecord) -> None:
    """Write the files of a run into an existing folder, the figures last: with them it is whole."""
    put_file(folder, CONFIG, to_toml(record.scenario))
    write_log(folder / LOG, record.log)
    if record.path:
        write_arrays(folder / PATH, record.path.columns)
    if record.removal:
        write_removal(folder / REMOVAL, record.removal)
    write_json(folder / METRICS, record.metrics)


def read_record(folder: Path) -> RunRecord:
    """Read a run back; InputError if the folder is not a run's, or a file in it is damaged."""
    metrics = read_json(folder / METRICS) if (folder / METRICS).is_file() else {}
    check_forms(metrics, FORMS, folder / METRICS, WITHOUT)
    files = (CONFIG, METRICS, LOG, *(metrics.get("files") or ()))
    if missing := [name for name in files if not (folder / name).is_file()]:
        if seeds := sorted(folder.glob("seed-*")):
            raise InputError(
                f"'{folder}' is a folder of many seeds. Give that of one or more, e.g. '{seeds[0]}'."
            )
        raise InputError(
            f"'{folder}' is not a run folder: it lacks {', '.join(missing)}. Give a whole one made by 'run'."
        )
    scenario = load_scenario(folder / CONFIG, replace(Scenario(), experiment=""))
    if not scenario.experiment:
        raise InputError(f"'{folder / CONFIG}' is not the config of a run: it names no experiment.")
    path = None
    if (folder / PATH).is_file():
        path = read_arrays(folder / PATH, "path", f"Delete it, and {FORGET}", _path_of)
    removal = read_removal(folder / REMOVAL) if (folder / REMOVAL).is_file() else None
    return RunRecord(folder.resolve().name, scenario, metrics, read_log(folder / LOG), path, removal)


def read_records(folders: Sequence[Path]) -> list[RunRecord]:
    """Read runs back under distinct names: their folders' own, or as they are given where these
    repeat."""
    records = [read_record(folder) for folder in folders]
    names = [record.name for record in records]
    if first_twice(names):
        names = [str(folder) for folder in folders]
    if first_twice(names):
        names = [f"{name} #{number}" for number, name in enumerate(names, 1)]
    return [replace(record, name=name) for record, name in zip(records, names, strict=True)]


def _path_of(columns: dict[str, Any]) -> ToolPath:
    check_names(columns, [f.name for f in fields(ToolPath) if f.default is MISSING])
    path = ToolPath(**columns)
    if len(path.s) < 2:
        raise ValueError("it has fewer than two points")
    return path


# What runs that are put side by side were asked to do, how each ended, and what they differ in.

#: What runs are put side by side for: differences there need no word
COMPARED = ("seed", "controller")


WHOLE = "whole"


def ending(record: RunRecord) -> str:
    """How a run ended: ``whole``, or what cut it short and after which share of its path."""
    m = record.metrics
    done = figure_of(m, "path_done")
    if m.get("protective_stop"):
        how = "stopped"
    elif m.get("interrupted"):
        how = "interrupted"
    elif not done < 1.0:
        return WHOLE
    else:
        how = "cut short"
    return how if math.isnan(done) else f"{how} at {100.0 * done:.1f}%"


def notes_of(records: Records) -> list[str]:
    """What keeps the figures of some runs from being compared: other settings, a run that is not whole."""
    notes = []
    keys = differences([record.scenario for record in records])
    if keys:
        notes.append(
            "these runs were not given one and the same task: beside controller and seed they differ in "
            f"{', '.join(keys)}."
        )
    for record in records:
        if ending(record) != WHOLE:
            reason = record.metrics.get("protective_stop")
            why = f" ({reason.rstrip('.?')})" if reason else ""
            notes.append(f"'{record.name}' {ending(record)}{why}: its figures are of what it did until then.")
    return notes


def differences(scenarios: Sequence[Scenario]) -> list[str]:
    """Keys of the scenario, dotted, in which runs differ, but for seed and controller."""
    tables = [dict(leaves(scenario)) for scenario in scenarios]
    return [
        name
        for name in tables[0]
        if name.partition(".")[0] not in COMPARED and any(table[name] != tables[0][name] for table in tables)
    ]


def changed_settings(scenario: Scenario, usual: Scenario) -> list[list[str]]:
    """Rows of key, value and usual value of the settings, dotted, in which a scenario differs from another.

    A sensor or an arm given by its name counts by that name, and by what differs from the named one.
    """
    named = override(usual, [f"sensor.model={scenario.sensor.model}", f"robot.arm={scenario.robot.arm}"])
    theirs = dict(leaves(named)) | {"sensor.model": usual.sensor.model, "robot.arm": usual.robot.arm}
    return [
        [name, _text(value), _text(theirs.get(name, ""))]
        for name, value in leaves(scenario)
        if value != theirs.get(name)
    ]


CONDITIONS = (
    *("sensor", "robot", "head", "pad", "simulation", "faults", "spindle"),
    *("part.real_file", "part.displacement_m", "part.rotation_rad", "part.form_error_m", "part.motion_m"),
    *("dual.master_delay_s", "dual.master_rate_hz", "dual.tracker_noise_m", "dual.touch_noise_m"),
    *("dual.arm_length_error_m", "dual.arm_angle_error_rad"),
)
"""Sections and keys whose default values hold for every figure that is asked."""
CHOSEN = (
    "pad.radius_m",
    "pad.choice",
    "simulation.log_rate_hz",
    "spindle.speed_rpm",
    "robot.arm",
    "robot.compensation",
)  #: Of these what the user chooses


def other_conditions(scenario: Scenario, usual: Scenario) -> tuple[str, ...]:
    """Sensor, springs, latency and other conditions of a run that are not the ``usual`` ones of its
    experiment, each as a text."""
    arm = scenario.robot.arm
    make = () if arm in (IDEAL, FIRST) else (f"robot.arm = {arm} ({FIRST})",)
    return make + tuple(
        f"{name} = {value} ({asked})"
        for name, value, asked in changed_settings(scenario, usual)
        if {name, name.partition(".")[0]} & set(CONDITIONS) and name not in CHOSEN
    )


def changed_words(scenario: Scenario, usual: Scenario) -> list[str]:
    """``KEY=VALUE`` of every setting in which a scenario differs from another."""
    theirs = dict(leaves(usual))
    return [f"{name}={toml_value(value)}" for name, value in leaves(scenario) if value != theirs.get(name)]


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(number_text, value)) or AUTO
    return number_text(value) if isinstance(value, (int, float)) else str(value) or "none"
