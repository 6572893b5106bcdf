"""What the benchmarks of `polish-sim serve` share: a server in a process of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PROGRAM = (sys.executable, "-c", "from polish_sim.cli import start; start()")
START_S = 600.0  #: A first start compiles


@contextmanager
def serving(*words: str) -> Iterator[subprocess.Popen[bytes]]:
    """`polish-sim serve` with these words while the block runs; at its end as after Ctrl-C, its words are
    printed."""
    with tempfile.NamedTemporaryFile("r") as said:
        process = subprocess.Popen(
            [*PROGRAM, "serve", *words], stdout=said.fileno(), stderr=subprocess.STDOUT
        )
        try:
            begun = time.monotonic()
            while Path(said.name).read_text().count("serving") < max(words.count("--address"), 1):
                if process.poll() is not None or time.monotonic() - begun > START_S:
                    raise SystemExit(f"no server: {Path(said.name).read_text()}")
                time.sleep(0.1)
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(300.0)
            except subprocess.TimeoutExpired:
                process.kill()
            print(Path(said.name).read_text().partition("serving")[2], flush=True)


def memory_mb(process: int) -> float:
    """Resident memory of a process by its number [MB]; of Linux."""
    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    return pages * 4096 / 1e6


def processor_s(process: int) -> float:
    """Processor time a process has had [s]; of Linux."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
