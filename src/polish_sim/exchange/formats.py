"""Every format a plan can be written in, by name (plan -> files)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from polish_sim.errors import unknown_name
from polish_sim.exchange.apt_writer import apt_text
from polish_sim.exchange.html_page import html_text
from polish_sim.exchange.mesh_files import glb_bytes, ply_bytes
from polish_sim.exchange.plan_folder import PATH_CSV, PATH_JSON, csv_text, json_text, write_files
from polish_sim.exchange.ros_yaml import yaml_text
from polish_sim.exchange.setup import ExportSetup
from polish_sim.exchange.urscript import urscript_text
from polish_sim.planning import PlanResult


class Format(NamedTuple):
    """A format: the file's name in a plan folder and who writes it."""

    file: str
    write: Callable[[PlanResult, ExportSetup], str | bytes]


FORMATS: Final[Mapping[str, Format]] = {
    "csv": Format(PATH_CSV, lambda result, setup: csv_text(result)),
    "json": Format(PATH_JSON, lambda result, setup: json_text(result)),
    "apt": Format("path.apt", apt_text),
    "urscript": Format("path.script", urscript_text),
    "ros": Format("path.yaml", yaml_text),
    "ply": Format("path.ply", ply_bytes),
    "glb": Format("path.glb", glb_bytes),
    "html": Format("path.html", html_text),
}
"""Name -> format; a new one is one file and a line here."""
ALL: Final = "all"


def check_formats(names: Sequence[str]) -> tuple[str, ...]:
    """The formats some names stand for, `all` for every one; each once.

    Raises:
        InputError: A name is not known; the message lists those that are.
    """
    for name in names:
        if name not in FORMATS and name != ALL:
            raise unknown_name("export format", name, [*FORMATS, ALL])
    return tuple(FORMATS) if ALL in names else tuple(dict.fromkeys(names))


def export_plan(
    folder: str | Path, result: PlanResult, names: Sequence[str], setup: ExportSetup | None = None
) -> tuple[Path, ...]:
    """Write a plan in some formats, each file whole or not at all.

    Args:
        folder: Where to; created if missing.
        result: The plan.
        names: Names of `FORMATS`, or `all`.
        setup: Process, robot tool, place of the part.

    Returns:
        The files written.

    Raises:
        InputError: Unknown format, or the folder cannot be written.
        PlanError: The path cannot be written in a format, e.g. nothing to press on.
    """
    setup = setup or ExportSetup()
    contents: dict[str, bytes] = {}
    for name in check_formats(names):
        content = FORMATS[name].write(result, setup)
        contents[FORMATS[name].file] = content if isinstance(content, bytes) else content.encode("utf-8")
    write_files(Path(folder), contents)
    return tuple(Path(folder) / file for file in contents)
