"""Every error a user can cause or meet, each saying what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from decimal import Decimal
from errno import EINVAL
from importlib import import_module
from math import isfinite
from pathlib import Path
from typing import Any, SupportsFloat

LARGEST = 1e12  #: No quantity a user gives is larger, in whatever unit


class PolishSimError(Exception):
    """Base of all errors the command line turns into one message and an exit code."""

    exit_code = 2


class InputError(PolishSimError):
    """A file, an argument or a folder that cannot be used as given."""


class ConfigError(PolishSimError):
    """A scenario that cannot be run: an unknown key, a wrong type or a value outside its physical limits."""


class MeshError(PolishSimError):
    """A part's mesh that cannot be read or is not a surface one could polish."""


class PlanError(PolishSimError):
    """A part and a plan request that do not fit each other."""


class ReachError(PolishSimError):
    """A path the robot cannot follow; names the first bad point."""


class SmoothingError(PolishSimError):
    """No smooth motion satisfies these way points and limits; names the place."""


class CalibrationError(PolishSimError):
    """Poses or readings from which the unknowns cannot be found; says what is missing."""


class IdentificationError(PolishSimError):
    """A motion or a log from which a robot's dynamics cannot be found; names what stays unknown."""


class ProtectiveStop(PolishSimError):
    """The simulated robot stopped itself; what was recorded up to then is kept."""

    exit_code = 3


@contextmanager
def named_place(place: str) -> Iterator[None]:
    """Put a place, as of a job or a file, before the errors of the block."""
    try:
        yield
    except PolishSimError as error:
        raise type(error)(f"{place}: {error}") from error


def needed(module: str, what: str, extra: str) -> Any:
    """An optional module; InputError naming the ``extra`` that installs it and ``what`` needs it."""
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(f"{what}: pip install 'polish-sim[{extra}]'.") from error


def unknown_name(
    kind: str, name: str, known: Iterable[str], others: Mapping[str, str] | None = None
) -> InputError:
    """The error for a name of a kind, e.g. "controller", that is not known, with the nearest valid name and
    the list of all.

    ``others``: other words for some of them, e.g. ``{"metre": "m"}``.
    """
    names = sorted(known)
    meant = (others or {}).get(name.lower(), "")
    guess = f" Did you mean '{meant}'?" if meant else did_you_mean(name, names)
    return InputError(f"unknown {kind} '{name}'.{guess} Known: {', '.join(names)}.")


def check_name(kind: str, name: str, known: Collection[str], others: Mapping[str, str] | None = None) -> None:
    """Refuse a name that is not known, as `unknown_name` says."""
    if name not in known:
        raise unknown_name(kind, name, known, others)


def first_twice(names: Sequence[str]) -> str:
    """The first of some names that stands among them more than once; empty if none does."""
    return next((name for name in names if names.count(name) > 1), "")


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name that is most like another one, whatever their capitals; empty if none is near."""
    from difflib import get_close_matches

    by_lower = {word.lower(): word for word in reversed(list(known))}
    near = get_close_matches(name.lower(), by_lower, 1, 0.6)
    return by_lower[near[0]] if near else ""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Ask whether the nearest of the known names was meant, beginning with a space; empty if none is near."""
    near = nearest(name, known)
    return f" Did you mean '{near}'?" if near else ""


def regular(file: Path) -> Path:
    """The path of a file that is about to be read; OSError for a pipe or a device, which may never end."""
    if not file.is_file() and not file.is_dir() and file.exists():
        raise OSError(EINVAL, "Not a regular file")
    return file


def read_bytes(file: Path, what: str, error: type[PolishSimError] = InputError) -> bytes:
    """The content of a user's file; the ``error`` of its kind, e.g. "study", if it cannot be read."""
    try:
        return regular(file).read_bytes()
    except OSError as caught:
        raise error(f"cannot read the {what} '{file}': {caught.strerror}.{near_file(file)}") from caught


def near_file(path: Path) -> str:
    """Ask whether a file of nearly that name was meant, beginning with a space; empty if there is none,
    or the file is there and cannot be read."""
    if path.exists() or path.is_symlink():
        return ""
    try:
        names = [entry.name for entry in path.parent.iterdir() if not entry.name.startswith(".")]
    except OSError:
        return ""
    return did_you_mean(path.name, [name for name in names if nearest(path.stem, [Path(name).stem])])


def number_text(value: float, digits: int = 6) -> str:
    """Write a number as people do, 60000 or 0.0002; with an exponent only where it is below 0.0001."""
    if isinstance(value, float) and (not isfinite(value) or 0.0 < abs(value) < 1e-4):
        return f"{value:.{digits}g}"
    text = format(Decimal(str(value)) if isinstance(value, int) else Decimal(f"{value:.{digits}g}"), "f")
    return text if len(text) <= 24 else f"{text[:6]}... ({len(text)} digits)"


def count_text(count: int, noun: str) -> str:
    """A count with its noun: ``1 run``, ``2 runs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def duration_text(seconds: float) -> str:
    """A time as people say it."""
    for unit, size in (("h", 3600.0), ("min", 60.0)):
        if seconds >= 1.5 * size:
            return f"{number_text(seconds / size, 2)} {unit}"
    return f"{max(1, round(seconds))} s"


def leave_out(names: Sequence[str], why: str) -> str:
    """Name options that have no effect and say to leave them out, singular or plural."""
    return f"{', '.join(names)} {why}: leave {'it' if len(names) == 1 else 'them'} out."


def refuse_idle(named: Mapping[str, str], options: Iterable[str], where: str) -> None:
    """Refuse those of some options that are given ``where`` they change nothing (InputError); ``named``: as
    the user said each."""
    if idle := [named[option] for option in options if option in named]:
        raise InputError(leave_out(idle, f"would change nothing {where}"))


def place_in_mm(point: Iterable[SupportsFloat]) -> str:
    """Write a point [m] as messages give places and options take them: ``(12.5, 0, -3.14) mm``."""
    # Adding zero turns -0.0 into 0.0.
    return "(" + ", ".join(f"{round(1e3 * float(value), 2) + 0.0:.12g}" for value in point) + ") mm"
