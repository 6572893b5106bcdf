"""A run as it lies on disk: config.toml, metrics.json, log.npz and the path; written and read back (layer 8c)."""

from __future__ import annotations

import json
import math
import platform
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from polish_sim.config import Scenario
from polish_sim.errors import InputError
from polish_sim.log import RunLog, read_log, write_log
from polish_sim.planning.toolpath import ToolPath
from polish_sim.removal import RemovalMap, read_removal, write_removal
from polish_sim.scenario_file import load_scenario, to_toml

CONFIG, METRICS, LOG, PATH = "config.toml", "metrics.json", "log.npz", "path.npz"
REMOVAL = "removal.npz"
VERSIONED = ("polish-sim", "mujoco", "numpy", "scipy", "numba", "trimesh")


@dataclass(frozen=True)
class RunRecord:
    """Everything a run leaves behind."""

    name: str
    """What the run is called in titles and legends: its folder's name."""
    scenario: Scenario
    metrics: Mapping[str, Any]
    """Figures as in the contract; an undefined one is NaN."""
    log: RunLog
    path: ToolPath | None
    """The path that was run; None for experiments without a part."""
    removal: RemovalMap | None = None
    """What the run took off the part, if that was measured."""


def write_record(folder: Path, record: RunRecord) -> None:
    """Write the files of a run into an existing folder."""
    (folder / CONFIG).write_text(to_toml(record.scenario), encoding="utf-8")
    write_json(folder / METRICS, record.metrics)
    write_log(folder / LOG, record.log)
    if record.path is not None:
        columns = {name: column for name, column in vars(record.path).items() if column is not None}
        np.savez_compressed(folder / PATH, allow_pickle=False, **columns)
    if record.removal is not None:
        write_removal(folder / REMOVAL, record.removal)


def read_record(folder: Path) -> RunRecord:
    """Read a run back.

    Raises:
        InputError: If the folder is not a run's, or a file in it is damaged.
    """
    missing = [name for name in (CONFIG, METRICS, LOG) if not (folder / name).is_file()]
    if missing:
        raise InputError(f"'{folder}' is not a run folder: it lacks {', '.join(missing)}. Give a folder made by 'run'.")
    scenario = load_scenario(folder / CONFIG, Scenario())
    path = _read_path(folder / PATH) if (folder / PATH).is_file() else None
    removal = read_removal(folder / REMOVAL) if (folder / REMOVAL).is_file() else None
    name, metrics, log = folder.resolve().name, read_json(folder / METRICS), read_log(folder / LOG)
    return RunRecord(name, scenario, metrics, log, path, removal)


def read_records(folders: Sequence[Path]) -> list[RunRecord]:
    """Read runs back under names that tell them apart: their folders' own, or as they are given where these repeat.

    Raises:
        InputError: If a folder is not a run's, or a file in it is damaged.
    """
    records = [read_record(folder) for folder in folders]
    names = [record.name for record in records]
    if len(set(names)) < len(names):
        names = [str(folder) for folder in folders]
    if len(set(names)) < len(names):
        names = [f"{name} #{number}" for number, name in enumerate(names, 1)]
    return [replace(record, name=name) for record, name in zip(records, names, strict=True)]


def write_json(file: Path, figures: Mapping[str, Any]) -> None:
    """Write figures as strict JSON: what is not a finite number becomes null."""
    file.write_text(json.dumps(_plain(figures), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def read_json(file: Path) -> dict[str, Any]:
    """Read figures written by ``write_json``."""
    try:
        figures = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read '{file}': {error}.") from error
    if not isinstance(figures, dict):
        raise InputError(f"'{file}' does not hold figures by name.")
    return figures


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages a run's numbers depend on."""
    return {"python": platform.python_version()} | {name: version(name) for name in VERSIONED}


def _read_path(file: Path) -> ToolPath:
    try:
        with np.load(file, allow_pickle=False) as archive:
            return ToolPath(**{name: archive[name] for name in archive.files})
    except (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"cannot read the path '{file}': {error}.") from error


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
