"""`python -m benchmarks.killed --count 30`: `plan`, `run surface` and work in rows ended by Ctrl-C, kill or
kill -9 at random times.

They leave no folder half written, no process behind and, after the next command beside them, no draft. Work
in rows (`--only sweep,score,tune,seeds`) is resumed after each and ends with the files of work left alone.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from polish_sim.cli.output_folder import DRAFT, claimed

PROGRAM = [sys.executable, "-c", "from polish_sim.cli import start; start()"]
FILES = {
    "plan": {"metrics.json", "path.csv", "path.json", "path.png"},
    "run": {"metrics.json", "config.toml", "log.npz"},
}
"""What a folder that is there must hold."""
WORDS = {
    "plan": ["plan", "part.stl", "--up", "z", "--stepover", "10", "--pad-diameter", "20"],
    "run": ["run", "surface", "--path", "made", "--part", "part.stl", "--feed", "60"],
}
ONE = ("--workers", "1")
ROWS = {
    "sweep": ["sweep", "arc", "--vary", "sensor.force_noise_n=0.1:0.5:lin6", *ONE],
    "score": ["score", "--case", "step-20", "--seeds", "6", *ONE],
    "tune": ["tune", "hybrid-pi", "--over", "force_p", "--trials", "3", "--case", "step-*", "--seeds", "1",
             "--held-out-seeds", "1", *ONE],
    "seeds": ["run", "arc", "--seeds", "6", *ONE],
}  # fmt: skip
"""Work that is kept row by row."""
SAME = {"sweep": "metrics.json", "score": "score.md", "tune": "tuned.toml", "seeds": "seed-0003/log.npz"}
"""A file of it that depends on its rows alone."""
VOLATILE = ("wall_s", "loop_wall_s", "real_time_factor")
ENDS_S = 20.0
"""What a command left running ends by itself within this time [s]."""


WAYS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)


def answered(how: signal.Signals, code: int, err: str) -> bool:
    """Whether a command had the time to answer a signal: before it has loaded its own modules Python does."""
    return how != signal.SIGKILL and code != -how and "import_site" not in err


def _faults(folder: Path, name: str, code: int, err: str, how: signal.Signals) -> Iterator[str]:
    """What is wrong after a command was ended."""
    out = folder / "out" / "cut"
    if out.exists():
        missing = FILES[name] - {path.name for path in out.iterdir()}
        if missing:
            yield f"a folder without {sorted(missing)}"
        else:
            json.loads((out / "metrics.json").read_text())
    if answered(how, code, err) and (code not in (0, 3, 130) or "Traceback" in err):
        yield f"exit code {code}: {err[-300:]}"
    drafts = list(folder.glob(f"out/.*{DRAFT}"))
    if drafts and answered(how, code, err):
        yield f"a draft after {how.name}"
    with claimed({"--out": folder / "out" / "next", "--overwrite": None}, "plan"):
        pass
    (folder / "out" / "next").rmdir()
    if list(folder.glob(f"out/.*{DRAFT}")):
        yield "a draft after the next command"


def _others(group: int) -> list[int]:
    """Processes of a group that are at work still."""
    found = subprocess.run(
        ["ps", "-eo", "pid=,pgid=,stat="], capture_output=True, text=True, check=True
    ).stdout.split("\n")
    rows = [line.split() for line in found if line.strip()]
    return [int(pid) for pid, owner, state in rows if int(owner) == group and not state.startswith("Z")]


def try_once(folder: Path, name: str, how: signal.Signals, after_s: float) -> tuple[bool, list[str]]:
    """Begin a command and end it after a time; whether it was at work still, and what is wrong."""
    command = [*PROGRAM, *WORDS[name], "--out", "out/cut"]
    run = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
                           start_new_session=True)  # fmt: skip
    try:
        run.wait(after_s)
    except subprocess.TimeoutExpired:
        run.send_signal(how)
    cut = run.poll() is None
    _, err = run.communicate()
    found = list(_faults(folder, name, run.returncode, err, how))
    end = time.monotonic() + ENDS_S
    while _others(run.pid) and time.monotonic() < end:
        time.sleep(0.1)
    if left := _others(run.pid):
        os.killpg(run.pid, signal.SIGKILL)
        found.append(f"processes {left} left at work")
    out = folder / "out" / "cut"
    if out.exists():
        for path in out.iterdir():
            path.unlink()
        out.rmdir()
    return cut, found


def rows_of(folder: Path) -> dict[str, dict[str, object]]:
    """The rows of a folder without what differs by itself, by their keys; a torn line is none."""
    lines = [line for line in (folder / "rows.jsonl").read_text().splitlines() if line.endswith("}")]
    entries = map(json.loads, lines)
    return {entry["key"]: {k: v for k, v in entry["row"].items() if k not in VOLATILE} for entry in entries}


def resumed(folder: Path, name: str, takes: float, rng: np.random.Generator) -> tuple[int, list[str]]:
    """End a work in rows again and again and resume it; how often it was ended, and what is wrong."""
    out, whole = folder / "out" / "cut", folder / f"whole_{name}"
    found, ended = list[str](), 0
    for how in rng.permutation(np.array(WAYS, dtype=object)):
        words = [*PROGRAM, *ROWS[name], "--out", "out/cut"]
        run = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                               text=True, start_new_session=True)  # fmt: skip
        try:
            run.wait(float(rng.uniform(0.0, takes)))
        except subprocess.TimeoutExpired:
            run.send_signal(how)
            ended += 1
        _, err = run.communicate()
        answers = answered(how, run.returncode, err)
        if answers and (run.returncode not in (0, 130) or "Traceback" in err):
            found.append(f"{how.name}: exit code {run.returncode}: {err[-300:]}")
        end = time.monotonic() + ENDS_S
        while _others(run.pid) and time.monotonic() < end:
            time.sleep(0.1)
        found += [f"{how.name}: processes {left} left at work"] if (left := _others(run.pid)) else []
    last = subprocess.run(
        [*PROGRAM, *ROWS[name], "--out", "out/cut"], cwd=folder, capture_output=True, text=True
    )
    if last.returncode:
        return ended, [*found, f"resuming: exit code {last.returncode}: {last.stderr[-300:]}"]
    if rows_of(out) != rows_of(whole):
        found.append("other rows than those of work left alone")
    if (out / SAME[name]).read_bytes() != (whole / SAME[name]).read_bytes():
        found.append(f"another {SAME[name]}")
    files, wanted = ({str(file.relative_to(at)) for file in at.rglob("*")} for at in (out, whole))
    found += [f"other files: {files ^ wanted}"] if files != wanted else []
    shutil.rmtree(out)
    return ended, found


def main() -> None:
    """Print how many were ended, how, and what was wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.killed", description=__doc__)
    parser.add_argument("--count", type=int, default=30, help="of each command and each way to end it")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default=",".join([*WORDS, *ROWS]), help="these commands, with commas")
    given = parser.parse_args()
    rng, faults, ended = np.random.default_rng(given.seed), 0, Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        trimesh.creation.icosphere(subdivisions=3, radius=40.0).export(folder / "part.stl")
        subprocess.run(
            [*PROGRAM, *WORDS["plan"], "--out", "made"], cwd=folder, check=True, capture_output=True
        )
        (folder / "out").mkdir()
        for what in given.only.split(","):
            begin = time.monotonic()
            words = (WORDS | ROWS)[what]
            run = subprocess.run(
                [*PROGRAM, *words, "--out", f"whole_{what}"], cwd=folder, capture_output=True
            )
            assert run.returncode in (0, 3), run.stderr
            takes = time.monotonic() - begin
            for number in range(given.count if what in ROWS else 0):
                cuts, found = resumed(folder, what, takes, rng)
                ended[f"{what}, resumed: ended"] += cuts
                faults += len(found)
                for fault in found:
                    print(f"{what}, number {number}: {fault}", flush=True)
            if what in ROWS:
                continue
            for how in WAYS:
                for _ in range(given.count):
                    after = float(rng.uniform(0.0, takes))
                    cut, found = try_once(folder, what, how, after)
                    ended[f"{what}, {how.name}: {'ended' if cut else 'done before'}"] += 1
                    faults += len(found)
                    for fault in found:
                        print(f"{what}, {how.name} after {after:.2f} s: {fault}", flush=True)
    print("; ".join(f"{label} {count}" for label, count in ended.items()))
    print(f"{sum(ended.values())} commands, {faults} faults")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
