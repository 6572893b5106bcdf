"""`python -m benchmarks.killed --count 30`: `plan` and `run surface` ended by Ctrl-C or kill -9 at random
times.

They leave no folder half written, no process behind and, after the next command beside them, no draft.
"""

from __future__ import annotations

import argparse
import json
import os
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
ENDS_S = 20.0
"""What a command left running ends by itself within this time [s]."""


def _faults(folder: Path, name: str, code: int, err: str, how: signal.Signals) -> Iterator[str]:
    """What is wrong after a command was ended."""
    out = folder / "out" / "cut"
    if out.exists():
        missing = FILES[name] - {path.name for path in out.iterdir()}
        if missing:
            yield f"a folder without {sorted(missing)}"
        else:
            json.loads((out / "metrics.json").read_text())
    # Before Python has loaded its own modules it answers itself.
    if how == signal.SIGINT and "import_site" not in err and (code not in (0, 3, 130) or "Traceback" in err):
        yield f"exit code {code}: {err[-300:]}"
    drafts = list(folder.glob(f"out/.*{DRAFT}"))
    if drafts and how == signal.SIGINT:
        yield "a draft after Ctrl-C"
    with claimed(folder / "out" / "next", "plan"):
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


def main() -> None:
    """Print how many were ended, how, and what was wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.killed", description=__doc__)
    parser.add_argument("--count", type=int, default=30, help="of each command and each way to end it")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    rng, faults, ended = np.random.default_rng(given.seed), 0, Counter[str]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        trimesh.creation.icosphere(subdivisions=3, radius=40.0).export(folder / "part.stl")
        subprocess.run(
            [*PROGRAM, *WORDS["plan"], "--out", "made"], cwd=folder, check=True, capture_output=True
        )
        (folder / "out").mkdir()
        for what in WORDS:
            begin = time.monotonic()
            run = subprocess.run(
                [*PROGRAM, *WORDS[what], "--out", f"whole_{what}"], cwd=folder, capture_output=True
            )
            assert run.returncode in (0, 3), run.stderr
            takes = time.monotonic() - begin
            for how in (signal.SIGKILL, signal.SIGINT):
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
