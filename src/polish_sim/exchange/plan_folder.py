"""A plan as a folder of files: path.csv, path.json and metrics.json, written whole or not at all (plan -> files)."""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from polish_sim.errors import InputError
from polish_sim.exchange.columns import path_columns

if TYPE_CHECKING:
    from polish_sim.planning import PlanResult, ToolPath

PATH_CSV, PATH_JSON, METRICS = "path.csv", "path.json", "metrics.json"
VERSIONED: Final = ("polish-sim", "numpy", "scipy", "numba")


def write_plan(folder: str | Path, result: PlanResult) -> None:
    """Write path.csv, path.json and metrics.json into a folder, made if missing, each under a temporary name
    until whole."""
    write_files(
        Path(folder),
        {
            PATH_CSV: csv_text(result).encode(),
            PATH_JSON: json_text(result).encode(),
            METRICS: metrics_text(result).encode(),
        },
    )


def write_files(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write files into a folder, each under a temporary name until whole; InputError if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            draft = folder / f".{name}.part"
            draft.write_bytes(content)
            os.replace(draft, folder / name)
    except OSError as error:
        raise InputError(f"cannot write the plan into '{folder}': {error.strerror}. Choose another folder.") from error


def csv_text(result: PlanResult) -> str:
    """A plan's path as path.csv."""
    return path_csv(result.path)


def path_csv(path: ToolPath) -> str:
    """A path as path.csv."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    table = path_columns(path)
    writer.writerow(table)
    # repr of a float reads back to the same bits.
    writer.writerows(zip(*table.values(), strict=True))
    return out.getvalue()


def json_text(result: PlanResult) -> str:
    """The path with all that is known about it as path.json."""
    return json.dumps(_metadata(result) | {"path": path_columns(result.path)}) + "\n"


def metrics_text(result: PlanResult) -> str:
    """The figures as metrics.json; those that are not finite become null, as strict JSON wants."""
    figures = {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in result.figures.items()}
    return json.dumps(figures | {"notes": list(result.notes)}, indent=2) + "\n"


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
