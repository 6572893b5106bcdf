"""`python -m benchmarks.fuzz --count 20000`: broken mesh files never end in a traceback, a hang or a full
memory."""

from __future__ import annotations

import argparse
import faulthandler
import json
import resource
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.mutations import broken_file, file_names, valid_files
from polish_sim.errors import PolishSimError
from polish_sim.geometry import fit_surface, load_part

SLOWEST = 10.0
"""What a file may take [s]; one that takes six times as long hangs, and ends the process."""

LARGEST = 2_000_000_000
"""Memory a file may cost beyond what the program takes anyway [bytes]."""


class Outcome(NamedTuple):
    """What became of a number of broken files."""

    counts: dict[str, int]
    """Files read, and files refused."""
    faults: list[str]
    """Seed, file and the traceback's last line of every fault."""
    slowest: float
    """Longest time of one file [s]."""
    peak: int
    """Peak memory of the process [bytes]."""


def try_files(first_seed: int, count: int, folder: Path) -> Outcome:
    """Break as many files as asked, one by seed, and try to load and fit each; ends the process at a hang."""
    files, names = valid_files(), file_names()
    for name, content in files.items():  # compile first
        fit_surface(load_part(_written(folder, name, content)))
    counts: Counter[str] = Counter()
    faults: list[str] = []
    slowest = 0.0
    for seed in range(first_seed, first_seed + count):
        name = names[seed % len(names)]
        path = _written(folder, name, broken_file(name, files, np.random.default_rng(seed)))
        begin = time.perf_counter()
        faulthandler.dump_traceback_later(6.0 * SLOWEST, exit=True)
        try:
            fit_surface(load_part(path))
            counts["read"] += 1
        except PolishSimError as error:
            counts["refused"] += 1
            if "\n" in str(error) or not str(error).endswith("."):
                faults.append(f"seed {seed}, {name}: no clear message: {error}")
        except Exception:
            faults.append(f"seed {seed}, {name}: {traceback.format_exc(limit=-2)}")
        finally:
            faulthandler.cancel_dump_traceback_later()
        slowest = max(slowest, time.perf_counter() - begin)
    return Outcome(dict(counts), faults, slowest, _peak())


def _peak() -> int:
    """Largest memory of this process [bytes]; what the kernel calls maxrss may be that of the process it came
    from."""
    if _has_proc():
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def run_apart(first_seed: int, count: int) -> Outcome:
    """As `try_files`, in a process of its own whose memory is limited.

    Raises:
        RuntimeError: A file hung or the process died; its last lines.
    """
    command = [sys.executable, "-m", "benchmarks.fuzz", "--worker", str(first_seed), str(count)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        raise RuntimeError(f"seeds {first_seed} to {first_seed + count - 1}: {run.stderr[-2000:]}")
    return Outcome(**json.loads(run.stdout))


def _written(folder: Path, name: str, content: bytes) -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def _work(first_seed: int, count: int) -> None:
    mapped = (
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize() if _has_proc() else 0
    )
    if mapped:
        resource.setrlimit(resource.RLIMIT_AS, (mapped + LARGEST, mapped + LARGEST))
    with tempfile.TemporaryDirectory() as folder:
        print(json.dumps(try_files(first_seed, count, Path(folder))._asdict()))


def _has_proc() -> bool:
    return Path("/proc/self/statm").exists()


def main() -> None:
    """Break files in batches and print what became of them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("--count", type=int, default=7000, help="how many broken files")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--worker", type=int, nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        _work(*arguments.worker)
        return
    outcome = run_apart(arguments.first_seed, arguments.count)
    for fault in outcome.faults:
        print(fault)
    print(
        f"{arguments.count} broken files: {outcome.counts}, {len(outcome.faults)} faults, "
        f"slowest {outcome.slowest:.2f} s (limit {SLOWEST:g} s), "
        f"peak memory {outcome.peak / 1e9:.2f} GB (limit {LARGEST / 1e9:g} GB)"
    )
    sys.exit(1 if outcome.faults or outcome.slowest > SLOWEST else 0)


if __name__ == "__main__":
    main()
