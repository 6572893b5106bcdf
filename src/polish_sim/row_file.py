"""Files a killed command does not spoil: those that appear when they are whole, and rows as they come.

Rows are on disk one line each, so that interrupted work resumes.
"""

from __future__ import annotations

import json
import math
import platform
import shutil
import warnings
import zlib
from collections.abc import Iterator, Mapping
from collections.abc import Set as AbstractSet
from contextlib import contextmanager
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polish_sim.errors import InputError, regular

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROWS = "rows.jsonl"
METRICS = "metrics.json"
Row = dict[str, Any]
QUICK_PNG: Row = {"compress_type": zlib.Z_RLE}  #: A picture takes half the time, at most a fifth more room
VERSIONED = ("polish-sim", "mujoco", "numpy", "scipy", "numba", "trimesh")
Metrics = Mapping[str, Any]  #: By name, as in metrics.json; an undefined one is None or NaN


@contextmanager
def whole_file(file: Path) -> Iterator[Path]:
    """A draft to write in the block; it gets the file's name at its end, and is deleted if it fails."""
    draft = file.with_name(f".part-{file.name}")
    try:
        yield draft
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)


def put_file(folder: Path, name: str, content: str | bytes) -> None:
    """Write a file; it appears when it is whole."""
    with whole_file(folder / name) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A draft to fill in the block, instead of what was there; it gets the folder's name when it is whole.

    Raises:
        InputError: If the folder it goes into is not there, as on another machine.
    """
    draft = folder.with_name(f".part-{folder.name}")
    shutil.rmtree(draft, ignore_errors=True)
    try:
        draft.mkdir()
    except FileNotFoundError as error:
        raise InputError(
            f"no folder '{folder.parent}' where a worker is: name one that all machines share with --out."
        ) from error
    try:
        yield draft
        shutil.rmtree(folder, ignore_errors=True)
        draft.rename(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


# Figures and pictures in a folder.


def write_json(file: Path, figures: Metrics) -> None:
    """Write figures as strict JSON: what is not a finite number becomes null."""
    put_file(file.parent, file.name, json.dumps(plain(figures), indent=2, allow_nan=False) + "\n")


def write_metrics(folder: Path, figures: Metrics) -> None:
    """Write a folder's metrics.json: figures, and the versions they depend on."""
    write_json(folder / METRICS, {**figures, "versions": package_versions()})


def read_json(file: Path, again: str = "Make it again.") -> dict[str, Any]:
    """Read figures written by ``write_json``; InputError if it cannot be, and what to do ``again``."""
    try:
        return {**json.loads(regular(file).read_text(encoding="utf-8"))}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"cannot read '{file}': {error}. {again}") from error


def check_forms(values: Metrics, forms: Mapping[str, Any], file: Path, again: str) -> None:
    """Refuse entries of a ``file`` that do not have their form (InputError); what is missing or null passes.

    A form is ``str``, ``float``, numbers in a tuple of a length, a list, entries by name (`...`: of any), or
    a function that says so; ``again`` says what to do.
    """
    for name, form in forms.items():
        if not (values.get(name) is None or fits(values[name], form)):
            raise InputError(f"'{name}' in '{file}' is not as it was written. {again}")


def fits(value: Any, form: Any) -> bool:
    """Whether what was read has a form of `check_forms`."""
    if isinstance(form, dict):
        own = dict.fromkeys(value, form[...]) if ... in form and isinstance(value, dict) else form
        return isinstance(value, dict) and all(fits(value.get(name), part) for name, part in own.items())
    if isinstance(form, (list, tuple)):
        forms = form if isinstance(form, tuple) or not isinstance(value, list) else form * len(value)
        return isinstance(value, list) and len(value) == len(forms) and all(map(fits, value, forms))
    if not isinstance(form, type):
        return bool(form(value))
    kinds: Any = (int, form)
    return isinstance(value, str) if form is str else isinstance(value, kinds) and math.isfinite(value)


@cache
def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages a run's numbers depend on."""
    return {"python": platform.python_version()} | {name: version(name) for name in VERSIONED}


def save_plots(folder: Path, plots: Mapping[str, Figure]) -> None:
    """Save figures under their file names; each file appears when it is whole."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import

    for name, figure in plots.items():
        with whole_file(folder / name) as draft, warnings.catch_warnings():
            # A name in a script that no installed font has is drawn as boxes.
            warnings.filterwarnings("ignore", message="Glyph")
            # As `savefig` does, which draws twice.
            FigureCanvasAgg(figure).print_png(draft, pil_kwargs=QUICK_PNG)  # type: ignore[no-untyped-call]


# Rows.


class Rows:
    """The rows of one folder, on disk and in memory, each with a key that says what it depends on."""

    needed: AbstractSet[str] = frozenset()  #: What every row has

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / ROWS
        self.known: dict[str, Any] = {}
        self.damaged = False  #: Whether there were lines that do not count
        for key, row in self.read():
            self.note(key, row)

    def note(self, key: str, row: Row) -> None:
        """Keep in memory what is wanted of a row."""
        self.known[key] = row

    def missing(self, keys: Mapping[Any, str]) -> list[Any]:
        """The tasks, named with their ``keys``, that are to be done."""
        return [task for task, key in keys.items() if key not in self.known]

    def read(self) -> Iterator[tuple[str, Row]]:
        """Keys and rows; a line that was damaged or edited is passed over."""
        if not self.path.exists():
            return
        with self.path.open("rb") as lines:
            for line in lines:
                try:
                    entry = json.loads(line)
                    key, row = str(entry["key"]), dict(entry["row"])
                    whole = entry.get("sum", check_sum(row)) == check_sum(row) and self.needed <= row.keys()
                except (ValueError, KeyError, TypeError, RecursionError):
                    whole = False
                if whole:
                    yield key, row
                self.damaged |= not whole

    def add(self, key: str, row: Metrics) -> None:
        """Append a row; the line is whole or, when next read, it is not there."""
        kept = plain(row)
        line = json.dumps({"key": key, "row": kept, "sum": check_sum(kept)}, allow_nan=False) + "\n"
        try:
            with self.path.open("ab") as file:
                file.write(line.encode())
        except OSError:  # no room
            _cut_torn_line(self.path)
            raise
        self.note(key, kept)


def check_sum(value: Any) -> int:
    """A number that changes with an edit of a value that JSON has."""
    return zlib.crc32(json.dumps(value).encode())


def plain(value: Any) -> Any:
    """Values as JSON has them: arrays as lists, what is not a finite number as null."""
    if isinstance(value, Mapping):
        return {str(name): plain(entry) for name, entry in value.items()}
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def locked(file: Path, what: str = "score") -> Iterator[None]:
    """Keep a second command out of a file's folder while the block runs (InputError), where the system has
    file locks. What a killed command left of a line is cut off."""
    with file.open("ab") as opened:
        if not lock(opened.fileno()):
            raise InputError(
                f"another {what} is at work in '{file.parent}'. Wait for it, or choose another --out."
            )
        _cut_torn_line(file)
        yield


def _cut_torn_line(file: Path) -> None:
    """Cut off what a killed command left of a line."""
    if not file.exists():
        return
    with file.open("r+b") as opened:
        opened.truncate(sum(len(line) for line in opened if line.endswith(b"\n")))


def lock(descriptor: int) -> bool:
    """Keep others from locking an open file until it is closed; whether nobody else had."""
    try:
        import fcntl
    except ImportError:  # not on Windows
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
