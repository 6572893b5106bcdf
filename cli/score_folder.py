"""The folder of a score: filled row by row, so that a score that was broken off goes on in it."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from polish_sim.errors import InputError
from polish_sim.scoring import locked

KIND: Final = Path("results") / "score"
ASKED: Final = "asked.json"
"""What the score in the folder is of."""
_OWN: Final = "rows.jsonl"


@contextmanager
def open_folder(out: Path | None, asked: Mapping[str, Any], overwrite: bool = False) -> Iterator[Path]:
    """Make the folder of a score, or take up one that the same score has begun, and keep others out while it is filled.

    Args:
        out: The folder asked for; None means a new ``results/score/<yyyymmdd-hhmmss>``.
        asked: What the score is of, by name: only the same one is continued.
        overwrite: Whether another score may be replaced.

    Yields:
        The folder, existing and locked.

    Raises:
        InputError: If it holds something else, another score is at work there, or it cannot be written.
    """
    folder = out if out is not None else _unused(KIND / datetime.now().strftime("%Y%m%d-%H%M%S"))
    if folder.exists() and not folder.is_dir():
        raise InputError(f"'{folder}' exists and is not a folder. Choose another with --out.")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / _OWN).exists():
        raise InputError(f"'{folder}' holds something that is not a score. Choose another folder with --out.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / _OWN).touch()
    except OSError as error:
        raise InputError(f"cannot write in '{folder}': {error.strerror}. Choose another folder with --out.") from error
    with locked(folder):
        if not overwrite:
            _refuse_another(folder, asked)
        put(folder, ASKED, json.dumps(asked, indent=1) + "\n")
        yield folder


def put(folder: Path, name: str, content: str | bytes) -> None:
    """Write a file of the score; it appears when it is whole."""
    draft = folder / f".{name}.part"
    draft.write_bytes(content.encode() if isinstance(content, str) else content)
    os.replace(draft, folder / name)


def _refuse_another(folder: Path, asked: Mapping[str, Any]) -> None:
    """Refuse a folder in which another score was begun."""
    begun = _begun(folder)
    if begun is None or begun == asked:
        return
    raise InputError(
        f"'{folder}' holds another score: {_difference(begun, asked)}. Choose another folder with --out, or add "
        "--overwrite to replace it; runs that both have are kept."
    )


def _begun(folder: Path) -> Mapping[str, Any] | None:
    """What the score in a folder is of; None if there is none yet, nothing known if it cannot be read."""
    if not (folder / _OWN).stat().st_size and not (folder / ASKED).exists():
        return None
    try:
        begun = json.loads((folder / ASKED).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return begun if isinstance(begun, dict) else {}


def _difference(begun: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """The first thing in which two scores differ, in words."""
    if begun.get("of") != asked["of"]:
        return f"a {begun['of']}, not a {asked['of']}" if "of" in begun else "what it is of is not known"
    for name in ("controllers", "cases", "seeds"):
        if begun.get(name) != asked.get(name):
            return f"its {name} are {_listed(begun.get(name))}, not {_listed(asked.get(name))}"
    return "a controller's file or settings, or this program, have changed since it was begun"


def _listed(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


def _unused(folder: Path) -> Path:
    candidate, count = folder, 1
    while candidate.exists():
        count += 1
        candidate = folder.with_name(f"{folder.name}-{count}")
    return candidate
