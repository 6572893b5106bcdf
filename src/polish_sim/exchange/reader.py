"""The one reader of tool paths, whatever made them (file -> ToolPath)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from polish_sim.errors import InputError, read_bytes
from polish_sim.exchange.apt import read_apt
from polish_sim.exchange.gcode import read_gcode
from polish_sim.exchange.plan_folder import PATH_JSON, read_csv, read_path_json
from polish_sim.exchange.way_points import Unknown, WayPoints, refuse_repeats, refuse_unknown

if TYPE_CHECKING:
    from polish_sim.planning import ToolPath

Reader = Callable[[Path, str, Unknown], WayPoints]

READERS: Mapping[str, Reader] = {
    **dict.fromkeys((".csv", ".txt"), read_csv),
    ".json": read_path_json,
    **dict.fromkeys((".apt", ".aptsource", ".cls", ".cl", ".ncl"), read_apt),
    **dict.fromkeys((".nc", ".ngc", ".gcode", ".cnc", ".tap"), read_gcode),
}
"""Suffix of a file -> its reader; a new format is one file and a line here."""


def read_path(source: str | Path, unknown: Unknown = refuse_unknown) -> ToolPath:
    """Read a tool path, work frame, not pressed in: a plan folder, path.json, path.csv, a plain CSV,
    APT/CLDATA, or G-code.

    A plain CSV has the columns x, y, z (mm, work frame) and i, j, k (unit tool axis from the part to the
    tool, as CLDATA), and may have force (N) and feed (mm/s); all its points are process points.
    docs/formats.md has the rest. ``unknown`` is called with words that could be skipped. Raises InputError,
    saying where and what to do, for no path or a point twice.
    """
    found = read_way_points(source, unknown)
    refuse_repeats(found.file, found.path.s, found.place)
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
    return reader(file, text, unknown)
