"""Plan folders: path.csv and path.json read and written, plain CSVs read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polish_sim.arrays import Array, Indices
from polish_sim.errors import InputError
from polish_sim.exchange.way_points import PathRows, Unknown, WayPoints
from polish_sim.planning.toolpath import PROCESS, SEGMENTS, ToolPath
from polish_sim.row_file import (
    METRICS,
    check_forms,
    check_sum,
    fits,
    package_versions,
    put_file,
    read_json,
    write_json,
)
from polish_sim.tables import Columns, csv_text

if TYPE_CHECKING:
    from polish_sim.geometry import PartMesh
    from polish_sim.planning import PlanResult
    from polish_sim.planning.quality.areas import CutOut

PATH_CSV, PATH_JSON = "path.csv", "path.json"
OWN = ("s_m", "x_m", "y_m", "z_m", "nx", "ny", "nz", "pass_index", "segment")
PLAIN = ("x", "y", "z", "i", "j", "k")
CURVATURE = "curvature_1_m"
FORCE, FEED = "force_n", "feed_m_s"
PLAIN_FORCE, PLAIN_FEED = "force", "feed"
MM = 1e-3
_FILE = {"file": str, "sha256": str}
FACTS: Mapping[str, Any] = {
    "part": {**_FILE, "name": str, "unit": str},
    "fixture": _FILE,
    "plan": {},
    "up": lambda up: fits(up, (float,) * 3) and any(up),
    "pad": {"radius_m": float, "stiffness_n_m": float},
    "contact_force_n": float,
    "feed_m_s": float,
    "notes": [str],
    "cuts": [{"reason": str, "places_m": [(float,) * 3]}],
    "proof": {
        **dict.fromkeys(("arm", "controller", "proof", "settings", "path"), str),
        **dict.fromkeys(("feed_m_s", "contact_force_n", "slowed"), float),
        "pose": (float,) * 6,
        "limits": lambda limits: limits and fits(limits, {...: {"share": float, "at_m": float}}),
        "mends": [{"what": str, "why": str, "share": float, "length_m": float, "at_m": (float,) * 3}],
    },
}
"""What a path.json says beside its path, as of `check_forms`; older ones do not say all."""
NEAR = 0.25  #: Distance between the places cut out of a path that are kept [pad radii]


class Points(PathRows, Columns):
    """Columns of a path's points."""


def read_csv(file: Path, text: str, unknown: Unknown) -> WayPoints:
    """Read path.csv or a plain CSV without blank lines and # comments; InputError names a wrong line or
    column."""
    return _path_of(Points.parse(file, text, "point"))


def read_path_json(file: Path, text: str, unknown: Unknown) -> WayPoints:
    """Read a path.json; InputError for no JSON, or no path in it."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"'{file}' is not JSON ({error}). Give a path.json made by 'plan'.") from None
    table = document.get("path") if isinstance(document, dict) else None
    if not isinstance(table, dict) or not all(isinstance(column, list) for column in table.values()):
        raise InputError(f"'{file}' holds no path. Give a path.json made by 'plan'.")
    lengths = {name: len(column) for name, column in table.items()}
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} has {count}" for name, count in lengths.items())
        raise InputError(f"'{file}': columns of unequal length ({said}). Give a path.json made by 'plan'.")
    columns = {str(name): [str(value) for value in column] for name, column in table.items()}
    return _path_of(Points(file, columns, ()))


def path_columns(path: ToolPath) -> dict[str, list[Any]]:
    """The columns of path.csv and path.json; force and feed only where the path has its own."""
    table: dict[str, list[Any]] = {"s_m": path.s.tolist()}
    places = np.hstack([path.positions_work, path.axes_work])
    table |= dict(zip(OWN[1:7], places.T.tolist(), strict=True))
    table["pass_index"] = path.pass_index.tolist()
    table["segment"] = [SEGMENTS[code] for code in path.segment]
    table[CURVATURE] = path.curvature.tolist()
    table |= {} if path.force is None else {FORCE: path.force.tolist()}
    table |= {} if path.feed is None else {FEED: path.feed.tolist()}
    return table


def _path_of(table: Points) -> WayPoints:
    """The path of a path.csv or path.json, or of a plain table, all of whose points are in contact."""
    own = set(OWN) <= set(table.texts)
    if not own and not set(PLAIN) <= set(table.texts):
        raise InputError(
            f"'{table.file}' has the columns {', '.join(table.texts)}. Wanted: {', '.join(PLAIN)} "
            f"(mm, unit tool axis from the part to the tool), or {', '.join(OWN)}."
        )
    names, unit, force, feed = (OWN[1:7], 1.0, FORCE, FEED) if own else (PLAIN, MM, PLAIN_FORCE, PLAIN_FEED)
    positions = table.numbers(names[:3]) * unit
    if own:
        s = table.column(OWN[0])
        table.refuse(
            np.diff(s, prepend=-np.inf) < 0.0,
            lambda row: (
                f"{OWN[0]} falls from {s[row - 1]:.9g} to {s[row]:.9g}. The points are not in the order of "
                "the path: sort them."
            ),
        )
    axes = table.unit_axes(names[3:], table.numbers(names[3:]))
    bent = own and CURVATURE in table.texts
    path = ToolPath(
        positions,
        axes,
        table.checked_length(positions),
        _pass_numbers(table) if own else np.zeros(len(axes), dtype=np.int64),
        _segments(table) if own else np.full(len(axes), PROCESS, dtype=np.int8),
        table.column(CURVATURE) if bent else np.zeros(len(axes)),
        _wish(table, force, 1.0),
        _wish(table, feed, unit),
    )
    return WayPoints(path, table.file, table.place)


def _segments(table: Points) -> NDArray[np.int8]:
    names = [name.strip() for name in table.texts["segment"]]
    table.refuse(
        np.array([name not in SEGMENTS for name in names]),
        lambda row: f"unknown segment '{names[row]}'. Known: {', '.join(SEGMENTS)}.",
    )
    return np.array([SEGMENTS.index(name) for name in names], dtype=np.int8)


def _wish(table: Points, name: str, unit: float) -> Array | None:
    """Force or feed of every point where the file has that column."""
    if name not in table.texts:
        return None
    values = table.column(name)
    table.refuse(values <= 0.0, lambda row: f"{name} is {values[row]:g}, wanted a positive number.")
    return unit * values


def _pass_numbers(table: Points) -> Indices:
    values = table.column("pass_index")
    table.refuse(
        (values != np.round(values)) | (np.abs(values) > 2**31),
        lambda row: f"pass_index is '{table.texts['pass_index'][row]}', wanted a whole number.",
    )
    return values.astype(np.int64)


def write_plan(folder: str | Path, result: PlanResult) -> None:
    """Write path.csv, path.json and metrics.json into a folder, each under a temporary name until whole."""
    write_files(Path(folder), {PATH_CSV: path_csv(result.path), PATH_JSON: json_text(result)})
    write_json(Path(folder, METRICS), result.figures | {"notes": result.notes})


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> None:
    """Write files into a folder, each under a temporary name until whole."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        put_file(folder, name, content)


