"""`python -m benchmarks.large_log --gigabytes 10`: what reading a window of a long log costs.

A CSV with the columns of ur_rtde, the arm at rest in noise, is written to a temporary folder; then
`polish-sim compare LOG --from .. --to ..` reads ten seconds near its end.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.table import Row, print_rows

RATE_HZ = 500
BLOCK = 5000  #: Rows that are repeated with other times
JOINTS = ("actual_q", "actual_qd", "actual_current", "target_current", "target_moment")


def main() -> None:
    """Write the log, read its window, print memory and time."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.large_log", description=__doc__)
    parser.add_argument("--gigabytes", type=float, default=10.0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "log.csv")
        seconds = _write(file, options.gigabytes * 1e9)
        begin = time.perf_counter()
        with open(file, "rb") as log:
            while log.read(1 << 24):
                pass
        bare, begin = time.perf_counter() - begin, time.perf_counter()
        window = ["--from", f"{seconds - 20.0:.0f}", "--to", f"{seconds - 10.0:.0f}"]
        command = ["compare", str(file), *window, "--out", f"{folder}/out"]
        polish_sim = str(Path(sys.executable).with_name("polish-sim"))
        run = subprocess.run([polish_sim, *command], capture_output=True, text=True, check=False)
        took = time.perf_counter() - begin
        peak = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        print_rows("a window of a long log", [
            Row("log", f"{file.stat().st_size / 1e9:.2f} GB, {seconds / 3600.0:.1f} h", "-"),
            Row("exit code", f"{run.returncode}", "0"),
            Row("peak memory", f"{peak / 1e9:.2f} GB", "1 GB"),
            Row("time, times reading the bytes alone", f"{took / bare:.1f}", "-"),
        ])  # fmt: skip
        if run.returncode:
            print(run.stderr[-2000:])


def _write(file: Path, size: float) -> float:
    """Write rows until the file has this size [bytes]; how long the log is [s]."""
    rng, t = np.random.default_rng(0), np.arange(BLOCK) / RATE_HZ
    pose = np.array([0.3, -1.4, 1.6, -1.7, -1.5, 0.2])
    way = 0.2 * np.sin(2.0 * np.pi * 0.2 * t)[:, None]
    rate = 0.2 * 0.4 * np.pi * np.cos(2.0 * np.pi * 0.2 * t)[:, None] + np.zeros(6)
    weight = np.array([0.0, -60.0, -30.0, -1.0, 0.0, 0.0]) + rng.normal(0.0, 0.5, (BLOCK, 6))
    columns = np.hstack([pose + way, rate, weight / 10.0, weight / 10.0, weight])
    lines = [",".join(f"{value:.15g}" for value in row) for row in columns]
    names = [f"{name}_{j}" for name in JOINTS for j in range(6)]
    rows = written = 0
    with open(file, "w") as log:
        log.write(",".join(["timestamp", *names]) + "\n")
        while written < size:
            block = "".join(f"{(rows + k) / RATE_HZ:.3f},{line}\n" for k, line in enumerate(lines))
            rows, written = rows + BLOCK, written + log.write(block)
    return rows / RATE_HZ


if __name__ == "__main__":
    main()
