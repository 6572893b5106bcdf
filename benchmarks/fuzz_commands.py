"""`python -m benchmarks.fuzz_commands --count 1000`: broken files, settings and options of every kind a user
gives.

Each command ends with an exit code of the contract, one clear error at most, in seconds, with nothing half
written.
"""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import typer

from benchmarks.fuzz import SLOWEST
from benchmarks.mutations import file_names, mutate, scrambled_soup, valid_files
from polish_sim.cli.boundary import execute
from polish_sim.cli.main import commands

HANGS = 90.0
"""A command still at work after this time ends the process [s]; others use the machine as well."""

VALUES = (
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1",
    "1e999",
    "1e-320",
    "1e300",
    "-1e-9",
    "999999999999",
    "9" * 400,
    "",
    " ",
    "x",
    "1,2",
    "0,0,0",
    "1,nan,3",
    "1e300,0,0",
    "0,0,0,0,0,0",
    "500,0,200,90,0,0",
    "part.stl",
    "missing.stl",
    "plan",
    ".",
    "true",
    "[]",
    "[1, 2]",
    "{}",
    "[0.0, 0.0, 0.0]",
    '"text"',
    "'",
    "é",
    "-",
    "--",
    "a=b",
    "name@1",
    "stall@nan",
    "all",
    "auto",
    "none",
    "spiral",
    "point:0,0,40",
    "point:nan,0,0",
    "box:0,0,0,1,1,1",
    "box:1,1,1,0,0,0",
    "polygon:0,0,0",
    "faces:part.stl",
    "polygon:part.stl",
    "../",
    "0.5",
    "100",
    "7",
    "1e-6",
    "1e6",
    "mine.py:Law",
    "mine.py:Missing",
    ":",
)
"""What may stand where a value is wanted."""

LAW = """import numpy as np

class Law:
    def reset(self, cycle_s):
        self.cycle_s = cycle_s

    def step(self, measurement, target):
        v = target.twist[:3] + (target.position - measurement.position) / 0.1
        z = measurement.rotation[:, 2]
        if target.contact:
            v = v - (v @ z) * z + np.clip(0.002 * (target.force - measurement.wrench[2]), -0.02, 0.02) * z
        w = target.twist[3:] + np.cross(z, target.rotation[:, 2]) / 0.1
        return np.concatenate([v, w])
"""
JOB = """G21 G90 G17 F600 ; a job
N10 G0 X0 Y0 Z50
G0 Z0
G1 X10 Y0 F900
G1 Y10
X20 Z1
G91
G1 X5 Y-2.5
G90 G0 Z50
M30
"""
MASTER = "time_s,x_mm,y_mm,z_mm,rx_rad,ry_rad,rz_rad\n" + "".join(
    f"{k},{100 + 2 * k},0,0,0,0,{0.01 * k}\n" for k in range(20)
)
POLYGON = "-20,-20,34\n20,-20,34\n20,20,34\n-20,20,34\n"
PART = ("--up", "z", "--stepover", "15", "--pad-diameter", "20")
SHORT = ("--set", "process.hold_s=1")
NEVER = {"view", "video", "help", "workers", "seeds", "out", "border", "version"}
"""Options that open a window, take all processors or ask for much on purpose."""


class Case(NamedTuple):
    """A command line, and the files it is given, besides the valid ones."""

    words: tuple[str, ...]
    broken: dict[str, bytes]


class Fault(NamedTuple):
    """A command that did not end as it must."""

    seed: int
    kind: str
    words: str
    what: str


