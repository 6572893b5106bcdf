"""The one reader of CSV files: named columns of text, and numbers from them; errors name file, line and
column."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from polish_sim.arrays import Array, Bools
from polish_sim.errors import LARGEST, InputError, read_bytes

OTHER_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}
Place = Callable[[int], str]  #: Says where in a file a row stands, e.g. "line 4, point 3"


class FileRows:
    """Rows of a file, named by their places in errors."""

    file: Path
    lines: Sequence[int]  #: The line each row stands on

    def place(self, row: int) -> str:
        """Where a row stands."""
        return f"line {self.lines[row]}"

    def refuse(self, wrong: Bools, said: Callable[[int], str]) -> None:
        """Refuse the file (InputError) where a row is ``wrong`` (n,), by what is ``said`` of the first."""
        refuse_first(wrong, self.file, self.place, said)


@dataclass(frozen=True)
class Columns(FileRows):
    """Columns of text by name in small letters, in the order of a file."""

    file: Path
    texts: Mapping[str, Sequence[str]]
    lines: Sequence[int]

    def __len__(self) -> int:
        return len(self.lines)

    def column(self, name: str) -> Array:
        """A column of finite numbers, shape (n,); InputError if a value is none."""
        texts = self.texts[name]
        try:
            values = np.array(texts, dtype=np.float64)
        except ValueError:
            values = np.array([number_in(text) for text in texts])

        def said(row: int) -> str:
            why = f"beyond {LARGEST:g}" if np.isfinite(values[row]) else "not a number"
            return f"{name} is '{texts[row]}', {why}. Correct or leave out the line."

        self.refuse(~(np.abs(values) <= LARGEST), said)
        return values

    def numbers(self, names: Sequence[str]) -> Array:
        """Columns of finite numbers, shape (n, len(names)); InputError if a value is none."""
        return np.stack([self.column(name) for name in names], axis=1)

    def need(self, names: Sequence[str], meaning: str = "") -> None:
        """Refuse a file that lacks columns: names them, their meaning and the columns there are."""
        missing = [name for name in names if name not in self.texts]
        if missing:
            raise InputError(
                f"'{self.file}' lacks the column{'s' if len(missing) > 1 else ''} {', '.join(missing)}"
                f"{f': {meaning}' if meaning else ''}. It has: {', '.join(self.texts)}."
            )

    @classmethod
    def read(cls, file: Path, kind: str, content: str) -> Self:
        """Read a CSV with a header; blank lines and lines that begin with # are left out.

        ``kind``: what a line is, e.g. "reading"; ``content``: what the file should hold, e.g. "poses and
        readings". InputError for no such file, no text, no CSV, or no lines.
        """
        try:
            text = read_bytes(file, f"{kind}s").decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise InputError(
                f"'{file}' is not a text file ({error.reason}). Give a CSV of {content}."
            ) from error
        return cls.parse(file, text, kind)

    @classmethod
    def parse(cls, file: Path, text: str, kind: str) -> Self:
        """Take the text of a CSV apart, without spaces around its values; ``kind``: what a line of it is,
        e.g. "point".

        Raises InputError, naming the line, for no CSV, separators that are no commas, no rows, a row of
        another length, a name that stands twice.
        """
        rows, lines = _rows(file, text)
        if len(rows) < 2:
            raise InputError(f"'{file}' holds no {kind}s. Wanted: a header line, then one {kind} per line.")
        names = [name.lower() for name in rows[0]]
        # Spreadsheets of many countries write semicolons: then all names stand in one.
        others = [word for sign, word in OTHER_SEPARATORS.items() if sign in names[0]]
        if len(names) == 1 and others:
            raise InputError(
                f"'{file}', line {lines[0]}: the columns are separated by {others[0]}. Separate them by "
                "commas, with a point in decimal numbers."
            )
        twice = sorted({name for name in names if name and names.count(name) > 1})
        if twice:
            raise InputError(
                f"'{file}', line {lines[0]}: the header names {', '.join(twice)} more than once. Leave one "
                "column of each."
            )
        for row, line in zip(rows[1:], lines[1:], strict=True):
            if len(row) != len(names):
                raise InputError(f"'{file}', line {line}: {len(row)} values, the header names {len(names)}.")
        return cls(file, dict(zip(names, map(list, zip(*rows[1:], strict=True)), strict=True)), lines[1:])


def _rows(file: Path, text: str) -> tuple[list[list[str]], list[int]]:
    source = csv.reader(io.StringIO(text, newline=None), skipinitialspace=True)
    rows, lines = [], []
    try:
        for row in source:
            if any(value.strip() for value in row) and not row[0].startswith("#"):
                rows.append([value.strip() for value in row])
                lines.append(source.line_num)
    except csv.Error as error:
        raise InputError(f"'{file}', line {source.line_num}: not CSV ({error}). Export it again.") from None
    return rows, lines


def refuse_first(wrong: Bools, file: Path, place: Place, said: Callable[[int], str]) -> None:
    """Refuse a file (InputError) where a row is ``wrong`` (n,), by what is ``said`` of the first."""
    for row in map(int, np.flatnonzero(wrong)[:1]):
        raise InputError(f"'{file}', {place(row)}: {said(row)}")


def number_in(text: str) -> float:
    """The number a text is; NaN if it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def csv_text(names: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A CSV of a header and rows."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([names, *rows])
    return out.getvalue()
