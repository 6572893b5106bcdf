"""TOML files: the one reader, and the one writer, each key with its comment, of configs, studies and
calibrations."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from polish_sim.errors import PolishSimError, read_bytes

#: First and last line of the files we write; users' own need neither
WHOLE, END = "# Whole if its last line is: # end\n", "# end\n"


def read_toml(file: Path, what: str, error: type[PolishSimError]) -> dict[str, Any]:
    """Read a file; ``what`` it holds, e.g. "study", stands in the ``error`` if it cannot be read, is no TOML,
    or one of ours that was cut."""
    try:
        text = read_bytes(file, what, error).decode("utf-8-sig")
    except UnicodeDecodeError as caught:
        line = caught.object.count(b"\n", 0, caught.start) + 1
        raise error(f"the {what} '{file}' is not UTF-8 (at line {line}): save it as UTF-8.") from caught
    if WHOLE in text and END.strip() not in text.splitlines():
        raise error(
            f"the {what} '{file}' was cut: it has no line '# end'. Restore it, or delete its line "
            f"'{WHOLE.strip()}' if it is meant so."
        )
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as caught:
        why = str(caught).replace("(at end of document", f"(at line {len(text.splitlines())}, its end")
        raise error(f"the {what} '{file}' is not valid TOML: {why}.") from caught


def toml_value(value: Any) -> str:
    """A single value as TOML writes it, and ``--set`` takes it."""
    import tomlkit

    return tomlkit.item(_plain(value)).as_string()


def toml_text(
    values: Mapping[str, Any], comments: Mapping[str, str] | None = None, head: Sequence[str] = ()
) -> str:
    """Write a nested table as TOML, keys before sections, in the order given; a mapping becomes a section.

    Values are text, numbers, booleans, lists and numpy arrays of them. ``comments``, by dotted name, stand
    behind their key or section, ``head`` at the top.
    """
    import tomlkit

    document = tomlkit.document()
    for line in head:
        document.add(tomlkit.comment(line))
    _fill(document, values, comments or {}, "")
    return WHOLE + tomlkit.dumps(document) + END


def _fill(table: Any, values: Mapping[str, Any], comments: Mapping[str, str], place: str) -> None:
    import tomlkit

    for name, value in sorted(values.items(), key=lambda entry: isinstance(entry[1], Mapping)):
        where, nested = f"{place}{name}", isinstance(value, Mapping)
        item = tomlkit.table() if nested else tomlkit.item(_plain(value))
        if where in comments:
            item.comment(comments[where])
        if nested:
            _fill(item, value, comments, f"{where}.")
        table.add(name, item)


def _plain(value: Any) -> Any:
    """A list for an array, a number of Python's for numpy's."""
    return value.tolist() if hasattr(value, "tolist") else value
