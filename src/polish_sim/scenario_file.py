"""Scenario dataclasses to TOML and back, strict on unknown keys, types and ranges (layer 1)."""

from __future__ import annotations

import math
import tomllib
from dataclasses import Field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from polish_sim.config import Scenario
from polish_sim.errors import ConfigError

T = TypeVar("T")
N = TypeVar("N", int, float)

_COUNTS = {3: "three", 6: "six"}


def load_scenario(path: Path, base: Scenario) -> Scenario:
    """Read a TOML file on top of a base scenario.

    Args:
        path: The file.
        base: Values of the keys the file does not name.

    Returns:
        The scenario.

    Raises:
        ConfigError: If the file cannot be read, or names an unknown key or a value of the wrong type or out of range.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read the config file '{path}': {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"'{path}' is not valid TOML: {error}.") from error
    return merge(base, table, "")


def override(base: Scenario, assignments: list[str]) -> Scenario:
    """Apply ``KEY=VALUE`` strings such as ``sensor.force_noise_n=0.2``; a bare word is taken as a string."""
    scenario = base
    for assignment in assignments:
        dotted, separator, text = assignment.partition("=")
        if not separator or not dotted.strip():
            raise ConfigError(f"'--set {assignment}' is not KEY=VALUE, e.g. --set sensor.force_noise_n=0.2.")
        value = _parse_value(text.strip())
        table: dict[str, Any] = {}
        leaf = table
        *parents, last = dotted.strip().split(".")
        for name in parents:
            leaf = leaf.setdefault(name, {})
        leaf[last] = value
        scenario = merge(scenario, table, "")
    return scenario


def merge(base: T, table: dict[str, Any], place: str) -> T:
    """Return ``base`` with the values of a (nested) table, each checked against its field."""
    known: dict[str, Field[Any]] = {f.name: f for f in fields(base)}  # type: ignore[arg-type]
    changes: dict[str, Any] = {}
    for name, value in table.items():
        where = f"{place}{name}"
        if name not in known:
            raise ConfigError(f"unknown key '{where}'. Known here: {', '.join(sorted(known))}.")
        current = getattr(base, name)
        if is_dataclass(current):
            if not isinstance(value, dict):
                raise ConfigError(f"'{where}' is a section: write [{where}] and its keys below.")
            changes[name] = merge(current, value, f"{where}.")
        else:
            changes[name] = _checked(where, value, current, known[name])
    return replace(base, **changes)  # type: ignore[type-var]


def to_toml(scenario: Scenario) -> str:
    """Write the whole scenario as TOML, each key with its meaning and unit as a comment."""
    lines: list[str] = []
    _write_table(scenario, "", lines)
    return "\n".join(lines) + "\n"


def _write_table(table: Any, place: str, lines: list[str]) -> None:
    sections = [f for f in fields(table) if is_dataclass(getattr(table, f.name))]
    for f in fields(table):
        if f not in sections:
            lines.append(f"{f.name} = {_literal(getattr(table, f.name))}  # {f.metadata['text']}")
    for f in sections:
        section = getattr(table, f.name)
        lines += ["", f"# {(type(section).__doc__ or '').strip().splitlines()[0]}", f"[{place}{f.name}]"]
        _write_table(section, f"{place}{f.name}.", lines)


def _literal(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    if isinstance(value, tuple):
        return "[" + ", ".join(_literal(v) for v in value) + "]"
    return repr(value)


def _parse_value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _checked(where: str, value: Any, current: Any, spec: Field[Any]) -> Any:
    """A value of the type of the ``current`` one and within its field's range."""
    if isinstance(current, tuple):
        length = spec.metadata["length"]
        # Only what is chosen where it is not given may be left empty.
        lengths, or_empty = ((0, length), " (or empty)") if spec.default == () else ((length,), "")
        listed = isinstance(value, (list, tuple)) and len(value) in lengths
        if not listed or not all(_is_number(v) for v in value):
            raise ConfigError(f"'{where}' must be a list of {_COUNTS[length]} numbers{or_empty}, got {value!r}.")
        return tuple(_within(where, float(v), spec) for v in value)
    if isinstance(current, str):
        if not isinstance(value, str):
            raise ConfigError(f"'{where}' must be text, got {value!r}.")
        return value
    if isinstance(current, int):
        if isinstance(value, bool) or not isinstance(value, int):
            raise ConfigError(f"'{where}' must be a whole number, got {value!r}.")
        return _within(where, value, spec)
    if not _is_number(value):
        raise ConfigError(f"'{where}' must be a number, got {value!r}.")
    return _within(where, float(value), spec)


def _within(where: str, number: N, spec: Field[Any]) -> N:
    low, high = spec.metadata["low"], spec.metadata["high"]
    if not low <= number <= high:
        raise ConfigError(f"'{where}' = {number!r} is outside {low:g} to {high:g}: {spec.metadata['text']}.")
    return number


def _is_number(value: Any) -> bool:
    return not isinstance(value, bool) and isinstance(value, (int, float)) and math.isfinite(value)
