"""The line of a job's or a tool's file that an error is about."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from polish_sim.errors import PolishSimError


@contextmanager
def naming_line(file: Path) -> Iterator[None]:
    """Put a file's name and the line before the errors of the block that have none yet."""
    try:
        yield
    except PolishSimError as error:
        if re.search(r"line \d+[,:)]", str(error)):
            raise
        text = file.read_text(encoding="utf-8", errors="replace")
        raise type(error)(f"{file}, line {line_of(str(error), text)}: {error}") from error


@contextmanager
def at(place: str) -> Iterator[None]:
    """Put a place of the job before the errors of the block."""
    try:
        yield
    except PolishSimError as error:
        raise type(error)(f"{place}: {error}") from error


def line_of(message: str, text: str) -> int:
    """Where the key or word stands that a message names first; without one, where the table it names
    begins."""
    lines = [line.partition("#")[0] for line in text.splitlines()]
    place = re.search(r"setup[ _](\d+)(?:.{1,12}?pass[ _](\d+))?", message)
    begin = 0
    for head, count in zip(("[[setup]]", "[[setup.pass]]"), place.groups() if place else (), strict=False):
        heads = [number for number, line in enumerate(lines) if number >= begin and line.strip() == head]
        if count and len(heads) >= int(count):
            begin = heads[int(count) - 1]
    for word in re.findall(r"'([^']+)'", message) + re.findall(r"[a-z_]+\.[a-z_0-9]+", message):
        *table, name = re.split(r"[.:] ?", word)
        start = next(
            (number for number, line in enumerate(lines) if line.strip() == f"[{'.'.join(table)}]"), begin
        )
        value = re.escape(Path(word).name)
        known = rf"(^|[\s{{.\[]){re.escape(name)}\s*[=\].]|[\"']([^\"']*[/:])?{value}[\"']"
        order = (*range(start, len(lines)), *range(start))
        found = next((number for number in order if re.search(known, lines[number])), None)
        if found is not None:
            return found + 1
    return begin + 1
