"""Record what a rebuild must not change, and compare the code at hand with the record.

    python -m benchmarks.freeze record FOLDER                  # reference data of the code at hand
    python -m benchmarks.freeze compare FOLDER [--only NAME...] [--bound 1e-12]

Every item is one command line of ``polish-sim`` run in a process of its own, so the script works however the
modules are arranged. Files that earlier items left in the reference are read again by later ones: that old
plans and calibrations can still be read is checked as well.

Compared are all arrays (``*.npz``), tables (``*.csv``), figures (``metrics.json``, ``score.json``),
calibrations and exit codes; not pictures, wording, or wall-clock figures. Without ``--bound`` arrays must
agree byte for byte. Most columns of a log are float32: their last digit is 6e-8 of the value. All items take
about 5 min of one core, warm.
"""

from __future__ import annotations

import argparse
import csv
import fnmatch
import json
import math
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Columns = dict[str, NDArray[Any]]

DEFAULT: Final = Path("build") / "freeze"
ZIGZAG: Final = "zigzag.csv"
"""A short path of sharp corners with a turning tool axis, written into the reference."""
RECORD: Final = "record.json"

STEPOVER_MM: Final = {
    "freeform": 30, "saddle": 30, "sphere_50": 15, "cylinder": 30, "wheel_hub_rim": 15, "plate_two_holes": 30,
}  # fmt: skip
"""Parts that are planned, with a coarse step-over each [mm]."""
PATTERNS: Final = ("spiral", "contour", "fermat", "raster")
SHORT_FEED: Final = "--set process.max_feed_s=2"
SCORED: Final = ("step-10", "flat-100", "stiffness-2", "latency-12", "noise-1", "rigid-block")

ITEMS: Final[Mapping[str, str]] = {
    **{
        f"plan-{part}-{pattern}": f"plan {part} --pattern {pattern} --stepover {stepover}"
        for part, stepover in STEPOVER_MM.items()
        for pattern in PATTERNS
    },
    "inspect": "inspect {reference}/plan-saddle-raster/path.csv --part saddle",
    "arc": "run arc --set process.max_feed_s=4",
    "force": "run force --set process.hold_s=1",
    "surface-hybrid-pi": f"run surface --part saddle --stepover 30 {SHORT_FEED}",
    "surface-hybrid-adaptive": "run surface --path {reference}/plan-saddle-raster --part saddle "
    f"--controller hybrid-adaptive {SHORT_FEED}",
    "smooth-path": "smooth {reference}/" + ZIGZAG + " --against joint-jerk",
    "smooth": "run smooth --path {reference}/" + ZIGZAG,
    "teach": "run teach --direction x --duration 0.6 --set hand.off_s=0.5",
    "identify": "identify --periods 1 --starts 1",
    "calibrate-payload": "calibrate payload",
    "calibrate-tcp": "calibrate tcp --cell-tool",
    "calibrate-arm": "calibrate arm --poses 20",
    "calibrate-base": "calibrate base",
    "calibrate-budget": "calibrate budget --draws 30",
    "dual": f"run dual {SHORT_FEED}",
    "dual-calibrated": "run dual --calibration {reference}/calibrate-base/calibration.toml "
    "--calibration {reference}/calibrate-tcp/calibration.toml "
    f"--calibration {{reference}}/calibrate-payload/calibration.toml {SHORT_FEED}",
    "score": "score --against hybrid-adaptive --seeds 1 --workers 1 "
    + " ".join(f"--case {case}" for case in SCORED),
}
"""Command lines by name; ``{reference}`` is the folder of the record, where earlier items left their
files."""

KEPT: Final = (".npz", ".csv", ".json", ".toml", ".xml")
"""Endings of the files a record keeps."""
WALL_CLOCK: Final = frozenset(
    ("wall_s", "real_time_factor", "plan_time_s", "design_s", "fit_s", "segments_per_s", "versions")
)
"""Figures that differ from run to run or from machine to machine."""
ONE_CORE: Final = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
"""Sums of linear algebra depend on how many threads share them."""


class Ended(NamedTuple):
    """How a command ended."""

    exit_code: int
    seconds: float
    last_line: str
    """Of its error output."""


class Difference(NamedTuple):
    """What is not as it was."""

    place: str
    """File and column."""
    size: float
    """Largest difference: absolute, for values above 1 relative; infinite where it has no size."""
    text: str


