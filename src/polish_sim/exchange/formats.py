"""Every format a plan is written in, by name, and a path is read from, by the file's ending."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from polish_sim.arrays import Bools
from polish_sim.errors import InputError, check_name, read_bytes
from polish_sim.exchange.apt import apt_text, read_apt
from polish_sim.exchange.gcode import read_gcode
from polish_sim.exchange.plan_folder import (
    PATH_CSV,
    PATH_JSON,
    json_text,
    path_csv,
    read_csv,
    read_path_json,
    write_files,
)
from polish_sim.exchange.strokes import (
    ExportSetup,
    feed_frames,
    feeds_of,
    forces_of,
    in_part_remarks,
    moves_in_part,
    rows_without_straight_air,
)
from polish_sim.exchange.urscript import urscript_text
from polish_sim.exchange.viewers import glb_bytes, html_text, ply_bytes
from polish_sim.exchange.way_points import Unknown, WayPoints, refuse_unknown
from polish_sim.planning import PlanResult
from polish_sim.planning.toolpath import SEGMENTS, ToolPath
from polish_sim.tables import refuse_first

# Paths for ROS: a pose list in YAML, shaped like geometry_msgs/PoseArray with lists beside it (plan -> YAML).


def yaml_text(result: PlanResult, setup: ExportSetup) -> str:
    """Write a path as a YAML pose list that any YAML reader loads with plain types.

    `header` and `poses` are a PoseArray; `segment`, `pass_index`, `force_n` and `feed_m_s` have one entry per
    pose. Straight moves in the air have a pose at either end. ``setup``: frame's name, force and feed.
    """
    kept = rows_without_straight_air(result.path)
    path = result.path.rows(kept)
    inside = moves_in_part(result, kept)
    return "\n".join([*_head(result, setup), *_poses(path, inside), *_lists(path, setup), ""])


def _head(result: PlanResult, setup: ExportSetup) -> list[str]:
    return [
        "# tool path by polish-sim; metres, newtons, quaternions x, y, z, w",
        "# tool frame: z into the part, x along the feed; points lie on the surface, not pressed in",
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        f"  frame_id: {json.dumps(setup.frame_id)}",
        "part:",
        f"  name: {json.dumps(result.mesh.name)}",
        f"  sha256: {json.dumps(result.mesh.sha256)}",
        f"pattern: {json.dumps(result.plan.pattern)}",
        f"stepover_m: {result.plan.stepover_m:.9f}",
    ]


def _poses(path: ToolPath, inside: Bools) -> Iterator[str]:
    yield "poses:"
    turns = Rotation.from_matrix(feed_frames(path)).as_quat()
    for p, q, remark in zip(path.positions_work, turns, in_part_remarks(inside), strict=True):
        if remark:
            yield f"# {remark}"
        yield f"- position: {{x: {p[0]:.9f}, y: {p[1]:.9f}, z: {p[2]:.9f}}}"
        yield f"  orientation: {{x: {q[0]:.9f}, y: {q[1]:.9f}, z: {q[2]:.9f}, w: {q[3]:.9f}}}"


def _lists(path: ToolPath, setup: ExportSetup) -> Iterator[str]:
    """Lists in flow style."""
    pressed = np.where(path.process, forces_of(path, setup), 0.0)
    for name, values in (
        ("segment", [SEGMENTS[code] for code in path.segment]),
        ("pass_index", [str(value) for value in path.pass_index]),
        ("force_n", [f"{value:.6f}" for value in pressed]),
        ("feed_m_s", [f"{value:.9f}" for value in feeds_of(path, setup)]),
    ):
        yield f"{name}: [{', '.join(values)}]"


class Format(NamedTuple):
    """A format: the file's name in a plan folder and who writes it."""

    file: str
    write: Callable[[PlanResult, ExportSetup], str | bytes]


