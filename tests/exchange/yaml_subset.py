"""Reads the YAML our writer may use, and nothing else: a strict check that any YAML reader will load it too.

Block mappings two deep, a list of one-line flow mappings, flow lists over many lines, strings in single quotes.
"""

from __future__ import annotations

import re
from typing import Any

NUMBER = re.compile(r"-?\d+(\.\d+)?")  # YAML 1.1 reads 1e-5 as a string: no exponents
WORD = re.compile(r"[a-z_][a-z_0-9]*")


def load(text: str) -> dict[str, Any]:
    """Parse a document; AssertionError where it leaves the subset."""
    document: dict[str, Any] = {}
    lines = [line for line in text.split("\n") if line and not line.startswith("#")]
    assert all(line.isprintable() and line == line.rstrip() for line in lines)
    while lines:
        key, rest = _split(lines.pop(0))
        if rest == "[":
            document[key] = _flow_list(lines)
        elif rest:
            document[key] = _value(rest)
        elif lines[0].startswith("- "):
            document[key] = _items(lines)
        else:
            document[key] = {}
            while lines and lines[0].startswith("  "):
                name, value = _split(lines.pop(0)[2:])
                document[key][name] = _value(value)
    return document


def _items(lines: list[str]) -> list[dict[str, Any]]:
    items: list[dict[str, Any]] = []
    while lines and lines[0][:2] in ("- ", "  "):
        line = lines.pop(0)
        if line.startswith("- "):
            items.append({})
        name, value = _split(line[2:])
        items[-1][name] = _value(value)
    return items


def _flow_list(lines: list[str]) -> list[Any]:
    values: list[Any] = []
    while True:
        line = lines.pop(0)
        assert line.startswith("  "), "a flow list is indented"
        if line == "  ]":
            return values
        assert line.endswith(",")
        values += [_value(part.strip()) for part in line[:-1].split(",")]


def _split(line: str) -> tuple[str, str]:
    key, colon, rest = line.partition(":")
    assert colon, line
    assert WORD.fullmatch(key), line
    assert rest == "" or rest.startswith(" "), line
    return key, rest.strip()


def _value(text: str) -> Any:
    if text.startswith("{"):
        assert text.endswith("}")
        return {key: _value(value) for key, value in (_split(part.strip()) for part in text[1:-1].split(","))}
    if text.startswith("'"):
        assert re.fullmatch(r"'([^']|'')*'", text), text
        return text[1:-1].replace("''", "'")
    if NUMBER.fullmatch(text):
        return float(text) if "." in text else int(text)
    assert WORD.fullmatch(text), text
    assert text not in ("yes", "no", "on", "off", "true", "false", "null", "y", "n"), text
    return text
