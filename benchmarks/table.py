"""Rows of a benchmark, printed alike."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import NamedTuple


class Row(NamedTuple):
    """One figure."""

    name: str
    measured: str
    limit: str


def words(doc: str | None) -> list[str]:
    """The words behind a benchmark's name; with --help among them it ends with its docstring instead."""
    if {"-h", "--help"} & set(sys.argv):
        print(doc)
        raise SystemExit
    return sys.argv[1:]


def print_rows(title: str, rows: Iterable[Row], columns: tuple[str, str] = ("measured", "limit")) -> None:
    """Print a titled table with columns name, measured, limit."""
    print(f"\n{title}")
    print(f"  {'':58s}{columns[0]:>16s}{columns[1]:>16s}")
    for row in rows:
        print(f"  {row.name:58s}{row.measured:>16s}{row.limit:>16s}", flush=True)
