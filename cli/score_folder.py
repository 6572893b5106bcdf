"""The folder of a score: filled row by row, so that a score that was broken off goes on in it."""

from __future__ import annotations

import os
from datetime import datetime
from pathlib import Path
from typing import Final

from polish_sim.errors import InputError

KIND: Final = Path("results") / "score"
_OWN: Final = "rows.jsonl"


def open_folder(out: Path | None) -> Path:
    """Make the folder of a score, or take up one that a score has begun.

    Args:
        out: The folder asked for; None means a new ``results/score/<yyyymmdd-hhmmss>``.

    Returns:
        The folder, existing.

    Raises:
        InputError: If it holds something else, or cannot be written.
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
    return folder


def put(folder: Path, name: str, content: str | bytes) -> None:
    """Write a file of the score; it appears when it is whole."""
    draft = folder / f".{name}.part"
    draft.write_bytes(content.encode() if isinstance(content, str) else content)
    os.replace(draft, folder / name)


def _unused(folder: Path) -> Path:
    candidate, count = folder, 1
    while candidate.exists():
        count += 1
        candidate = folder.with_name(f"{folder.name}-{count}")
    return candidate
