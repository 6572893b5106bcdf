"""A CSV with a header line as columns of text, with the line every row came from (text -> NamedColumns)."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from polish_sim.errors import InputError

OTHER_SEPARATORS: Final = {";": "semicolons", "\t": "tabs", "|": "bars"}


class NamedColumns(NamedTuple):
    """Columns of text by name in small letters, and the line each row stands on."""

    columns: Mapping[str, list[str]]
    lines: list[int]


def read_named_columns(file: Path, text: str, row_is: str) -> NamedColumns:
    """Take a CSV apart; blank lines and lines that begin with # are left out.

    Args:
        file: Where the text is from, for messages.
        text: The file's text.
        row_is: What a row holds, e.g. "point".

    Returns:
        The columns, without spaces around their values.

    Raises:
        InputError: Not CSV, separators that are no commas, no rows, a row of another length, a name that stands twice;
            names the line.
    """
    rows, lines = _rows(file, text)
    if len(rows) < 2:
        raise InputError(f"'{file}' holds no {row_is}s. Wanted: a header line, then one {row_is} per line.")
    names = [name.lower() for name in rows[0]]
    _refuse_other_separator(file, names, lines[0])
    twice = sorted({name for name in names if name and names.count(name) > 1})
    if twice:
        raise InputError(
            f"'{file}', line {lines[0]}: the header names {', '.join(twice)} more than once. Leave one column of each."
        )
    for row, line in zip(rows[1:], lines[1:], strict=True):
        if len(row) != len(names):
            raise InputError(f"'{file}', line {line}: {len(row)} values, the header names {len(names)}.")
    return NamedColumns(dict(zip(names, map(list, zip(*rows[1:], strict=True)), strict=True)), lines[1:])


def _refuse_other_separator(file: Path, names: list[str], line: int) -> None:
    """Spreadsheets of many countries write semicolons: then all names stand in one."""
    found = [word for sign, word in OTHER_SEPARATORS.items() if sign in names[0]]
    if len(names) == 1 and found:
        raise InputError(
            f"'{file}', line {line}: the columns are separated by {found[0]}. Separate them by commas, with a point in "
            "decimal numbers."
        )


def _rows(file: Path, text: str) -> tuple[list[list[str]], list[int]]:
    source = csv.reader(io.StringIO(text), skipinitialspace=True)
    rows, lines = [], []
    try:
        for row in source:
            if any(value.strip() for value in row) and not row[0].startswith("#"):
                rows.append([value.strip() for value in row])
                lines.append(source.line_num)
    except csv.Error as error:
        raise InputError(f"'{file}', line {source.line_num}: not CSV ({error}). Export it again.") from None
    return rows, lines