def main() -> None:
    """Read the command line, run the items and end with 1 if something differs."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.freeze", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("action", choices=("record", "compare"))
    parser.add_argument(
        "folder", type=Path, nargs="?", default=DEFAULT, help=f"of the record; default {DEFAULT}"
    )
    parser.add_argument(
        "--only", metavar="NAME", nargs="+", default=["*"], help="items or patterns such as 'plan-*'"
    )
    parser.add_argument(
        "--bound", type=float, default=0.0, help="largest difference allowed; default 0: equal bytes"
    )
    parser.add_argument("--out", type=Path, help="compare: keep the new files in this folder")
    given = parser.parse_args()
    unknown = [pattern for pattern in given.only if not fnmatch.filter(ITEMS, pattern)]
    if unknown:
        parser.error(f"no item is called {', '.join(unknown)}; known: {', '.join(ITEMS)}")
    names = [name for name in ITEMS if any(fnmatch.fnmatchcase(name, pattern) for pattern in given.only)]
    if given.action == "record":
        record(given.folder, names)
    elif not compare(given.folder, names, given.bound, given.out):
        sys.exit(1)


def record(folder: Path, names: Sequence[str]) -> None:
    """Run items and keep their files, exit codes and times; other items of an existing record stay."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ZIGZAG).write_text(_zigzag(), encoding="utf-8")
    known, code = _read_record(folder), _code()
    print(f"record of {code} in {folder}")
    for name in names:
        shutil.rmtree(folder / name, ignore_errors=True)
        ended = run_item(name, folder, folder / name)
        for file in (folder / name).rglob("*"):
            if file.is_file() and file.suffix not in KEPT:
                file.unlink()
        known[name] = {"code": code, "exit_code": ended.exit_code, "seconds": round(ended.seconds, 1)}
        (folder / RECORD).write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8")
        _print_row(
            name, f"exit code {ended.exit_code}: {ended.last_line}" if ended.exit_code else "recorded", ended
        )


def compare(folder: Path, names: Sequence[str], bound: float, out: Path | None) -> bool:
    """Run items again and print a row each: equal, or what differs by how much and where.

    Args:
        folder: Of the record.
        names: Items to run.
        bound: Largest difference allowed, see ``Difference.size``.
        out: Where the new files are kept; None to delete them.

    Returns:
        Whether nothing differs by more than the bound.
    """
    known = _read_record(folder)
    codes = {known[name]["code"] for name in names if name in known}
    print(f"{_code()} against {', '.join(sorted(codes)) or 'nothing'} in {folder}")
    begin, different, details = time.perf_counter(), [], []
    with tempfile.TemporaryDirectory() as temporary:
        for name in names:
            new = (out or Path(temporary)) / name
            shutil.rmtree(new, ignore_errors=True)
            ended = run_item(name, folder, new) if name in known else Ended(0, 0.0, "")
            found = list(_differences(known.get(name), folder / name, new, ended))
            worst = max((difference.size for difference in found), default=0.0)
            different += [name] if worst > bound else []
            details += [f"{name}/{difference.place}: {difference.text}" for difference in found]
            _print_row(name, _verdict(found, worst, bound), ended)
    spent = time.perf_counter() - begin
    print(f"{len(names) - len(different)} of {len(names)} items equal or within {bound:g}, in {spent:.0f} s")
    print("\n".join(details))
    return not different


