"""Plans on disk: path.csv, path.json, metrics.json written whole or not at all; any path read back (plan <-> files)."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from polish_sim.errors import InputError
from polish_sim.planning.part_plan import PlanResult
from polish_sim.planning.toolpath import PROCESS, SEGMENTS, ToolPath, arc_length

Array = NDArray[np.float64]

PATH_CSV, PATH_JSON, METRICS = "path.csv", "path.json", "metrics.json"
COLUMNS: Final = ("s_m", "x_m", "y_m", "z_m", "nx", "ny", "nz", "pass_index", "segment")
CURVATURE: Final = "curvature_1_m"
PLAIN_COLUMNS: Final = ("x", "y", "z", "i", "j", "k")
VERSIONED: Final = ("polish-sim", "numpy", "scipy", "numba")
UNIT_TOLERANCE: Final = 1e-3


def write_plan(folder: Path, result: PlanResult) -> None:
    """Write path.csv, path.json and metrics.json into a folder, each under a temporary name until whole.

    Args:
        folder: Where to; created if missing.
        result: The plan.

    Raises:
        InputError: The folder cannot be written.
    """
    path = result.path
    document = _metadata(result) | {"path": _columns(path)}
    texts = {
        PATH_CSV: _csv_text(path),
        PATH_JSON: json.dumps(document) + "\n",
        METRICS: json.dumps(_finite(result.figures) | {"notes": list(result.notes)}, indent=2) + "\n",
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            draft = folder / f".{name}.part"
            draft.write_text(text, encoding="utf-8")
            os.replace(draft, folder / name)
    except OSError as error:
        raise InputError(f"cannot write the plan into '{folder}': {error.strerror}. Choose another folder.") from error


def read_plan(source: Path) -> ToolPath:
    """Read a path: a plan folder, its path.json or path.csv, or a plain CSV with columns x, y, z, i, j, k.

    Plain files hold positions in mm in the work frame and the unit tool axis from the part to the tool, as CLDATA;
    all their points are process points.

    Args:
        source: Folder or file.

    Returns:
        The path.

    Raises:
        InputError: The file cannot be read or is no path; says where and what to do.
    """
    file = source / PATH_JSON if source.is_dir() else source
    if source.is_dir() and not file.is_file():
        raise InputError(f"'{source}' is not a plan folder: it holds no {PATH_JSON}. Give a folder made by 'plan'.")
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read the path '{file}': {error.strerror}.") from error
    except UnicodeDecodeError:
        raise InputError(f"'{file}' is not a text file. Give path.json, path.csv or a CSV of x,y,z,i,j,k.") from None
    return _from_json(file, text) if file.suffix.lower() == ".json" else _from_csv(file, text)


def _metadata(result: PlanResult) -> dict[str, Any]:
    mesh, plan = result.mesh, result.plan
    return {
        "part": {"name": mesh.name, "file": mesh.path.name, "sha256": mesh.sha256, "unit": mesh.unit},
        "up": [float(value) for value in mesh.up],
        "plan": {name: getattr(plan, name) for name in plan.__dataclass_fields__},
        "stepover_m": plan.stepover_m,
        "pattern": plan.pattern,
        "units": "m, rad; positions and axes in the work frame, which is the STL's frame in metres",
        "versions": {name: version(name) for name in VERSIONED},
        "notes": list(result.notes),
    }


def _columns(path: ToolPath) -> dict[str, list[Any]]:
    table: dict[str, list[Any]] = {"s_m": path.s.tolist()}
    table |= {name: path.positions_work[:, k].tolist() for k, name in enumerate(("x_m", "y_m", "z_m"))}
    table |= {name: path.axes_work[:, k].tolist() for k, name in enumerate(("nx", "ny", "nz"))}
    table["pass_index"] = path.pass_index.tolist()
    table["segment"] = [SEGMENTS[code] for code in path.segment]
    table[CURVATURE] = path.curvature.tolist()
    return table


def _csv_text(path: ToolPath) -> str:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    names = (*COLUMNS, CURVATURE)
    writer.writerow(names)
    table = _columns(path)
    # repr of a float reads back to the same bits.
    writer.writerows(zip(*(table[name] for name in names), strict=True))
    return out.getvalue()


def _from_json(file: Path, text: str) -> ToolPath:
    try:
        document = json.loads(text)
    except ValueError as error:
        raise InputError(f"'{file}' is not JSON ({error}). Give a path.json made by 'plan'.") from None
    table = document.get("path") if isinstance(document, dict) else None
    if not isinstance(table, dict) or not all(isinstance(column, list) for column in table.values()):
        raise InputError(f"'{file}' holds no path. Give a path.json made by 'plan'.")
    return _from_table(file, {str(name): [str(value) for value in column] for name, column in table.items()})


def _from_csv(file: Path, text: str) -> ToolPath:
    rows = [row for row in csv.reader(io.StringIO(text), skipinitialspace=True) if row and not row[0].startswith("#")]
    if len(rows) < 2:
        raise InputError(f"'{file}' holds no points. Wanted: a header line, then one point per line.")
    names = [name.strip().lower() for name in rows[0]]
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            raise InputError(f"'{file}', line {number}: {len(row)} values, the header names {len(names)}.")
    return _from_table(file, dict(zip(names, map(list, zip(*rows[1:], strict=True)), strict=True)))


def _from_table(file: Path, table: Mapping[str, list[str]]) -> ToolPath:
    readers: dict[tuple[str, ...], Callable[[Path, Mapping[str, list[str]]], ToolPath]]
    readers = {COLUMNS: _own_path, PLAIN_COLUMNS: _plain_path}
    for names, reader in readers.items():
        if set(names) <= set(table):
            return reader(file, table)
    raise InputError(
        f"'{file}' has the columns {', '.join(table)}. Wanted: {', '.join(PLAIN_COLUMNS)} "
        f"(mm, unit tool axis from the part to the tool), or {', '.join(COLUMNS)}."
    )


def _own_path(file: Path, table: Mapping[str, list[str]]) -> ToolPath:
    positions, axes = _points(file, table, ("x_m", "y_m", "z_m")), _axes(file, table, ("nx", "ny", "nz"))
    unknown = sorted(set(table["segment"]) - set(SEGMENTS))
    if unknown:
        raise InputError(f"'{file}': unknown segment '{unknown[0]}'. Known: {', '.join(SEGMENTS)}.")
    segment = np.array([SEGMENTS.index(name) for name in table["segment"]], dtype=np.int8)
    passes = _numbers(file, table, "pass_index").astype(np.int64)
    curvature = _numbers(file, table, CURVATURE) if CURVATURE in table else np.zeros(len(positions))
    return ToolPath(positions, axes, _length(file, positions), passes, segment, curvature)


def _plain_path(file: Path, table: Mapping[str, list[str]]) -> ToolPath:
    positions, axes = _points(file, table, ("x", "y", "z")) * 1e-3, _axes(file, table, ("i", "j", "k"))
    count = len(positions)
    segment = np.full(count, PROCESS, dtype=np.int8)
    return ToolPath(
        positions, axes, _length(file, positions), np.zeros(count, dtype=np.int64), segment, np.zeros(count)
    )


def _numbers(file: Path, table: Mapping[str, list[str]], name: str) -> Array:
    values = np.empty(len(table[name]))
    for row, text in enumerate(table[name]):
        try:
            values[row] = float(text)
        except ValueError:
            values[row] = math.nan
        if not math.isfinite(values[row]):
            raise InputError(f"'{file}', point {row + 1}: {name} is '{text}', not a number.")
    return values


def _points(file: Path, table: Mapping[str, list[str]], names: tuple[str, str, str]) -> Array:
    return np.stack([_numbers(file, table, name) for name in names], axis=1)


def _axes(file: Path, table: Mapping[str, list[str]], names: tuple[str, str, str]) -> Array:
    axes = _points(file, table, names)
    length = np.linalg.norm(axes, axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > UNIT_TOLERANCE)
    if len(wrong):
        raise InputError(
            f"'{file}', point {wrong[0] + 1}: the tool axis ({', '.join(names)}) has length {length[wrong[0]]:.4g}, "
            "wanted 1: a unit vector from the part to the tool."
        )
    return np.asarray(axes / length[:, None])


def _length(file: Path, positions: Array) -> Array:
    s = arc_length(positions)
    still = np.flatnonzero(np.diff(s) <= 0.0)
    if len(s) < 2 or len(still):
        where = f"points {still[0] + 1} and {still[0] + 2} are the same" if len(still) else "it has one point"
        raise InputError(f"'{file}' is no path: {where}. Leave repeated points out.")
    return s


def _finite(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures that are not finite become null, as strict JSON wants."""
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in figures.items()}
