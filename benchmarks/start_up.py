"""How long commands take before they do anything."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.table import Row


def measure() -> Iterator[Row]:
    """Best of three starts, after first use."""
    command = [str(Path(sys.executable).with_name("polish-sim"))]
    yield Row("polish-sim --help", f"{_best([*command, '--help']):.2f} s", "0.5 s")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        arguments = [*command, "run", "force", "--out", str(out), "--overwrite"]
        total = _best(arguments)
        simulated = json.loads((out / "metrics.json").read_text())["wall_s"]
    before = _best([*command, "run", "force", "--dry-run"])
    yield Row("polish-sim run force, up to the first step", f"{before:.2f} s", "2 s")
    yield Row("the same, with pictures and files, all but the stepping", f"{total - simulated:.2f} s", "-")


def _best(arguments: list[str]) -> float:
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        subprocess.run(arguments, capture_output=True, check=True)
        times.append(time.perf_counter() - begin)
    return min(times)
