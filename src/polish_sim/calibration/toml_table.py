"""calibration.toml as text and back: one flat table, its kind named (layer 8b)."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError

Array = NDArray[np.float64]


def write_table(file: Path, head: str, figures: Mapping[str, Any]) -> None:
    """Write a table under a comment that says what it is."""
    lines = [f"{name} = {_literal(value)}" for name, value in figures.items()]
    file.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")


def _literal(value: Any) -> str:
    if isinstance(value, (str, bool)):
        # JSON and TOML write these alike.
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list):
        return "[" + ", ".join(_literal(entry) for entry in value) + "]"
    if isinstance(value, np.generic):
        return repr(value.item())
    # TOML wants a digit on both sides of the point and reads 1e-05 as well as Python does.
    return repr(value)


def calibration_kind(file: Path, wanted: tuple[str, ...]) -> str:
    """The kind of a calibration.toml, one of those ``wanted``.

    Raises:
        InputError: No such file, no TOML, or none of them.
    """
    kind = _read(file).get("kind")
    if kind not in wanted:
        raise InputError(
            f"'{file}' is none of the calibrations a run can take (kind = {kind!r}): give a calibration.toml made by "
            f"'calibrate {' | '.join(wanted)}'."
        )
    return str(kind)


def read_table(file: Path, kind: str, what: str) -> Mapping[str, Any]:
    """Read a calibration of one kind.

    Args:
        file: The file.
        kind: Its kind, e.g. ``"payload"``: that of the command that makes it.
        what: What it calibrates, e.g. ``"a payload"``.

    Raises:
        InputError: No such file, no TOML, or the calibration of something else.
    """
    table = _read(file)
    if table.get("kind") != kind:
        raise InputError(
            f"'{file}' is not the calibration of {what} (kind = {table.get('kind')!r}). "
            f"Give a calibration.toml made by 'calibrate {kind}'."
        )
    return table


def _read(file: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"cannot read the calibration '{file}': {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"the calibration '{file}' is not valid TOML: {error}.") from error


def numbers_of(file: Path, table: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Array:
    """Numbers of a table.

    Raises:
        InputError: They are not there, not finite, or of another shape.
    """
    try:
        values = np.array(table.get(name), dtype=np.float64)
    except (TypeError, ValueError):
        values = np.array(math.nan)
    if values.shape != shape or not np.isfinite(values).all():
        wanted = " x ".join(map(str, shape))
        raise InputError(f"'{file}': {name} is {table.get(name)!r}, wanted {wanted} finite numbers.")
    return values


def is_number(value: Any) -> bool:
    """Whether a value of TOML is a finite number."""
    return not isinstance(value, bool) and isinstance(value, (int, float)) and math.isfinite(value)