def path_csv(path: ToolPath) -> str:
    """A path as path.csv; a float's text reads back to the same bits."""
    table = path_columns(path)
    return csv_text(list(table), list(zip(*table.values(), strict=True)))


def json_text(result: PlanResult) -> str:
    """The path with all that is known about it as path.json."""
    document = _metadata(result) | {"path": path_columns(result.path)}
    return json.dumps(document | {"sum": check_sum(document)}) + "\n"


def plan_facts(source: Path, again: str = "Plan again.") -> dict[str, Any]:
    """`FACTS` of a plan folder or path.json; of other files none. ``again`` says what to do about a bad one.

    Raises:
        InputError: It cannot be read, was edited, or does not say its part and plan.
    """
    file = source / PATH_JSON if source.is_dir() else source
    if file.suffix.lower() != ".json":
        return {}
    document = read_json(file, again)
    if None in map(document.get, ("part", "plan")):
        raise InputError(
            f"'{file}' does not say its part and plan. Give a path.json made by 'plan', or a CSV."
        )
    check_forms(document, FACTS, file, again)
    if document.pop("sum", None) not in (None, check_sum(document)):
        raise InputError(f"'{file}' was edited: what it says of its plan is not as it was written. {again}")
    return {name: document.get(name) for name in FACTS}


def read_cuts(source: Path) -> tuple[CutOut, ...]:
    """What was left out of the region, or cut out of the path, of a plan folder or path.json, with the
    reasons; of other files nothing."""
    from polish_sim.planning.quality.areas import CutOut

    cuts = plan_facts(source).get("cuts") or ()
    return tuple(CutOut(cut["reason"], np.array(cut["places_m"])) for cut in cuts)


def _file_facts(mesh: PartMesh) -> dict[str, str]:
    return {"file": mesh.path.name, "path": str(mesh.path.resolve()), "sha256": mesh.sha256}


def _metadata(result: PlanResult) -> dict[str, Any]:
    from polish_sim.planning.points import thin
    from polish_sim.planning.quality.areas import UNPLAYED

    mesh = result.mesh
    plan = result.plan
    pad = result.tool.pad
    fixture = result.tool.fixture
    asked = result.ready.asked
    vertices = asked.ground.mesh.vertices
    left_out = ((reason, vertices[asked.why == number]) for number, reason in enumerate(asked.reasons))
    return {
        "part": {"name": mesh.name, **_file_facts(mesh), "unit": mesh.unit},
        "fixture": fixture and _file_facts(fixture.mesh),
        "up": mesh.up.tolist(),
        "pad": {"radius_m": pad.radius_m, "stiffness_n_m": pad.stiffness_n_m},
        "contact_force_n": result.tool.force,
        "feed_m_s": result.ready.process.feed_m_s,
        "proof": result.proof,
        "cuts": [
            {
                "reason": reason,
                "places_m": places.tolist()
                if reason == UNPLAYED
                else places[thin(places, NEAR * pad.radius_m).kept].tolist(),
            }
            for reason, places in (*result.cuts, *left_out)
            if len(places)
        ],
        "plan": vars(plan),
        "stepover_m": plan.stepover_m,
        "pattern": plan.pattern,
        "units": "m, rad; positions and axes in the work frame, which is the STL's frame in metres",
        "versions": package_versions(),
        "notes": list(result.notes),
    }
