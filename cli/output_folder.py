"""Where results go: a folder claimed before any work, filled under a temporary name, renamed when whole."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from polish_sim.cli import console
from polish_sim.errors import InputError
from polish_sim.row_file import METRICS, ROWS, lock, locked, put_file

RESULTS = Path("results")
SAME = "the same command with"
DRAFT = ".polish-sim-part"  #: Ending of the hidden folder a command fills; others with it are removed


READ = ("--path", "--task", "--beside")  #: Options that name a folder of ours to read


@dataclass(frozen=True)
class OutputFolder:
    """A claimed folder: write into ``draft``; its files appear at ``final`` when the claim ends well."""

    draft: Path
    final: Path


def refuse_taken(given: Mapping[str, Any], *read: Path | str) -> None:
    """Refuse an output folder that exists, is no folder or holds what is to be ``read``, or what options name
    to be read, before anything is; `claimed` does so as well."""
    out = given["--out"]
    if out and out.exists() and not (given["--overwrite"] and out.is_dir()):
        raise InputError(_taken(out))
    named = map(Path, filter(None, (*read, *map(given.get, READ))))
    folders = [file.parent if file.is_file() else file for file in named if file.exists()]
    if out and out.resolve() in map(Path.resolve, folders):
        raise InputError(f"--out '{out}' is read itself, and would be changed. Choose another.")


@contextmanager
def claimed(given: Mapping[str, Any], kind: str) -> Iterator[OutputFolder]:
    """Claim an output folder for a block of work; when the block raises, nothing is left behind, but for
    measured results whose pictures found no room.

    Without ``--out`` it is a new ``results/<kind>/<yyyymmdd-hhmmss>``; ``kind`` is command and experiment,
    e.g. ``run-surface``. With ``--overwrite`` files of the same names in an existing folder are replaced,
    others stay.

    Raises:
        InputError: At once, if the folder exists (without ``--overwrite``) or cannot be written.
    """
    refuse_taken(given)
    final = given["--out"] or unused(RESULTS / kind)
    with room_for(final):
        _sweep(final.parent)
        draft = _draft_of(final)
        with writing(final):
            held = _create_locked(draft)
        try:
            yield OutputFolder(draft, final)
            _publish(draft, final)
        except OSError:
            if (draft / METRICS).exists():  # whole, but for its pictures
                _publish(draft, final)
                console.note(f"what was measured is kept in '{final}'.")
            raise
        finally:
            shutil.rmtree(draft, ignore_errors=True)
            os.close(held)


def _draft_of(final: Path) -> Path:
    return final.parent / f".{final.name}{DRAFT}"


def _sweep(parent: Path) -> None:
    """Remove the drafts of commands that were killed; those of running ones are locked."""
    for draft in parent.glob(f".*{DRAFT}"):
        with suppress(OSError):  # locked, just finished, not ours to remove, or on Windows
            held = _locked(draft)
            shutil.rmtree(draft, ignore_errors=True)
            os.close(held)


def _create_locked(draft: Path) -> int:
    """Create a draft and lock it until the descriptor is closed or the process ends, however it does."""
    if os.name == "nt":  # no folder can be locked: drafts of killed commands stay
        draft.mkdir()
        return os.open(os.devnull, os.O_RDONLY)
    while True:
        try:
            draft.mkdir()
        except FileExistsError:
            raise InputError(
                f"another command is writing '{draft.name[1 : -len(DRAFT)]}'. Wait for it."
            ) from None
        try:
            held = _locked(draft)
        except (FileNotFoundError, BlockingIOError):
            continue  # another command swept it before it was locked
        if draft.exists() and os.path.samestat(draft.stat(), os.fstat(held)):
            return held
        os.close(held)


def _locked(folder: Path) -> int:
    """Open and lock a folder; OSError if it is locked, or gone."""
    descriptor = os.open(folder, os.O_RDONLY)
    if not lock(descriptor):
        os.close(descriptor)
        raise BlockingIOError
    return descriptor


def _publish(draft: Path, final: Path) -> None:
    if not final.exists():
        draft.rename(final)
        return
    for entry in sorted(draft.iterdir()):
        target = final / entry.name
        if target.is_dir():
            shutil.rmtree(target)
        entry.replace(target)
    draft.rmdir()


def unused(kind: Path) -> Path:
    """A new folder named by the time, or with -2, -3, ... when others of the same second took the name."""
    folder = kind / datetime.now().strftime("%Y%m%d-%H%M%S")
    candidate = folder
    count = 1
    while candidate.exists() or _draft_of(candidate).exists():
        count += 1
        candidate = folder.with_name(f"{folder.name}-{count}")
    return candidate


@contextmanager
def rows_folder(
    out: Path | None, kind: str, what: str, begin: Mapping[str, str], refuse: Callable[[Path], None]
) -> Iterator[Path]:
    """Make the folder of work kept row by row, or take up one where it was begun; others are kept out
    meanwhile.

    ``out`` None means a new ``results/<kind>/<yyyymmdd-hhmmss>``; ``what`` names the work, e.g. ``score``;
    ``begin``: files that say what it is of, as text by name; ``refuse`` raises where the folder holds other
    work. If the block raises before there is a row, nothing is left behind.

    Raises:
        InputError: If the folder holds something else, is in use, or cannot be written.
    """
    folder = out or unused(RESULTS / kind)
    made = not folder.exists()
    if folder.exists() and not folder.is_dir():
        raise InputError(_taken(folder))
    if folder.is_dir() and any(folder.iterdir()) and not (folder / ROWS).exists():
        held = "a single run" if (folder / "log.npz").exists() else f"something that is not a {what}"
        raise InputError(f"'{folder}' holds {held}. Choose another folder with --out.")
    with occupied(folder, ROWS, what):
        try:
            refuse(folder)
            for name, text in begin.items():
                put_file(folder, name, text)
            console.note(f"rows are kept in '{folder}'.")
            yield folder
        except BaseException as error:
            if made and not (folder / ROWS).stat().st_size:
                shutil.rmtree(folder, ignore_errors=True)
            elif isinstance(error, KeyboardInterrupt):
                raise KeyboardInterrupt(
                    f"interrupted: the rows so far are kept; {SAME} --out {folder} resumes."
                ) from error
            raise


@contextmanager
def occupied(folder: Path, name: str, what: str) -> Iterator[None]:
    """Make a folder unless it is there, and keep others out of it by a file in it.

    Raises:
        InputError: If it is in use, or cannot be written.
    """
    with room_for(folder):
        with writing(folder):
            folder.mkdir(exist_ok=True)
            (folder / name).touch()
        with locked(folder / name, what):
            yield


def _taken(folder: Path) -> str:
    if folder.is_dir():
        return (
            f"the output folder '{folder}' exists. Choose another with --out, or add --overwrite to "
            "replace its files."
        )
    return f"'{folder}' exists and is not a folder. Choose another with --out."


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Name a folder that cannot be written, and what to do (InputError)."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot write '{folder}': {error.strerror}. Choose another with --out.") from error


@contextmanager
def room_for(entry: Path) -> Iterator[None]:
    """Make the folders above a file or folder; if the block raises, those that are left empty go again, and
    an error of the system names it where that names nothing."""
    missing = [parent for parent in entry.absolute().parents if not parent.exists()]
    try:
        with writing(entry):
            entry.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException as error:
        if isinstance(error, OSError):
            error.filename = error.filename or str(entry)
        for parent in missing:
            with suppress(OSError):
                parent.rmdir()
        raise
