"""What runs that are put side by side were asked to do, how each ended, and what they differ in (layer 8c)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from polish_sim.analysis.run_record import RunRecord
from polish_sim.config import Scenario

COMPARED: Final = ("seed", "controller")
"""What runs are put side by side for: differences there need no word."""


WHOLE: Final = "whole"


class Setting(NamedTuple):
    """One setting as a row of a table."""

    label: str
    unit: str
    shown: Callable[[Scenario], str]
    experiments: tuple[str, ...]
    """Where it has an effect."""


def _path(scenario: Scenario) -> str:
    planned = "around the rim" if scenario.experiment == "dual" else scenario.plan.pattern
    return Path(scenario.plan.file).name or planned


SETTINGS: Final = (
    Setting("part", "", lambda s: Path(s.part.file).name, ("force", "surface", "dual")),
    Setting("path", "", _path, ("surface", "dual")),
    Setting("step-over", "mm", lambda s: "-" if s.plan.file else f"{1e3 * s.plan.stepover_m:g}", ("surface",)),
    Setting("set force", "N", lambda s: f"{s.process.contact_force_n:g}", ("force", "surface", "dual")),
    Setting("feed", "mm/s", lambda s: f"{1e3 * s.process.feed_m_s:g}", ("arc", "surface", "dual")),
    Setting("controller", "", lambda s: Path(s.controller.name).name, ("arc", "force", "surface", "dual")),
    Setting("along", "", lambda s: Path(s.drag.follow).name or "the trial's moves", ("teach",)),
    Setting("mode", "", lambda s: s.guide.mode or ("default" if s.drag.follow else "every"), ("teach",)),
    Setting("seed", "", lambda s: str(s.seed), ("arc", "force", "surface", "dual", "teach")),
)


def setting_rows(records: Sequence[RunRecord]) -> list[list[str]]:
    """Rows of label, unit and a value for each run: what was asked, and at the end how the run ended."""
    experiments = {record.scenario.experiment for record in records}
    rows = [
        [setting.label, setting.unit, *(setting.shown(record.scenario) for record in records)]
        for setting in SETTINGS
        if experiments & set(setting.experiments)
    ]
    return [*rows, ["ended", "", *(ending(record) for record in records)]]


def ending(record: RunRecord) -> str:
    """How a run ended: ``whole``, or what cut it short and after which share of its path."""
    m = record.metrics
    done = m.get("path_done")
    if m.get("protective_stop"):
        how = "stopped"
    elif m.get("interrupted"):
        how = "interrupted"
    elif done is None or done >= 1.0:
        return WHOLE
    else:
        how = "cut short"
    return how if done is None else f"{how} at {100.0 * done:.1f}%"


def notes_of(records: Sequence[RunRecord]) -> list[str]:
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
    tables = [dict(_flat(scenario, "")) for scenario in scenarios]
    return [
        name
        for name in tables[0]
        if name.partition(".")[0] not in COMPARED and any(table[name] != tables[0][name] for table in tables)
    ]


def _flat(section: Any, place: str) -> Iterator[tuple[str, Any]]:
    for field in fields(section):
        value = getattr(section, field.name)
        if is_dataclass(value):
            yield from _flat(value, f"{place}{field.name}.")
        else:
            yield f"{place}{field.name}", value
