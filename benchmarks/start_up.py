"""What a start costs, in units of importing the scientific stack, and how many kernels a first start
compiles."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.table import Row

STACK = "import numpy, scipy.optimize, scipy.spatial, mujoco, numba, matplotlib.pyplot"
POLISH = str(Path(sys.executable).with_name("polish-sim"))


def measure() -> Iterator[Row]:
    """Processor time of warm starts, best of three, and of first starts with an empty cache of kernels."""
    floor = min(_processor_time([sys.executable, "-c", STACK]) for _ in range(3))
    _processor_time([POLISH, "--help"])  # leaves compiled bytecode behind
    shown = min(_processor_time([POLISH, "run", "--help"]) for _ in range(3))
    yield Row("polish-sim run --help", f"{shown:.2f} s", "0.5 s")
    yield Row("importing numpy, scipy, mujoco, numba, matplotlib", f"{floor:.2f} s", "-")
    with tempfile.TemporaryDirectory() as folder:
        for words, limit in (("run force", 1.9), ("plan freeform --proof none", 2.5)):
            command = [POLISH, *words.split(), "--out", f"{folder}/out", "--overwrite"]
            _processor_time(command)
            warm = min(_processor_time(command) for _ in range(3))
            yield Row(f"polish-sim {words}, with pictures, against that", f"{warm / floor:.2f}", f"{limit}")
        for words, limit, ratio in (("run force", "62", "15"), ("demo", "-", "-")):
            cache = Path(folder, "cache", words)
            command = [POLISH, *words.split(), "--out", f"{folder}/out", "--overwrite"]
            cold = _processor_time(command, XDG_CACHE_HOME=str(cache))
            kernels = len(list(cache.rglob("*.nbc")))
            yield Row(f"polish-sim {words}, first start: kernels kept", f"{kernels}", limit)
            yield Row(f"polish-sim {words}, first start, against the import", f"{cold / floor:.1f}", ratio)


def _processor_time(command: list[str], **environment: str) -> float:
    """Processor time of a command and of the processes it begins [s], with compiled bytecode as it is by
    default."""
    environment = {**os.environ, **environment}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, capture_output=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