def make_valid(folder: Path) -> None:
    """Everything the commands read, made by the commands themselves."""
    for name, content in valid_files().items():
        (folder / name).write_bytes(content)
    shutil.copy(folder / "binary.stl", folder / "part.stl")
    texts = {
        "mine.py": LAW,
        "job.nc": JOB,
        "master.csv": MASTER,
        "polygon.csv": POLYGON,
        "faces.txt": "0\n1\n2\n3\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text)
    _write_log(folder / "log.csv")
    made = [
        ("plan", "part.stl", *PART, "--export", "apt", "--out", "plan"),
        ("run", "force", *SHORT, "--log-rate", "100", "--out", "run"),
        *(("calibrate", what, "--out", what) for what in ("payload", "base", "arm")),
        ("calibrate", "tcp", "--cell-tool", "--out", "tcp"),
    ]
    for words in made:
        code, text = _call(words)
        assert code == 0, f"{words}: {text}"
    for name, words in {"limits.toml": ["config", "limits"], "surface.toml": ["config", "surface"]}.items():
        code, text = _call(words)
        (folder / name).write_text(text)


def _write_log(file: Path) -> None:
    """Ten seconds of a robot's motion, with torques of gravity and noise."""
    rng, t = np.random.default_rng(0), np.arange(1000) / 100.0
    q = 0.5 * np.sin(np.outer(t, 1.0 + 0.3 * np.arange(6))) + [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
    torques = 20.0 * np.cos(q) + 3.0 * np.sign(np.cos(q)) + rng.normal(size=q.shape)
    names = ["time_s", *(f"q{k}_rad" for k in range(1, 7)), *(f"torque{k}_nm" for k in range(1, 7))]
    np.savetxt(file, np.column_stack([t, q, torques]), "%.6g", ",", header=",".join(names), comments="")


def _changed(content: bytes, rng: np.random.Generator) -> bytes:
    """Break a file: its bytes, or one of its numbers."""
    numbers = (
        list(re.finditer(rb"(?<![\w.])-?\d+(\.\d+)?(e-?\d+)?(?![\w.])", content))
        if rng.random() < 0.5
        else []
    )
    if not numbers or b"\x00" in content:
        return mutate(content, rng)
    hit = numbers[int(rng.integers(len(numbers)))]
    return content[: hit.start()] + VALUES[int(rng.integers(len(VALUES)))].encode() + content[hit.end() :]


def _breaks(name: str, *lines: str) -> Callable[[Path, np.random.Generator], Case]:
    """Commands on a broken file, one of the lines by chance."""

    def draw(folder: Path, rng: np.random.Generator) -> Case:
        files = sorted(folder.glob(name))
        file = files[int(rng.integers(len(files)))]
        line = lines[int(rng.integers(len(lines)))].split()
        return Case(tuple(line), {str(file.relative_to(folder)): _changed(file.read_bytes(), rng)})

    return draw


def _draw_mesh(folder: Path, rng: np.random.Generator) -> Case:
    name = str(rng.choice(file_names()))
    content = scrambled_soup(rng) if name == "soup.stl" else mutate((folder / name).read_bytes(), rng)
    return Case(("plan", name, *PART, "--out", "out"), {name: content})


def _keys(table: dict[str, Any], above: str = "") -> Iterator[str]:
    for name, value in table.items():
        yield from _keys(value, f"{above}{name}.") if isinstance(value, dict) else [above + name]


def _draw_setting(folder: Path, rng: np.random.Generator) -> Case:
    keys = list(_keys(tomllib.loads((folder / "surface.toml").read_text())))
    words = [
        ("plan", "part.stl", *PART, "--out", "out"),
        ("run", "arc", "--dry-run"),
        ("run", "force", "--dry-run"),
        ("run", "surface", "--path", "plan", "--dry-run"),
        ("inspect", "plan", "--out", "out"),
        ("run", "force", *SHORT, "--out", "out"),
        ("calibrate", "payload", "--out", "out"),
    ]
    chosen = words[int(rng.integers(len(words)))]
    for _ in range(int(rng.integers(1, 3))):
        chosen += ("--set", f"{rng.choice(keys)}={rng.choice(VALUES)}")
    return Case(chosen, {})


def _draw_options(folder: Path, rng: np.random.Generator) -> Case:
    lines = (
        "plan part.stl --up z --out out",
        "inspect plan --out out",
        "smooth job.nc --no-joints --out out",
        "smooth plan --out out",
        "run force --dry-run",
        "run surface --path plan --dry-run",
        "run arc --dry-run",
        "run force --set process.hold_s=1 --out out",
        "calibrate payload --out out",
        "calibrate tcp --out out",
        "calibrate base --out out",
        "calibrate arm --out out",
        "calibrate budget --draws 30 --out out",
        "identify --data log.csv --out out",
        "report run --out out",
        "run dual --dry-run",
        "score --list",
    )
    words = lines[int(rng.integers(len(lines)))].split()
    command: Any = typer.main.get_command(commands)
    for word in words[: 1 + (words[0] in ("run", "calibrate"))]:
        command = command.get_command(None, word)
    options = [p for p in command.params if p.opts[0].startswith("--") and p.name not in NEVER]
    for option in rng.choice(
        np.array(options, dtype=object), size=min(len(options), int(rng.integers(1, 3)))
    ):
        flag = getattr(option, "is_flag", False)
        words += [option.opts[0]] if flag else [option.opts[0], str(rng.choice(VALUES))]
    return Case(tuple(words), {})


KINDS: dict[str, Callable[[Path, np.random.Generator], Case]] = {
    "part": _draw_mesh,
    "setting": _draw_setting,
    "option": _draw_options,
    "plan folder": _breaks(
        "plan/*.[cj]s*",
        "inspect plan --out out",
        "smooth plan --out out",
        "run surface --path plan --dry-run",
    ),
    "path file": _breaks(
        "plan/path.[ac][ps][tv]",
        "inspect plan/path.apt --part part.stl --out out",
        "smooth plan/path.csv --out out",
        "inspect plan/path.csv --part part.stl --out out",
        "smooth plan/path.apt --no-joints --out out",
    ),
    "job": _breaks("job.nc", "smooth job.nc --no-joints --out out", "smooth job.nc --lenient --out out"),
    "limits": _breaks("limits.toml", "smooth job.nc --limits limits.toml --no-joints --out out"),
    "config": _breaks(
        "surface.toml",
        "plan part.stl --config surface.toml --out out",
        "run surface --path plan --config surface.toml --dry-run",
    ),
    "readings": _breaks("payload/residuals.csv", "calibrate payload --data payload/residuals.csv --out out"),
    "touches": _breaks("tcp/residuals.csv", "calibrate tcp --data tcp/residuals.csv --out out"),
    "circles": _breaks("base/residuals.csv", "calibrate base --data base/residuals.csv --out out"),
    "arms": _breaks("arm/residuals.csv", "calibrate arm --data arm/residuals.csv --out out"),
    "calibration": _breaks(
        "payload/calibration.toml",
        "run force --calibration payload/calibration.toml --dry-run",
        "run force --set process.hold_s=1 --calibration payload/calibration.toml --out out",
    ),
    "calibrations of two": _breaks(
        "[bt][ac][sp]*/calibration.toml",
        "run dual --calibration tcp/calibration.toml --calibration base/calibration.toml --dry-run",
    ),
    "motion log": _breaks("log.csv", "identify --data log.csv --out out"),
    "run folder": _breaks("run/*.[ntj][ops][mzo]*", "report run --out out"),
    "controller": _breaks("mine.py", "run force --controller mine.py:Law --set process.hold_s=1 --out out"),
    "region file": _breaks(
        "polygon.csv", "plan part.stl --up z --stepover 15 --region polygon:polygon.csv --out out"
    ),
    "facet list": _breaks(
        "faces.txt", "plan part.stl --up z --stepover 15 --region faces:faces.txt --out out"
    ),
    "poses": _breaks("master.csv", "run dual --master-path master.csv --dry-run"),
}


def _call(words: tuple[str, ...] | list[str]) -> tuple[int, str]:
    """Exit code, and what was printed: errors, or results where there are none."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = execute(commands, words)
    return code, err.getvalue() if code else out.getvalue() + err.getvalue()


def _listed(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if "__pycache__" not in path.parts}


def _faults(code: int, text: str, before: set[str], after: set[str]) -> Iterator[str]:
    """What is wrong with how a command ended."""
    if code not in (0, 1, 2, 3):
        yield f"exit code {code}: {text[-600:]}"
    if "Traceback" in text or ("Warning:" in text and "mine.py" not in text):
        yield f"a traceback or warning: {text[-600:]}"
    errors = [line for line in text.splitlines() if line.startswith("error: ")]
    if code == 2 and (
        len(errors) != 1 or not text.rstrip().endswith((".", "?")) or text.splitlines()[-1] != errors[0]
    ):
        yield f"no single clear error: {text[-600:]!r}"
    if code == 2 and len(text) > 3000:
        yield f"an error of {len(text)} characters"
    new = after - before
    if any(".polish-sim-part" in name for name in new) or (code == 2 and new):
        yield f"left behind: {sorted(new)[:5]}"
    if code in (0, 1, 3) and "out" in new and not any(name.startswith("out/") for name in new):
        yield "an empty output folder"


def try_case(seed: int, valid: Path) -> tuple[str, int, float, list[Fault]]:
    """One broken thing by its seed: its kind, exit code, processor time [s] and faults."""
    rng = np.random.default_rng([seed, 7])
    kind = list(KINDS)[seed % len(KINDS)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(valid, folder, dirs_exist_ok=True)
        case = KINDS[kind](valid, rng)
        for file, content in case.broken.items():
            (folder / file).write_bytes(content)
        before = _listed(folder)
        os.chdir(folder)
        begin = time.process_time()
        faulthandler.dump_traceback_later(HANGS, exit=True)
        try:
            code, text = _call(case.words)
        except BaseException:
            code, text = -1, traceback.format_exc()
        faulthandler.cancel_dump_traceback_later()
        spent = time.process_time() - begin
        os.chdir(valid)
        found = list(_faults(code, text, before, _listed(folder)))
    if spent > SLOWEST:
        found.append(f"{spent:.1f} s")
    return kind, code, spent, [Fault(seed, kind, " ".join(case.words), what) for what in found]


def _work(seeds: range, valid: Path) -> None:
    """Try seeds and print a line of JSON for each."""
    os.chdir(valid)
    for seed in seeds:
        print(json.dumps([seed, *try_case(seed, valid)]), flush=True)


def try_cases(first: int, count: int, valid: Path) -> list[Any]:
    """Try that many, in a process of their own that is started anew where one hangs or kills it."""
    rows: list[Any] = []
    while len(rows) < count:
        here = first + len(rows)
        command = [
            sys.executable,
            "-m",
            "benchmarks.fuzz_commands",
            "--worker",
            str(here),
            str(first + count),
            str(valid),
        ]
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
        ) as run:
            assert run.stdout
            assert run.stderr
            for line in run.stdout:
                rows.append(json.loads(line))
                for fault in rows[-1][4]:
                    print("\n  ".join(str(part) for part in fault), flush=True)
            died = run.stderr.read()
        if len(rows) < count:
            seed = first + len(rows)
            kind = list(KINDS)[seed % len(KINDS)]
            rows.append([seed, kind, -1, HANGS, [[seed, kind, "", f"hung or died: {died[-1500:]}"]]])
            print(seed, kind, died[-1500:], flush=True)
    return rows


def main() -> None:
    """Try broken inputs of all kinds in turn and print how the commands ended."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz_commands", description=__doc__)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--worker", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        _work(range(int(given.worker[0]), int(given.worker[1])), Path(given.worker[2]))
        return
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        make_valid(Path(name))
        os.chdir(here)
        rows = try_cases(given.first_seed, given.count, Path(name))
    for kind in KINDS:
        mine = [row for row in rows if row[1] == kind]
        codes = ", ".join(f"exit {code}: {n}" for code, n in sorted(Counter(row[2] for row in mine).items()))
        slowest = max((row[3] for row in mine), default=0.0)
        print(f"{kind:20s} {len(mine):5d} | {codes:40s} | slowest {slowest:5.2f} s")
    faults = sum(len(row[4]) for row in rows)
    print(
        f"{given.count} broken inputs: {faults} faults, slowest {max(row[3] for row in rows):.2f} s "
        "(processor time)"
    )
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
