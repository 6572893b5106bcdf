"""The rows of a score on disk, one line each as they come, so that a broken-off score goes on where it was (layer 10).

A line counts as long as the key beside it is the key of the row that is wanted: the whole scenario, the user's
controller file and the package's own source enter it. Change any of them, and the row is measured anew.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

from polish_sim.errors import InputError
from polish_sim.scenario_file import to_toml
from polish_sim.scoring.row import Row, Task

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
    """Keep a second score out of a folder while the block runs, where the system has file locks.

    Raises:
        InputError: If another score is at work there.
    """
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