def run_item(name: str, reference: Path, out: Path) -> Ended:
    """Run an item's command; its files go to ``out``, which must not exist."""
    program = str(Path(sys.executable).with_name("polish-sim"))
    arguments = [word.format(reference=reference) for word in shlex.split(ITEMS[name])]
    begin = time.perf_counter()
    done = subprocess.run(
        [program, *arguments, "--out", str(out)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | ONE_CORE,
    )
    lines = done.stderr.strip().splitlines() or [""]
    return Ended(done.returncode, time.perf_counter() - begin, lines[-1])


def _differences(known: Mapping[str, Any] | None, old: Path, new: Path, ended: Ended) -> Iterator[Difference]:
    """What differs between the files of an item; files, columns and figures that were added do not count."""
    if known is None:
        yield Difference("record", math.inf, "not recorded")
        return
    if ended.exit_code != known["exit_code"]:
        yield Difference(
            "exit code", math.inf, f"{ended.exit_code}, was {known['exit_code']}: {ended.last_line}"
        )
        return
    for file in sorted(path.relative_to(old) for pattern in READERS for path in old.rglob(pattern)):
        if not (new / file).is_file():
            yield Difference(str(file), math.inf, "is missing")
            continue
        read = next(reader for pattern, reader in READERS.items() if file.match(pattern))
        before, after = read(old / file), read(new / file)
        for column, values in before.items():
            difference = _difference(f"{file} {column}", values, after.get(column))
            if difference is not None:
                yield difference


def _difference(place: str, old: NDArray[Any], new: NDArray[Any] | None) -> Difference | None:
    if new is None:
        return Difference(place, math.inf, "is missing")
    if old.shape != new.shape or old.dtype.kind != new.dtype.kind:
        return Difference(place, math.inf, f"{new.dtype} {new.shape}, was {old.dtype} {old.shape}")
    if old.dtype == new.dtype and old.tobytes() == new.tobytes():
        return None
    if old.dtype.kind == "U":
        changed = np.flatnonzero((old != new).ravel())
        return (
            Difference(place, math.inf, f"{len(changed)} texts differ, first at {changed[0]}")
            if len(changed)
            else None
        )
    before, after = old.astype(np.float64), new.astype(np.float64)
    same = (before == after) | (np.isnan(before) & np.isnan(after))
    with np.errstate(invalid="ignore"):
        gap = np.where(same, 0.0, np.nan_to_num(np.abs(after - before), nan=math.inf))
    scaled = gap / np.maximum(1.0, np.nan_to_num(np.abs(before)))
    at = tuple(int(k) for k in np.unravel_index(np.argmax(gap), gap.shape))
    kind = "" if old.dtype == new.dtype else f" ({new.dtype}, was {old.dtype})"
    text = f"largest difference {gap[at]:.3g} at {list(at)}: {after[at]:.9g}, was {before[at]:.9g}{kind}"
    # Equal numbers of other bytes: the sign of a zero, or the width of the numbers.
    return Difference(place, max(float(scaled.max()), np.finfo(float).tiny), text)


def _read_npz(file: Path) -> Columns:
    with np.load(file, allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _read_csv(file: Path) -> Columns:
    head, *rows = csv.reader(file.read_text(encoding="utf-8").splitlines())
    return {name: _column(values) for name, values in zip(head, zip(*rows, strict=True), strict=True)}


def _column(values: Sequence[str]) -> NDArray[Any]:
    try:
        return np.array([float(value) if value else math.nan for value in values])
    except ValueError:
        return np.array(values)


def _read_json(file: Path) -> Columns:
    return dict(_leaves("", json.loads(file.read_text(encoding="utf-8"))))


def _read_toml(file: Path) -> Columns:
    return dict(_leaves("", tomllib.loads(file.read_text(encoding="utf-8"))))


def _leaves(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """Numbers of nested tables by their place; of a text only that there is one, for wording may improve."""
    if isinstance(value, list):
        try:
            yield name, np.array(value, dtype=np.float64)
            return
        except (TypeError, ValueError):
            pass  # not numbers alone, or rows of different lengths
    if isinstance(value, Mapping | list):
        pairs = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, entry in pairs:
            if key not in WALL_CLOCK:
                yield from _leaves(f"{name}.{key}" if name else str(key), entry)
    elif isinstance(value, bool | int | float):
        yield name, np.array(float(value))
    else:
        yield name, np.array(math.nan if value is None else "text")


READERS: Final[Mapping[str, Callable[[Path], Columns]]] = {
    "*.npz": _read_npz,
    "*.csv": _read_csv,
    "metrics.json": _read_json,
    "score.json": _read_json,
    "calibration.toml": _read_toml,
}
"""What is compared."""


def _zigzag() -> str:
    """Eight way points, x, y, z in mm and the tool's axis, which leans by 6 deg to either side in turn."""
    rows = ["x,y,z,i,j,k"]
    for k in range(8):
        lean = math.radians(6.0 if k % 2 else -6.0)
        rows.append(
            f"{60.0 * (k % 2):g},{12.0 * k:g},{3.0 * (k % 3):g},{math.sin(lean)!r},0,{math.cos(lean)!r}"
        )
    return "\n".join(rows) + "\n"


def _code() -> str:
    """Version and commit of the code at hand."""
    program = str(Path(sys.executable).with_name("polish-sim"))
    version = subprocess.run(
        [program, "--version"], capture_output=True, text=True, check=True
    ).stdout.strip()
    asked = ["git", "describe", "--always", "--dirty"]
    commit = subprocess.run(
        asked, capture_output=True, text=True, check=False, cwd=Path(__file__).parent
    ).stdout
    return f"{version} {commit.strip()}".strip()


def _read_record(folder: Path) -> dict[str, Any]:
    file = folder / RECORD
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}


def _verdict(found: Sequence[Difference], worst: float, bound: float) -> str:
    if not found:
        return "equal"
    count = f"{len(found)} column{'s' if len(found) > 1 else ''}"
    return f"{count} within {worst:.2g}" if worst <= bound else f"DIFFERS in {count}, by up to {worst:.3g}"


def _print_row(name: str, result: str, ended: Ended) -> None:
    print(f"{name:32s} {ended.seconds:6.1f} s  {result}", flush=True)


if __name__ == "__main__":
    main()