FORMATS: Mapping[str, Format] = {
    "csv": Format(PATH_CSV, lambda result, setup: path_csv(result.path)),
    "json": Format(PATH_JSON, lambda result, setup: json_text(result)),
    "apt": Format("path.apt", apt_text),
    "urscript": Format("path.script", urscript_text),
    "ros": Format("path.yaml", yaml_text),
    "ply": Format("path.ply", ply_bytes),
    "glb": Format("path.glb", glb_bytes),
    "html": Format("path.html", html_text),
}
"""Name -> format; a new one is one file and a line here."""
ALL = "all"


def check_formats(names: Sequence[str]) -> tuple[str, ...]:
    """The formats some names stand for, `all` for every one, each once; InputError lists the known ones."""
    for name in names:
        check_name("export format", name, [*FORMATS, ALL])
    return tuple(FORMATS) if ALL in names else tuple(dict.fromkeys(names))


def export_plan(
    folder: str | Path, result: PlanResult, names: Sequence[str], setup: ExportSetup = ExportSetup()
) -> tuple[Path, ...]:
    """Write a plan in formats, names of `FORMATS` or `all`, each file whole or not at all; returns the files.

    Raises InputError for an unknown format, PlanError if the path cannot be written in a format, e.g. with
    nothing to press on.
    """
    chosen = [FORMATS[name] for name in check_formats(names)]
    contents = {each.file: each.write(result, setup) for each in chosen}
    write_files(Path(folder), contents)
    return tuple(Path(folder) / file for file in contents)


Reader = Callable[[Path, str, Unknown], WayPoints]

READERS: Mapping[str, Reader] = {
    **dict.fromkeys((".csv", ".txt"), read_csv),
    ".json": read_path_json,
    **dict.fromkeys((".apt", ".aptsource", ".cls", ".cl", ".ncl"), read_apt),
    **dict.fromkeys((".nc", ".ngc", ".gcode", ".cnc", ".tap"), read_gcode),
}
"""Suffix of a file -> its reader; a new format is one file and a line here."""


def read_path(source: str | Path) -> ToolPath:
    """Read a tool path, work frame, not pressed in: a plan folder, path.json, path.csv, a plain CSV,
    APT/CLDATA, or G-code.

    A plain CSV has the columns x, y, z (mm, work frame) and i, j, k (unit tool axis from the part to the
    tool, as CLDATA), and may have force (N) and feed (mm/s); all its points are process points.
    docs/formats.md has the rest. Raises InputError, saying where and what to do, for no path or a point
    twice.
    """
    found = read_way_points(source)
    refuse_first(
        np.diff(found.path.s, prepend=-1.0) <= 0.0,
        found.file,
        found.place,
        lambda row: f"points {row} and {row + 1} are the same. Leave repeated points out.",
    )
    return found.path


def read_way_points(source: str | Path, unknown: Unknown = refuse_unknown) -> WayPoints:
    """`read_path` as the file has it: points may repeat, and the tool may turn where it stands."""
    source = Path(source)
    file = source / PATH_JSON if source.is_dir() else source
    if (source / "setup_1" / PATH_JSON).is_file():
        raise InputError(f"'{source}' holds several setups: give one of them, e.g. '{source / 'setup_1'}'.")
    if source.is_dir() and not file.is_file():
        raise InputError(
            f"'{source}' is not a plan folder: it holds no {PATH_JSON}. Give a folder made by 'plan'."
        )
    content = read_bytes(file, "path")
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(
            f"'{file}' is in no format a path is read from ({file.suffix or 'no suffix'}). "
            f"Give a plan folder or a file ending in {', '.join(sorted(READERS))}."
        )
    try:
        # Windows programs put a byte-order mark before the first column's name.
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(
            f"'{file}' is not a text file. Give path.json, path.csv, a CSV of x,y,z,i,j,k, APT or G-code."
        ) from None
    found, table = reader(file, text, unknown), source / PATH_CSV
    if table.is_file() and path_csv(read_way_points(table, unknown).path) != path_csv(found.path):
        raise InputError(
            f"'{table}' is not the path of {PATH_JSON} beside it: it was edited. Give '{table}' itself, or "
            "plan again."
        )
    return found
